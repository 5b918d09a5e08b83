"""The training as a whole, on tiny images: it learns, resumes to the bit, refuses what it must."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detectors import LIGHT, load_detector
from PIL import Image

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.lab.learning.loader import change_colors, cut_crops, cut_window
from imodbatch.lab.learning.log import read_events, read_rows
from imodbatch.lab.learning.loop import train
from imodbatch.lab.learning.recipes import Recipe, load_recipe
from imodbatch.lab.learning.samples import CocoStream, MixedStream, Sample
from imodbatch.lab.learning.targets import ViewTargets
from imodbatch.lab.objects import OBJECTS

HEIGHT, WIDTH, N = 96, 128, 4
CLASSES = ("box", "ring")
COLORS = ((220, 60, 40), (50, 90, 230))
TINY = LIGHT.model_copy(
    update={
        "backbone": "resnet18",  # at stride 8 its first half, 0.7 million parameters
        "fpn_channels": 32,
        "fpn_strides": (8,),
        "anchor_sizes_px": ((24.0, 40.0),),
        "anchor_aspect_ratios": (1.0,),
        "head_width": 64,
        "n_rois": 24,
    }
)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Tiny tensors on many threads mostly wait for one another."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def draw_image(index: int) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Two coloured squares with a white dot on the side that the azimuth names."""
    rng = np.random.default_rng(index)
    image = np.full((HEIGHT, WIDTH, 3), rng.integers(60, 140), dtype=np.uint8)
    annotations = []
    for k, left in enumerate((4, 68)):
        side = int(rng.integers(32, 44))
        x, y = left + int(rng.integers(0, 12)), int(rng.integers(4, HEIGHT - side - 4))
        azimuth = (index + 2 * k) % N
        image[y : y + side, x : x + side] = COLORS[k]
        third = side // 3
        dx, dy = ((2, 1), (1, 0), (0, 1), (1, 2))[azimuth]
        image[y + dy * third :, x + dx * third :][:third, :third] = 255
        annotations.append(
            {
                "bbox": [x, y, side, side],
                "category_id": k + 1,
                "azimuth_deg": azimuth * 360 / N,
                "elevation_deg": 30.0,
                "ignore": 0,
            }
        )
    return image, annotations


def write_folder(folder: Path, n_images: int) -> Path:
    (folder / "images").mkdir(parents=True)
    images, annotations = [], []
    for index in range(n_images):
        pixels, found = draw_image(index)
        name = f"images/{index:06d}.png"
        Image.fromarray(pixels).save(folder / name)
        images.append({"id": index, "file_name": name, "width": WIDTH, "height": HEIGHT})
        annotations += [{"image_id": index, **one} for one in found]
    content = {
        "images": images,
        "annotations": annotations,
        "categories": [
            {"id": 2, "name": "ring", "symmetry": "none"},
            {"id": 1, "name": "box", "symmetry": "none"},
        ],
    }
    (folder / "annotations.json").write_text(json.dumps(content))
    return folder


def with_other_names(folder: Path) -> CocoStream:
    """The same images, in which box and ring have changed names."""
    path = write_folder(folder, 2) / "annotations.json"
    swapped = path.read_text().replace('"ring"', '"x"').replace('"box"', '"ring"')
    path.write_text(swapped.replace('"x"', '"box"'))
    return CocoStream(folder)


def make_recipe(n_steps: int, **sections: dict[str, Any]) -> Recipe:
    content: dict[str, Any] = {
        "name": "tiny",
        "image_size": [WIDTH, HEIGHT],
        "checkpoint_every_steps": 1000,
        "architecture": TINY.model_dump(),
        "grid": {"n_azimuths": N, "elevations_deg": [30.0]},
        "start": {"weights": "random", "freeze_batch_norm": False},
        "data": {"batch_size": 4, "n_workers": 0},
        "targets": {
            "rois_per_image": 32,
            "object_fraction": 0.5,
            "proposals_per_image": 50,
            "view_weight": 2.0,
        },
        "schedule": {
            "learning_rate": 0.02,
            "images_per_epoch": 4 * n_steps,
            "warmup_steps": 5,
            "max_gradient_norm": 10.0,
        },
        "validation": {"every_steps": 1000},
    }
    for name, values in sections.items():
        content[name] = content.get(name, {}) | values
    return Recipe.model_validate(content)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("set") / "eight", 8)


