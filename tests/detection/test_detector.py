"""The detector engine, with tiny random networks: what goes in, what comes out, what goes wrong."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detectors import LIGHT, load_detector, load_network
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file
from torch import nn

from imodbatch.core.errors import ConfigError
from imodbatch.detection.card import DetectorCard
from imodbatch.detection.checkpoint import save_checkpoint
from imodbatch.detection.files import read_card, read_checkpoint, write_card
from imodbatch.detection.inference import Detector, make_detector
from imodbatch.detection.network import MultiViewFasterRCNN, build_detector

K, M, N = 3, 2, 4
HEIGHT, WIDTH = 96, 128
TINY = LIGHT.model_copy(
    update={
        "fpn_channels": 16,
        "anchor_sizes_px": ((16.0,), (32.0,), (64.0,)),
        "head_width": 32,
        "roi_size": 3,
        "n_rois": 12,
    }
)


def make_card(
    head: str = "flat",
    n_azimuths: int = N,
    elevations_deg: tuple[float, ...] = (30.0, 60.0),
    **architecture: object,
) -> DetectorCard:
    return DetectorCard(
        format_version=1,
        name="tiny",
        architecture=TINY.model_copy(update={"head": head, **architecture}),
        classes=("mug", "bowl", "cap"),
        n_azimuths=n_azimuths,
        elevations_deg=elevations_deg,
        image_size=(WIDTH, HEIGHT),
        licence="CC0-1.0",
        data={"sets": ["none"]},
        seed=7,
        figures={},
    )


def make_network(card: DetectorCard) -> MultiViewFasterRCNN:
    """A random network whose scores and boxes differ visibly between RoIs and images."""
    torch.manual_seed(7)
    network = build_detector(card)
    for name, parameter in network.named_parameters():
        if name.startswith(("head.", "box_regressor.")):
            nn.init.normal_(parameter, std=0.5)
    norms = [layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d)]
    for layer in norms:
        layer.momentum = 1.0  # take the statistics of the next pass: a random MobileNet fades out
    with torch.no_grad():
        network.backbone(torch.randn(2, 3, HEIGHT, WIDTH))
    return network


def make_images(n: int, height: int = HEIGHT, width: int = WIDTH) -> list[NDArray[np.uint8]]:
    """Random rectangles, as read-only arrays."""
    rng = np.random.default_rng(3)
    images = []
    for _ in range(n):
        image = np.zeros((height, width, 3), dtype=np.uint8)
        for _ in range(6):
            y, x = rng.integers(0, height // 2), rng.integers(0, width // 2)
            image[y : y + height // 3, x : x + width // 3] = rng.integers(0, 256, 3)
        image.setflags(write=False)
        images.append(image)
    return images


@pytest.fixture(scope="module")
def card() -> DetectorCard:
    return make_card()


@pytest.fixture(scope="module")
def network(card: DetectorCard) -> MultiViewFasterRCNN:
    return make_network(card)


@pytest.fixture(scope="module")
def detector(network: MultiViewFasterRCNN, card: DetectorCard) -> Detector:
    return Detector(network, card)


@pytest.fixture
def checkpoint(network: MultiViewFasterRCNN, card: DetectorCard, tmp_path: Path) -> Path:
    path = tmp_path / "tiny.safetensors"
    save_checkpoint(network, card, path)
    return path


def assert_one_line(error: pytest.ExceptionInfo[ConfigError], *parts: str) -> None:
    message = str(error.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


# What comes out


@pytest.mark.parametrize("head", ["flat", "factorised"])
@pytest.mark.parametrize(("n_azimuths", "elevations"), [(N, (30.0, 60.0)), (1, ()), (1, (30.0,))])
def test_rows_are_whole_softmaxes(
    head: str, n_azimuths: int, elevations: tuple[float, ...]
) -> None:
    card = make_card(head, n_azimuths, elevations)
    (found,) = Detector(make_network(card), card)(make_images(1))
    n_scores = K * max(1, len(elevations)) * n_azimuths
    assert card.n_scores == n_scores
    assert card.has_viewpoints == (n_azimuths > 1)
    assert 0 < len(found) <= TINY.n_rois
    assert found.boxes.shape == (len(found), 4)
    assert found.scores.shape == (len(found), n_scores)
    assert found.background.shape == (len(found),)
    assert {part.dtype for part in (found.boxes, found.scores, found.background)} == {
        np.dtype(np.float32)
    }
    np.testing.assert_allclose(found.scores.sum(1) + found.background, 1, atol=1e-5)
    assert np.ptp(found.scores, axis=0).max() > 0.01  # the RoIs differ, it is not a constant


def test_boxes_are_clipped_to_the_image(network: MultiViewFasterRCNN, card: DetectorCard) -> None:
    detector = Detector(network, card)
    detector.network.box_regressor.bias.data += torch.tensor([0.0, 0.0, 8.0, 8.0])  # grown
    found = detector(make_images(2))
    boxes = np.concatenate([one.boxes for one in found])
    assert (boxes[:, :2] < boxes[:, 2:]).all()
    assert boxes.min(axis=0)[:2].tolist() == [0, 0]
    assert boxes.max(axis=0)[2:].tolist() == [WIDTH, HEIGHT]


def test_a_box_outside_the_image_is_left_out(network: MultiViewFasterRCNN) -> None:
    card = make_card()
    detector = Detector(network, card)
    (before,) = detector(make_images(1))
    regressor = detector.network.box_regressor
    nn.init.zeros_(regressor.weight)
    regressor.bias.data = torch.tensor([1e4, 0.0, 0.0, 0.0])  # far to the right
    (found,) = detector(make_images(1))
    assert len(before) > 0
    assert len(found) == 0
    assert found.scores.shape == (0, card.n_scores)


def test_an_image_without_proposals_has_no_detections(
    network: MultiViewFasterRCNN, card: DetectorCard
) -> None:
    detector = Detector(network, card)
    rpn: Any = detector.network.rpn
    rpn.score_thresh = 2.0  # no probability is that high
    for found in detector(make_images(2)):
        assert found.boxes.shape == (0, 4)
        assert found.scores.shape == (0, card.n_scores)
        assert found.background.shape == (0,)


def test_boxes_are_in_the_pixels_of_the_image_given(detector: Detector) -> None:
    """An image enlarged by whole numbers and resized back to the network's size is itself."""
    (image,) = make_images(1)
    larger = image.repeat(3, axis=0).repeat(3, axis=1)
    (small,), (large,) = detector([image]), detector([larger])
    np.testing.assert_allclose(large.boxes, small.boxes * 3, atol=0.05)
    np.testing.assert_allclose(large.scores, small.scores, atol=1e-3)
    assert large.boxes[:, 2].max() > WIDTH


