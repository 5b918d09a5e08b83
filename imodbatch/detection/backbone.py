"""Features of an image at several strides: a classification network under a feature pyramid.

The feature pyramid (Lin et al. 2017, "Feature Pyramid Networks for Object Detection") brings the
meaning of the coarse layers down to the fine ones. Light detectors leave stride 4 out: it holds
three quarters of all cells and only helps for objects of a few pixels.

The body keeps the parameter names of the classification networks (of `features` for the MobileNets
and EfficientNet-Lite0), so that `backbone.body.load_state_dict(pretrained, strict=False)` starts a
training.
"""

from collections import OrderedDict
from dataclasses import dataclass

import torchvision
from torch import Tensor, nn
from torchvision.models._utils import IntermediateLayerGetter
from torchvision.ops.feature_pyramid_network import FeaturePyramidNetwork, LastLevelMaxPool

from imodbatch.detection.card import Architecture
from imodbatch.detection.efficientnet_lite import EfficientNetLite0

DEEPEST_STRIDE = 32  # of every body below; a coarser level is max-pooled by the pyramid


@dataclass(frozen=True)
class _Tap:
    """The last layer of a body at some stride, and its number of channels."""

    layer: str
    channels: int


def _resnet_taps(channels: tuple[int, int, int, int]) -> dict[int, _Tap]:
    names = ("layer1", "layer2", "layer3", "layer4")
    taps = [_Tap(*pair) for pair in zip(names, channels, strict=True)]
    return dict(zip((4, 8, 16, 32), taps, strict=True))


_TAPS: dict[str, dict[int, _Tap]] = {
    "resnet18": _resnet_taps((64, 128, 256, 512)),
    "resnet34": _resnet_taps((64, 128, 256, 512)),
    "resnet50": _resnet_taps((256, 512, 1024, 2048)),
    "resnet101": _resnet_taps((256, 512, 1024, 2048)),
    # Without the last, pointwise convolution of the MobileNets and of EfficientNet-Lite0, which
    # serves the classifier only.
    "mobilenet_v2": {4: _Tap("3", 24), 8: _Tap("6", 32), 16: _Tap("13", 96), 32: _Tap("17", 320)},
    "mobilenet_v3_large": {
        4: _Tap("3", 24),
        8: _Tap("6", 40),
        16: _Tap("12", 112),
        32: _Tap("15", 160),
    },
    "efficientnet_lite0": {
        4: _Tap("3", 24),
        8: _Tap("5", 40),
        16: _Tap("11", 112),
        32: _Tap("16", 320),
    },
}


def pooled_level_names(architecture: Architecture) -> list[str]:
    """Name the pyramid levels that RoIs are pooled from, fine to coarse (see `PyramidBackbone`)."""
    return [str(stride) for stride in architecture.fpn_strides if stride <= DEEPEST_STRIDE]


def _classification_network(name: str) -> nn.Module:
    """Build the network that a card calls `backbone`, random weights."""
    if name == "efficientnet_lite0":
        return EfficientNetLite0()
    network: nn.Module = getattr(torchvision.models, name)(weights=None)
    return network


class PyramidBackbone(nn.Module):
    """A classification network with a feature pyramid on top, random weights.

    Attributes:
        body: the layers of the classification network up to the coarsest stride in use.
        fpn: the feature pyramid.
        out_channels: channels of every level.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        network = _classification_network(architecture.backbone)
        layers = getattr(network, "features", network)  # a ResNet's layers are its own children
        names = pooled_level_names(architecture)
        taps = {name: _TAPS[architecture.backbone][int(name)] for name in names}
        self.out_channels = architecture.fpn_channels
        self.body: nn.Module = IntermediateLayerGetter(
            layers, return_layers={tap.layer: name for name, tap in taps.items()}
        )
        self.fpn: nn.Module = FeaturePyramidNetwork(
            in_channels_list=[tap.channels for tap in taps.values()],
            out_channels=architecture.fpn_channels,
            extra_blocks=LastLevelMaxPool() if len(architecture.fpn_strides) > len(names) else None,
        )

    def forward(self, images: Tensor) -> "OrderedDict[str, Tensor]":
        """Compute the features of a batch.

        Args:
            images: (B, 3, H, W) normalised, H and W multiples of 32.

        Returns:
            (B, fpn_channels, H / stride, W / stride) per level, fine to coarse; a level is named by
            its stride, the max-pooled one "pool".
        """
        levels: OrderedDict[str, Tensor] = self.fpn(self.body(images))
        return levels