def weights_of(out: Path) -> dict[str, torch.Tensor]:
    content = torch.load(out / "checkpoint.pt", weights_only=True)
    averages = {f"average.{name}": tensor for name, tensor in content["average"].items()}
    return content["network"] | averages


# It learns


@pytest.fixture(scope="module")
def learnt(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("learnt")
    train(make_recipe(60), CocoStream(folder), out, CocoStream(folder, seed=None))
    return out


def test_eight_images_are_learnt(learnt: Path) -> None:
    events = read_events(learnt / "events.jsonl")
    assert [event["event"] for event in events] == ["started", "validated", "done"]
    figures = events[1]["figures"]
    assert figures["mean_ap_voc07_11pt"] > 0.95
    assert figures["azimuth_exact"] > 0.9
    rows = read_rows(learnt / "log.csv")
    assert [int(row["step"]) for row in rows] == [20, 40, 60]
    assert float(rows[-1]["view_loss"]) < float(rows[0]["view_loss"])


def test_what_is_exported_loads_and_detects(learnt: Path, folder: Path) -> None:
    detector = load_detector(learnt / "tiny.safetensors")
    card = detector.card
    assert card.classes == CLASSES  # by ascending category id
    assert card.data["n_images"] == 8
    assert card.figures["n_steps"] == 60
    assert card.figures["validation"]["mean_ap_voc07_11pt"] > 0.95
    sample = CocoStream(folder, seed=None).read(3)
    (found,) = detector([sample.image])
    cells = found.scores.reshape(len(found), 2, N)
    for box, k, azimuth in zip(sample.boxes, sample.class_ids, sample.azimuth_rad, strict=True):
        best = cells[:, k].sum(axis=1).argmax()
        np.testing.assert_allclose(found.boxes[best], box, atol=6)
        assert cells[best, k].argmax() == round(azimuth / (2 * math.pi / N))
    assert {"curves.svg", "azimuth_confusion.svg", "azimuth_confusion.csv"} <= {
        file.name for file in learnt.iterdir()
    }
    lines = (learnt / "azimuth_confusion.csv").read_text().splitlines()
    assert lines[0] == "class,true_bin,named_bin,n_boxes"
    assert sum(int(line.split(",")[3]) for line in lines[1:]) >= 15  # of 16 objects


# It resumes


class KilledError(Exception):
    pass


def train_and_kill(recipe: Recipe, folder: Path, out: Path, at_step: int, resume: bool) -> None:
    def kill(step: int, n_steps: int) -> None:
        assert n_steps == recipe.n_steps
        if step == at_step:
            raise KilledError

    with pytest.raises(KilledError):
        train(recipe, CocoStream(folder), out, resume=resume, progress=kill)


def test_resumed_training_ends_with_the_same_bits(folder: Path, tmp_path: Path) -> None:
    """Killed in either phase, after steps that no checkpoint holds, and stopped by the clock."""
    recipe = make_recipe(
        4,
        crops={"n_images": 6, "batch_size": 2, "size_px": 64, "largest_box_px": 48.0},
        schedule={"average_decay": 0.9},
        data={"color_jitter": 0.2, "noise_sigma": 5.0},
    ).model_copy(update={"checkpoint_every_steps": 2})
    assert (recipe.n_crop_steps, recipe.n_steps) == (3, 7)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert train(recipe, CocoStream(folder), whole).is_done
    stopped = train(recipe, CocoStream(folder), parts, minutes=0.0)
    assert (stopped.step, stopped.is_done) == (0, False)
    untrained = weights_of(parts)
    train_and_kill(recipe, folder, parts, at_step=3, resume=True)
    train_and_kill(recipe, folder, parts, at_step=6, resume=True)
    steps = [event["step"] for event in read_events(parts / "events.jsonl")]
    assert steps == [0, 0, 0, 2]  # started, stopped, resumed, resumed: from step 2, not 3
    assert train(recipe, CocoStream(folder), parts, resume=True).is_done
    first, second = weights_of(whole), weights_of(parts)
    assert first.keys() == second.keys() == untrained.keys()
    for name, tensor in first.items():
        assert torch.equal(tensor, second[name]), name
    for name in ("", "average."):
        moved = f"{name}head.class_logits.weight"
        assert not torch.equal(untrained[moved], first[moved])
    rows = [read_rows(out / "log.csv") for out in (whole, parts)]
    assert [row["step"] for row in rows[0]] == [row["step"] for row in rows[1]] == ["3", "7"]
    # Resuming what is done changes nothing.
    train(recipe, CocoStream(folder), parts, resume=True)
    assert all(torch.equal(tensor, weights_of(parts)[name]) for name, tensor in first.items())


def test_workers_do_not_change_the_result(folder: Path, tmp_path: Path) -> None:
    data = {"color_jitter": 0.2, "noise_sigma": 5.0}
    recipe = make_recipe(2, data=data)
    more = make_recipe(2, data=data | {"n_workers": 2})
    train(recipe, CocoStream(folder), tmp_path / "here")
    train(more, CocoStream(folder), tmp_path / "elsewhere")
    first, second = weights_of(tmp_path / "here"), weights_of(tmp_path / "elsewhere")
    assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())