def test_the_long_side_limits_the_resize_and_axes_scale_apart(detector: Detector) -> None:
    """A panorama of 401 by 50 becomes 128 by 15: the axes are rounded, and scaled back, apart."""
    unrefined = Detector(detector.network, detector.card)
    for parameter in unrefined.network.box_regressor.parameters():
        nn.init.zeros_(parameter)  # proposals as they are: within the resized image
    batch, _ = unrefined.network.transform([torch.zeros(3, 50, 401)])
    assert batch.image_sizes == [(15, WIDTH)]
    with torch.inference_mode():
        (rois,) = unrefined.network([torch.rand(3, 50, 401)])
    np.testing.assert_allclose(rois.boxes[:, 2:].amax(0).numpy(), [401, 50], rtol=1e-5)


def test_same_input_same_output_and_images_untouched(detector: Detector) -> None:
    images = make_images(1)  # read-only
    (first,), (second,) = detector(images), detector(images)
    np.testing.assert_array_equal(first.boxes, second.boxes)
    np.testing.assert_array_equal(first.scores, second.scores)


def test_a_batch_is_its_images_one_by_one(detector: Detector) -> None:
    """Of equal and of other sizes, in the order given."""
    a, b = make_images(2)
    (other,) = make_images(1, height=200, width=150)
    batch = [a, other, b]
    together = detector(batch)
    alone = [detector([image])[0] for image in batch]
    for one, same in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.boxes, same.boxes, atol=1e-2)
        np.testing.assert_allclose(one.scores, same.scores, atol=1e-4)
    for one, next_one in pairwise(together):  # the three are told apart
        n = min(len(one), len(next_one))
        assert not np.allclose(one.boxes[:n], next_one.boxes[:n], atol=1)
    assert detector([]) == []