@pytest.fixture(scope="module")
def begun(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("begun") / "out"
    train(make_recipe(2), CocoStream(folder), out, minutes=0.0)
    return out


def assert_refused(match: str, *args: Any, **options: Any) -> None:
    with pytest.raises(ConfigError, match=match) as error:
        train(*args, **options)
    assert "\n" not in str(error.value)


def test_changed_recipe_is_refused_by_its_key(folder: Path, begun: Path) -> None:
    before = (begun / "checkpoint.pt").read_bytes()
    changed = make_recipe(2, schedule={"learning_rate": 0.01})
    where = "schedule.learning_rate is 0.01, was 0.02"
    assert_refused(where, changed, CocoStream(folder), begun, resume=True)
    assert (begun / "checkpoint.pt").read_bytes() == before


def test_what_does_not_change_the_weights_may_change(
    folder: Path, begun: Path, tmp_path: Path
) -> None:
    (tmp_path / "checkpoint.pt").write_bytes((begun / "checkpoint.pt").read_bytes())
    changed = make_recipe(2, data={"n_workers": 1}, validation={"every_steps": 7})
    outcome = train(changed, CocoStream(folder), tmp_path, minutes=0.0, resume=True)
    assert outcome.step == 0


def test_command_line_stops_and_says_how_to_go_on(folder: Path, tmp_path: Path) -> None:
    from click.testing import CliRunner

    from imodbatch.cli.main import main

    recipe = load_recipe("light").model_dump(mode="json")
    lines = [f"image_size = {recipe['image_size']}", 'name = "mine"', "[architecture]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in TINY.model_dump().items()]
    (tmp_path / "mine.toml").write_text("\n".join(lines))
    out = tmp_path / "out"
    call = ["train", str(tmp_path / "mine.toml"), "--data", str(folder), "--out", str(out)]
    call += ["--set", "start.weights=random", "--minutes", "0"]
    result = CliRunner().invoke(main, call)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("train: 0 of 4500 steps")
    assert "--resume" in result.stdout
    assert load_detector(out / "mine.safetensors").card.n_azimuths == 16
    again = CliRunner().invoke(main, call)
    assert again.exit_code == 1
    assert "holds a training already" in again.stderr


def test_changed_data_are_refused(begun: Path, tmp_path: Path) -> None:
    other = write_folder(tmp_path / "eight", 3)
    assert_refused(
        "training.n_boxes is 6, was 16", make_recipe(2), CocoStream(other), begun, resume=True
    )


def test_a_training_is_not_overwritten(folder: Path, begun: Path, tmp_path: Path) -> None:
    assert_refused("--resume", make_recipe(2), CocoStream(folder), begun)
    assert_refused("no checkpoint", make_recipe(2), CocoStream(folder), tmp_path, resume=True)


def test_damaged_checkpoint_is_one_line(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "checkpoint.pt").write_bytes(b"PK nonsense")
    assert_refused(
        "not a readable checkpoint", make_recipe(2), CocoStream(folder), tmp_path, resume=True
    )


def test_divergence_is_said_so(folder: Path, tmp_path: Path) -> None:
    wild = make_recipe(
        8, schedule={"learning_rate": 1e9, "max_gradient_norm": 0, "warmup_steps": 0}
    )
    assert_refused("diverged at step", wild, CocoStream(folder), tmp_path / "wild")


# What it learns from


def test_coco_folder_is_read_and_shuffled_by_number(folder: Path) -> None:
    stream = CocoStream(folder, seed=4)
    assert stream.classes == CLASSES
    in_order = CocoStream(folder, seed=None)
    rounds = [[bytes(stream[draw].image) for draw in range(start, start + 8)] for start in (0, 8)]
    files = {bytes(in_order.read(i).image) for i in range(8)}
    assert set(rounds[0]) == set(rounds[1]) == files
    assert rounds[0] != rounds[1]
    assert bytes(CocoStream(folder, seed=4)[3].image) == rounds[0][3]
    sample = in_order.read(1)
    np.testing.assert_allclose(sample.azimuth_rad, [math.pi / 2, 3 * math.pi / 2], rtol=1e-6)
    x, y, width, height = draw_image(1)[1][0]["bbox"]
    assert sample.boxes[0].tolist() == [x, y, x + width, y + height]


@pytest.mark.parametrize("content", ["[]", "{", '{"images": 3}', '{"images": []}'])
def test_bad_folders_are_one_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "annotations.json").write_text(content)
    with pytest.raises(DataError) as error:
        CocoStream(tmp_path)
    assert "\n" not in str(error.value)
    assert "annotations.json" in str(error.value)


def test_missing_folder_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        CocoStream(tmp_path / "none")
    with pytest.raises(DataError, match="found none"):
        CocoStream(tmp_path)


def test_folders_of_a_dataset_are_read_as_one(tmp_path: Path) -> None:
    root = tmp_path / "houses"
    for name, n_images in (("house_1", 2), ("house_2", 3)):
        write_folder(root / name, n_images)
    stream = CocoStream(root, seed=None)
    assert (stream.n_images, stream.name) == (5, "houses")
    assert np.array_equal(stream.read(3).image, draw_image(1)[0])
    content = json.loads((root / "house_2/annotations.json").read_text())
    content["categories"][0]["symmetry"] = "full"
    (root / "house_2/annotations.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match="house_2"):
        CocoStream(root)


def test_folders_are_mixed_by_their_shares(folder: Path, tmp_path: Path) -> None:
    other = CocoStream(write_folder(tmp_path / "other", 3))
    first = CocoStream(folder)
    mixed = MixedStream([first, other], (3.0, 1.0), seed=5)
    own = [bytes(mixed[draw].image) for draw in range(200)]
    from_first = [bytes(first[draw].image) == image for draw, image in enumerate(own)]
    from_other = [bytes(other[draw].image) == image for draw, image in enumerate(own)]
    assert all(a or b for a, b in zip(from_first, from_other, strict=True))
    again = MixedStream([first, other], (3.0, 1.0), seed=5)
    assert [bytes(again[draw].image) for draw in range(200)] == own
    told_apart = [a for a, b in zip(from_first, from_other, strict=True) if a != b]
    assert 0.65 < np.mean(told_apart) < 0.85
    assert [part["share"] for part in mixed.describe()["mixture"]] == [0.75, 0.25]
    with pytest.raises(ConfigError, match=r"data\.shares: expected one per --data, 2"):
        MixedStream([first, other], (1.0,))
    with pytest.raises(ConfigError, match="eight and odd name different classes"):
        MixedStream([first, with_other_names(tmp_path / "odd")])


def test_siblings_learn_along(folder: Path, tmp_path: Path) -> None:
    """Three detectors from one training; each knows its own grid, and each has learnt."""
    siblings = [
        {"name": "two", "grid": {"n_azimuths": 2, "elevations_deg": [30.0]}},
        {"name": "none", "grid": {"n_azimuths": 1, "elevations_deg": []}},
    ]
    recipe = Recipe.model_validate({**make_recipe(60).model_dump(), "siblings": siblings})
    train(recipe, CocoStream(folder), tmp_path, CocoStream(folder, seed=None))
    for name, n_azimuths in (("tiny", N), ("two", 2), ("none", 1)):
        detector = load_detector(tmp_path / f"{name}.safetensors")
        assert detector.card.n_azimuths == n_azimuths
        figures = detector.card.figures["validation"]
        assert figures["mean_ap_voc07_11pt"] > 0.9
        assert figures["azimuth_exact"] > 0.9
    body = [load_detector(tmp_path / f"{n}.safetensors").network for n in ("tiny", "none")]
    assert torch.equal(body[0].box_regressor.weight, body[1].box_regressor.weight)
    with pytest.raises(ValueError, match="names of their own"):
        Recipe.model_validate({**recipe.model_dump(), "name": "two"})


def test_crops_show_the_object_under_its_box(folder: Path) -> None:
    recipe = make_recipe(1, crops={"size_px": 64, "largest_box_px": 48.0, "jitter": 0.0})
    sample = CocoStream(folder, seed=None).read(2)
    ignored = Sample(**{**vars(sample), "is_ignored": np.array([False, True])})
    for given, expected in ((sample, [0, 1]), (ignored, [0])):
        batch = cut_crops(
            given,
            given.image,
            ViewTargets(recipe.grid.grid()),
            recipe.crops,
            np.random.default_rng(0),
        )
        assert batch.class_ids.tolist() == expected
        assert batch.crops.shape == (len(expected), 64, 64, 3)
    for crop, roi, k in zip(batch.crops.numpy(), batch.rois.numpy(), batch.class_ids, strict=True):
        left, _, right, _ = sample.boxes[list(sample.class_ids).index(k)]
        assert roi[2] - roi[0] == pytest.approx(right - left, abs=1e-3)  # its own scale
        colored = np.abs(crop.astype(int) - COLORS[k]).sum(axis=2) < 30
        colored |= crop.min(axis=2) > 225
        rows, columns = np.nonzero(colored)
        edges = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        np.testing.assert_allclose(edges, roi, atol=1.2)


def test_crops_shrink_what_is_too_large(folder: Path) -> None:
    recipe = make_recipe(1, crops={"size_px": 64, "largest_box_px": 16.0, "jitter": 0.0})
    sample = CocoStream(folder, seed=None).read(2)
    views = ViewTargets(recipe.grid.grid())
    batch = cut_crops(sample, sample.image, views, recipe.crops, np.random.default_rng(0))
    sides = (batch.rois[:, 2:] - batch.rois[:, :2]).numpy()
    np.testing.assert_allclose(sides, 16.0, atol=1e-3)


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.7])
def test_windows_show_the_object_under_its_box(folder: Path, scale: float) -> None:
    sample = CocoStream(folder, seed=None).read(2)
    whole = 0
    for seed in range(20):
        window = cut_window(sample, (64, 64), scale, np.random.default_rng(seed))
        assert window.image.shape == (64, 64, 3)
        assert len(window.boxes) >= 1  # always around an object
        counted = np.flatnonzero(~window.is_ignored)
        for box, k in zip(window.boxes[counted], window.class_ids[counted], strict=True):
            colored = np.abs(window.image.astype(int) - COLORS[k]).sum(axis=2) < 30
            rows, columns = np.nonzero(colored | (window.image.min(axis=2) > 225))
            inside = (columns >= box[0] - 1) & (columns < box[2] + 1)
            inside &= (rows >= box[1] - 1) & (rows < box[3] + 1)
            edges = np.array(
                [columns[inside].min(), rows[inside].min(), columns[inside].max() + 1,
                 rows[inside].max() + 1]
            )  # fmt: skip
            np.testing.assert_allclose(edges, box, atol=2.5 * max(scale, 1))
            whole += 1
    assert whole >= 10