def test_a_flipped_view_of_an_array_is_taken(detector: Detector) -> None:
    (image,) = make_images(1)
    (view,) = detector([image[:, ::-1]])
    (copied,) = detector([np.ascontiguousarray(image[:, ::-1])])
    np.testing.assert_array_equal(view.boxes, copied.boxes)


@pytest.mark.parametrize(
    "image", [np.zeros((8, 8), np.uint8), np.zeros((8, 8, 3)), np.zeros((0, 8, 3), np.uint8)]
)
def test_other_arrays_are_refused(detector: Detector, image: NDArray[np.uint8]) -> None:
    with pytest.raises(ValueError, match=r"images\[0\] is .* expected \(H, W, 3\) uint8 RGB"):
        detector([image])


# Which column is what


@pytest.mark.parametrize(("k", "e", "b"), [(0, 0, 1), (1, 1, 0), (2, 1, 3)])
def test_flat_columns_are_class_elevation_azimuth(
    network: MultiViewFasterRCNN, card: DetectorCard, k: int, e: int, b: int
) -> None:
    detector = Detector(network, card)
    for parameter in detector.network.head.parameters():
        nn.init.zeros_(parameter)
    detector.network.get_parameter("head.logits.bias").data[k * 8 + e * 4 + b] = np.log(3.0)
    (found,) = detector(make_images(1))
    expected = np.full((K, M, N), 1 / 27)  # 24 ones, a three, and the background's one
    expected[k, e, b] = 3 / 27
    for row in found.scores.reshape(-1, K, M, N):
        np.testing.assert_allclose(row, expected, rtol=1e-5)


@pytest.mark.parametrize("head", ["flat", "factorised"])
def test_background_is_the_last_column(head: str) -> None:
    card = make_card(head)
    detector = Detector(make_network(card), card)
    layer = "logits" if head == "flat" else "class_logits"
    detector.network.get_parameter(f"head.{layer}.bias").data[-1] = 100
    (found,) = detector(make_images(1))
    np.testing.assert_allclose(found.background, 1, atol=1e-6)
    assert found.scores.max() < 1e-6


def test_factorised_columns_are_class_times_view() -> None:
    card = make_card("factorised")
    detector = Detector(make_network(card), card)
    head = detector.network.head
    for parameter in head.parameters():
        nn.init.zeros_(parameter)
    head.get_parameter("class_logits.bias").data[1] = np.log(5.0)  # classes 1 : 5 : 1, background 1
    head.get_parameter("shared_view_logits.bias").data[1 * 4 + 2] = np.log(
        3.0
    )  # elevation 1, azimuth 2
    head.get_parameter("class_view_logits.bias").data[2 * 8 + 0 * 4 + 3] = np.log(
        7.0
    )  # class 2 at (0, 3)
    (found,) = detector(make_images(1))
    view = np.ones((K, M, N))
    view[:, 1, 2] = 3
    view[2, 0, 3] = 7
    view /= view.sum((1, 2), keepdims=True)
    expected = np.array([1, 5, 1])[:, None, None] / 8 * view
    for row in found.scores.reshape(-1, K, M, N):
        np.testing.assert_allclose(row, expected, rtol=1e-5)
    np.testing.assert_allclose(found.background, 1 / 8, rtol=1e-5)


# The network as a training will use it


@pytest.mark.parametrize("head", ["flat", "factorised"])
def test_every_part_gets_a_gradient(head: str) -> None:
    card = make_card(head)
    network = make_network(card).train()
    images = [torch.rand(3, HEIGHT, WIDTH)]
    boxes = torch.tensor([[10.0, 10.0, 60.0, 70.0]])
    batch, targets = network.transform(images, [{"boxes": boxes, "labels": torch.tensor([1])}])
    levels = network.backbone(batch.tensors)
    _, rpn_losses = network.rpn(batch, levels, targets)
    logits, deltas = network.score_rois(levels, [boxes], batch.image_sizes)
    assert logits.shape == (1, card.n_scores + 1)
    assert deltas.shape == (1, 4)
    loss = nn.functional.cross_entropy(logits, torch.tensor([5])) + deltas.square().sum()
    (loss + sum(rpn_losses.values())).backward()
    without = [name for name, p in network.named_parameters() if p.grad is None]
    assert without == []