def test_a_window_ignores_what_it_cuts_off() -> None:
    sample = Sample(
        np.zeros((100, 200, 3), np.uint8),
        np.array([[10, 10, 50, 50], [60, 10, 100, 50], [150, 10, 190, 50]], np.float32),
        np.array([0, 1, 2]),
        np.zeros(3, np.float32),
        np.zeros(3, np.float32),
        np.zeros(3, np.bool_),
    )
    seen = set()
    for seed in range(60):
        window = cut_window(sample, (64, 64), 1.0, np.random.default_rng(seed))
        for box, k, ignored in zip(window.boxes, window.class_ids, window.is_ignored, strict=True):
            shown = (box[2] - box[0]) * (box[3] - box[1]) / 1600
            assert ignored == (shown < 0.75)
            assert shown > 0.05
            seen.add((int(k), bool(ignored)))
    assert {(0, False), (1, False), (2, False), (0, True)} <= seen


def test_a_small_image_fills_its_window() -> None:
    sample = Sample(
        np.full((30, 40, 3), 200, np.uint8), np.array([[10, 10, 20, 20]], np.float32),
        np.array([0]), np.zeros(1, np.float32), np.zeros(1, np.float32), np.zeros(1, np.bool_),
    )  # fmt: skip
    window = cut_window(sample, (80, 60), 1.0, np.random.default_rng(0))
    assert window.image.min() == 200
    np.testing.assert_allclose(window.boxes, [[20, 20, 40, 40]])