def test_the_box_coder_decodes_what_it_encodes(network: MultiViewFasterRCNN) -> None:
    rois = [torch.tensor([[10.0, 10.0, 60.0, 70.0]])]
    boxes = [torch.tensor([[20.0, 5.0, 50.0, 90.0]])]
    (deltas,) = network.box_coder.encode(boxes, rois)
    torch.testing.assert_close(network.box_coder.decode(deltas, rois)[:, 0], boxes[0])


def test_a_detector_leaves_its_network_alone(card: DetectorCard) -> None:
    network = make_network(card).train()
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    Detector(network, card)(make_images(1))
    assert network.training
    after = network.state_dict()
    assert before.keys() == after.keys()
    assert all(torch.equal(before[name], after[name]) for name in before)


@pytest.mark.parametrize("backbone", ["resnet18", "resnet50", "mobilenet_v2", "mobilenet_v3_large"])
def test_levels_have_their_strides_and_folding_changes_nothing(backbone: str) -> None:
    """In float64: a random network enlarges roundings, in float32 to 1e-4 of what comes out."""
    anchors = ((16.0,), (32.0,), (64.0,), (128.0,), (256.0,))
    card = make_card(backbone=backbone, fpn_strides=(4, 8, 16, 32, 64), anchor_sizes_px=anchors)
    network = make_network(card).eval().double()
    for parameter in network.backbone.body.parameters():
        if parameter.ndim == 1:  # the scales and shifts, which start as ones and zeros
            parameter.data += 0.2 * torch.rand_like(parameter)
    images = torch.rand(1, 3, HEIGHT, WIDTH, dtype=torch.float64)
    folded = Detector(network, card).network
    assert not any(isinstance(layer, nn.BatchNorm2d) for layer in folded.modules())
    with torch.inference_mode():
        levels, same = network.backbone(images), folded.backbone(images)
    shapes = {name: tuple(level.shape[1:]) for name, level in levels.items()}
    sizes = [(16, HEIGHT // s, WIDTH // s) for s in (4, 8, 16, 32)] + [(16, 2, 2)]
    assert shapes == dict(zip(["4", "8", "16", "32", "pool"], sizes, strict=True))
    for name, level in levels.items():
        scale = level.abs().max().item()
        torch.testing.assert_close(same[name], level, atol=1e-9 * scale, rtol=0)


def test_roi_pooling_reads_where_the_roi_is_in_small_images(
    network: MultiViewFasterRCNN,
) -> None:
    """33 px become 64 after padding: strides inferred from the sizes would be wrong."""
    ramp = [torch.arange(64 // s, dtype=torch.float32) * s for s in (8, 16, 32)]
    levels = {
        str(s): row.expand(1, 16, len(row), len(row))
        for s, row in zip((8, 16, 32), ramp, strict=True)
    }
    roi = torch.tensor([[8.0, 8.0, 32.0, 32.0]])
    pooled = network.roi_pool(levels, [roi], [(33, 33)])
    np.testing.assert_allclose(pooled.mean().item(), 20, atol=0.01)


# Files


def test_round_trip_within_float16(
    checkpoint: Path, detector: Detector, network: MultiViewFasterRCNN
) -> None:
    stored = load_file(checkpoint)
    assert {t.dtype for t in stored.values()} == {torch.float16, torch.int64}
    loaded, card = load_network(checkpoint)
    assert card == detector.card
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(
            loaded.state_dict()[name], tensor, rtol=2**-11, atol=2**-25, msg=name
        )
    assert {p.dtype for p in loaded.parameters()} == {torch.float32}


def test_round_trip_gives_the_same_detections(checkpoint: Path, tmp_path: Path) -> None:
    """Exactly: float16 values survive a second round trip, so nothing else may differ."""
    first = load_detector(checkpoint)
    again = tmp_path / "again.safetensors"
    save_checkpoint(load_network(checkpoint)[0], first.card, again)
    (found,), (same,) = first(make_images(1)), load_detector(again)(make_images(1))
    np.testing.assert_array_equal(found.boxes, same.boxes)
    np.testing.assert_array_equal(found.scores, same.scores)
    assert again.read_bytes() == checkpoint.read_bytes()
    assert not list(tmp_path.glob("*.partial"))


def test_float16_moves_the_detections_little(checkpoint: Path, detector: Detector) -> None:
    """Scored on the same RoIs: which RoIs are proposed may change where two nearly tie."""
    loaded = load_detector(checkpoint).network
    levels = {str(s): torch.rand(1, 16, HEIGHT // s, WIDTH // s) for s in (8, 16, 32)}
    rois = [torch.tensor([[5.0, 5.0, 50.0, 60.0], [30.0, 20.0, 120.0, 90.0]])]
    with torch.inference_mode():
        before = detector.network.score_rois(levels, rois, [(HEIGHT, WIDTH)])
        after = loaded.score_rois(levels, rois, [(HEIGHT, WIDTH)])
    torch.testing.assert_close(after[0].softmax(1), before[0].softmax(1), atol=2e-3, rtol=0)
    torch.testing.assert_close(after[1], before[1], atol=1e-2, rtol=0)


def test_a_weight_beyond_float16_stays_float32(card: DetectorCard, tmp_path: Path) -> None:
    network = make_network(card)
    network.get_buffer("backbone.body.0.1.running_var")[0] = 1e6
    save_checkpoint(network, card, tmp_path / "wide.safetensors")
    loaded, _ = load_network(tmp_path / "wide.safetensors")
    assert loaded.get_buffer("backbone.body.0.1.running_var")[0] == 1e6


def test_a_diverged_network_is_not_written(card: DetectorCard, tmp_path: Path) -> None:
    network = make_network(card)
    network.box_regressor.bias.data[1] = torch.nan
    with pytest.raises(ConfigError) as error:
        save_checkpoint(network, card, tmp_path / "nan.safetensors")
    assert_one_line(error, "nan.safetensors", "box_regressor.bias", "diverged")
    assert list(tmp_path.iterdir()) == []


def test_missing_weights(tmp_path: Path) -> None:
    for action in (load_detector, read_checkpoint):
        with pytest.raises(ConfigError) as error:
            action(tmp_path / "none.safetensors")
        assert_one_line(error, "none.safetensors", "detect.weights")


def test_missing_card(checkpoint: Path) -> None:
    checkpoint.with_suffix(".json").unlink()
    for action in (load_detector, read_checkpoint):
        with pytest.raises(ConfigError) as error:
            action(checkpoint)
        assert_one_line(error, "tiny.json", "missing", "beside the weights")


def test_other_suffix(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as error:
        load_detector(tmp_path / "model.onnx")
    assert_one_line(error, "model.onnx", ".safetensors", "detect.weights")


@pytest.mark.parametrize("damage", [b"", b"not a header", None])
def test_damaged_weights(checkpoint: Path, damage: bytes | None) -> None:
    content = checkpoint.read_bytes()
    checkpoint.write_bytes(content[: len(content) // 2] if damage is None else damage)
    with pytest.raises(ConfigError) as error:
        load_detector(checkpoint)
    assert_one_line(error, "tiny.safetensors", "not a readable safetensors file", "again")


@pytest.mark.parametrize(
    ("change", "misfit"),
    [
        ("drop", "box_regressor.bias is missing"),
        ("add", "extra.weight is not in the network"),
        ("reshape", "box_regressor.bias is (5,), expected (4,)"),
    ],
)
def test_weights_that_do_not_fit_the_card(checkpoint: Path, change: str, misfit: str) -> None:
    tensors = load_file(checkpoint)
    if change == "drop":
        del tensors["box_regressor.bias"]
    elif change == "add":
        tensors["extra.weight"] = torch.zeros(1)
    else:
        tensors["box_regressor.bias"] = torch.zeros(5)
    save_file(tensors, checkpoint)
    with pytest.raises(ConfigError) as error:
        load_detector(checkpoint)
    assert_one_line(error, "tiny.safetensors", "tiny.json", misfit, "Put the card")


def test_card_of_another_grid(checkpoint: Path) -> None:
    write_card(make_card(n_azimuths=8), checkpoint.with_suffix(".json"))
    with pytest.raises(ConfigError) as error:
        load_detector(checkpoint)
    assert_one_line(error, "head.logits.weight is (25, 32), expected (49, 32)")


@pytest.mark.parametrize("device", ["cuda:99", "warp", "meta"])
def test_a_device_that_is_not_there(checkpoint: Path, device: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_detector(checkpoint, device)
    assert_one_line(error, "detect.device", f'"{device}"', 'detect.device = "cpu"')


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_cuda_without_a_gpu(checkpoint: Path) -> None:
    with pytest.raises(ConfigError) as error:
        load_detector(checkpoint, "cuda")
    assert_one_line(error, "detect.device", '"cuda"', 'detect.device = "cpu"')


# The card


def test_a_card_survives_its_file(tmp_path: Path) -> None:
    for architecture in (LIGHT, TINY):
        card = make_card().model_copy(update={"architecture": architecture})
        write_card(card, tmp_path / "card.json")
        assert read_card(tmp_path / "card.json") == card


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (["clases"], ["mug"], "clases: unknown key. Did you mean 'classes'?"),
        (["architecture", "n_roi"], 3, "architecture.n_roi: unknown key. Did you mean 'n_rois'?"),
        (["zzz"], 1, "zzz: unknown key. Known: format_version, name"),
        (["licence"], None, "licence: Field required"),
        (["architecture", "head"], None, "architecture.head: Field required"),
        (["architecture", "head"], "deep", "(got 'deep')"),
        (["architecture", "backbone"], "vgg", "(got 'vgg')"),
        (["architecture", "fpn_strides"], [8, 32, 64], "fpn_strides must double"),
        (["architecture", "anchor_sizes_px"], [[8], [16]], "one list per entry of fpn_strides"),
        (["architecture", "anchor_sizes_px"], [[8], [16], [3, 4]], "equally many"),
        (["format_version"], 2, "format_version is 2, this version reads 1. Use the version"),
        (["classes"], [], "classes: Tuple should have at least 1 item"),
        (["classes"], ["mug", "mug"], "classes must not name a class twice"),
        (["n_azimuths"], 0, "n_azimuths: Input should be greater than 0 (got 0)"),
        (["elevations_deg"], [60, 30], "elevations_deg must ascend"),
        (["elevations_deg"], [], "elevations_deg must list at least one angle"),
        (
            ["elevations_deg"],
            [30, 120],
            "elevations_deg.1: Input should be less than or equal to 90",
        ),
    ],
)
def test_a_wrong_card_names_file_and_key(
    tmp_path: Path, keys: list[str], value: object, message: str
) -> None:
    path = tmp_path / "wrong.json"
    write_card(make_card(), path)
    content = json.loads(path.read_text())
    *parents, key = keys
    place = content[parents[0]] if parents else content
    if value is None:
        del place[key]
    else:
        place[key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError) as error:
        read_card(path)
    assert_one_line(error, "wrong.json", message)


def test_a_card_of_another_version_says_so_before_its_unknown_keys(tmp_path: Path) -> None:
    path = tmp_path / "later.json"
    path.write_text('{"format_version": 2, "grid": []}')
    with pytest.raises(ConfigError) as error:
        read_card(path)
    assert_one_line(error, "later.json", "format_version is 2, this version reads 1")


@pytest.mark.parametrize("content", [b"{", b"\xff\xfe", b"[]", b""])
def test_a_file_that_is_no_card(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "wrong.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as error:
        read_card(path)
    assert_one_line(error, "wrong.json", "card")


def test_the_digest_follows_weights_and_card(
    checkpoint: Path, network: MultiViewFasterRCNN, card: DetectorCard
) -> None:
    first = read_checkpoint(checkpoint).digest
    assert len(first) == 64
    assert read_checkpoint(str(checkpoint)).digest == first
    write_card(card.model_copy(update={"name": "other"}), checkpoint.with_suffix(".json"))
    second = read_checkpoint(checkpoint).digest
    checkpoint.write_bytes(checkpoint.read_bytes() + b"\0")
    assert len({first, second, read_checkpoint(checkpoint).digest}) == 3
    save_checkpoint(network, card, checkpoint)
    assert read_checkpoint(checkpoint).digest == first  # writing is reproducible


def test_a_detector_is_made_of_the_bytes_that_its_digest_names(
    checkpoint: Path, network: MultiViewFasterRCNN, card: DetectorCard
) -> None:
    before = load_detector(checkpoint)
    read = read_checkpoint(checkpoint)
    network.box_regressor.bias.data[1] += 1
    save_checkpoint(network, card, checkpoint)  # by another process, in between
    made = make_detector(read)
    again = load_detector(checkpoint)
    bias = [d.network.box_regressor.bias for d in (before, made, again)]
    assert torch.equal(bias[0], bias[1])
    assert not torch.equal(bias[0], bias[2])
    assert read_checkpoint(checkpoint) != read


def test_cards_and_digests_need_no_torch() -> None:
    code = "import sys, imodbatch.detection.files;sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