def test_color_changes_are_chance_of_the_generator_given() -> None:
    image = draw_image(0)[0]
    image.setflags(write=False)
    first = change_colors(image, 0.2, 5.0, np.random.default_rng(1))
    assert np.array_equal(first, change_colors(image, 0.2, 5.0, np.random.default_rng(1)))
    other = change_colors(image, 0.2, 5.0, np.random.default_rng(2))
    assert np.abs(first.astype(int) - other).mean() > 3
    assert np.array_equal(change_colors(image, 0.0, 0.0, np.random.default_rng(1)), image)
    assert np.abs(first.astype(int) - image).mean() < 60


# Recipes


def test_shipped_recipes_say_what_they_should() -> None:
    paper, light = load_recipe("paper"), load_recipe("light")
    assert paper.architecture.backbone == "resnet101"
    assert paper.architecture.head == "flat"
    assert (paper.targets.view_weight, paper.targets.azimuth_sigma_deg) == (1.0, 0.0)
    assert paper.n_steps == 100 * 18000
    steps = (0, 8 * 18000 - 1, 8 * 18000, paper.n_steps - 1)
    assert [paper.learning_rate(step) for step in steps] == pytest.approx([1e-3, 1e-3, 1e-4, 1e-4])
    first = light.n_crop_steps
    assert light.learning_rate(first) < light.learning_rate(first + 99)
    assert light.learning_rate(light.n_steps - 1) < 1e-6
    # The detector without viewpoints is a setting away, and draws the same images.
    flat = load_recipe("light", ("grid.n_azimuths=1", "grid.elevations_deg=[]"))
    assert flat.card(("a",), {}, {}).n_scores == 1
    assert flat.n_steps == light.n_steps


def test_a_recipe_says_only_what_differs_from_its_base(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('base = "light"\nname = "mine"\n[schedule]\nlearning_rate = 0.5\n')
    mine, light = load_recipe(path).model_dump(), load_recipe("light").model_dump()
    assert (mine.pop("name"), light.pop("name")) == ("mine", "light")
    assert mine["schedule"].pop("learning_rate") == 0.5 != light["schedule"].pop("learning_rate")
    assert mine == light
    path.write_text('base = "lihgt"\n')
    with pytest.raises(ConfigError, match="Did you mean 'light'"):
        load_recipe(path)


def test_the_shipped_detectors_can_be_trained_anew() -> None:
    recipe = load_recipe(Path(__file__).parents[3] / "pipelines/training/robot17.toml")
    names = ["robot17_3x16", "robot17_3x8", "robot17_noview"]
    assert [variant.name for variant in recipe.variants()] == names
    n_scores = [variant.card(tuple(OBJECTS), {}, {}).n_scores for variant in recipe.variants()]
    assert n_scores == [17 * 3 * 16, 17 * 3 * 8, 17]


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("lihgt", (), "Did you mean 'light'"),
        ("light", ("schedule.learning_rte=1",), "Did you mean 'learning_rate'"),
        ("light", ("schedule.decay=steps",), "decay_after_epochs"),
        ("light", ("grid.elevations_deg=[]",), "elevations_deg"),
        ("light", ("crops.largest_box_px=200",), "largest_box_px"),
        ("none.toml", (), "no such file"),
    ],
)
def test_bad_recipes_are_one_line(name: str, settings: tuple[str, ...], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as error:
        load_recipe(name, settings)
    assert "\n" not in str(error.value)


def test_classes_of_both_sets_must_agree(folder: Path, tmp_path: Path) -> None:
    other = with_other_names(tmp_path / "odd")
    assert_refused("same order", make_recipe(1), other, tmp_path, CocoStream(folder))
