"""Each planted fault is found, named, and silenced by the line that is proposed; clean data is not
complained of. On the analytic scene, and on real frames where `IMODBATCH_DATA` names them."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from dataset_faults import (
    COMMON,
    Dataset,
    Fault,
    mended,
    poses_late,
    swap,
    trajectory_text,
    wrong_size,
)

from imodbatch.core.frames import invert
from imodbatch.lab.analytic import write_dataset

N_KITCHEN = 240
KITCHEN = """
name = "kitchen"
adapter = "folder"
root = "."
classes = ["coffee_mug"]

[camera]
color = { width_px = 640, height_px = 480, fx_px = 525.37, fy_px = 525.37, cx_px = 320.0, cy_px = 240.0 }
depth = { width_px = 640, height_px = 480, fx_px = 585.0, fy_px = 585.0, cx_px = 320.0, cy_px = 240.0, scale_m = 0.001, invalid = [0, 65535] }

[world]
up = "estimate"

[images]
color = "frame-{frame}.color.jpg"
depth = "frame-{frame}.depth.png"
frames_per_second = 30.0

[odometry]
format = "tum"
path = "{sequence}/trajectory.txt"

[annotations]
format = "coco"
path = "{sequence}/annotations.json"

[[sequences]]
id = "seq-01"
path = "seq-01"
"""  # noqa: E501


@pytest.fixture(scope="session")
def walk(
    tmp_path_factory: pytest.TempPathFactory, analytic_manifest: Callable[..., str]
) -> Dataset:
    root = tmp_path_factory.mktemp("walk") / "data"
    write_dataset(root, n_sequences=1, n_frames=40)
    text = analytic_manifest(root, "walk_1")
    return Dataset(root / "walk_1", text, 320, 100.0)


@pytest.fixture(scope="session")
def kitchen(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    if "IMODBATCH_DATA" not in os.environ:
        pytest.skip("IMODBATCH_DATA is not set: real frames are not at hand")
    given = Path(os.environ["IMODBATCH_DATA"]) / "redkitchen"
    folder = tmp_path_factory.mktemp("kitchen") / "seq-01"
    folder.mkdir()
    poses = []
    for number in range(N_KITCHEN):
        for ending in ("color.jpg", "depth.png"):
            name = f"frame-{number:06d}.{ending}"
            (folder / name).symlink_to(given / "seq-01" / name)
        poses.append(np.loadtxt(given / "seq-01" / f"frame-{number:06d}.pose.txt"))
    stamps_s = np.arange(N_KITCHEN) / 30.0
    (folder / "trajectory.txt").write_text(trajectory_text(stamps_s, np.array(poses)))
    (folder / "annotations.json").symlink_to(given / "mugs_coco.json")
    text = swap(KITCHEN, 'root = "."', f'root = "{folder.parent.as_posix()}"')
    return Dataset(folder, text, 640, 1000 / 30)


@pytest.fixture
def examined(
    tmp_path: Path, cli: Callable[..., Result]
) -> Callable[[str], tuple[int, str, dict[str, Any]]]:
    """Manifest text → exit code, output, outcomes by check."""

    def run(text: str) -> tuple[int, str, dict[str, Any]]:
        manifest, report = tmp_path / "manifest.toml", tmp_path / "report.json"
        manifest.write_text(text, encoding="utf-8")
        result = cli("doctor", manifest, "--frames", 24, "--json", report)
        document = json.loads(report.read_text(encoding="utf-8"))
        outcomes = {o["check"]: o for part in document.values() for o in part}
        return result.exit_code, result.stdout, outcomes

    return run


def colour_focal_wrong(dataset: Dataset) -> str:
    return swap(
        dataset.manifest,
        "height_px = 240, fx_px = 290.0, fy_px = 290.0, cx_px = 160.0, cy_px = 120.0 }",
        "height_px = 240, fx_px = 321.9, fy_px = 321.9, cx_px = 160.0, cy_px = 120.0 }",
    )


def focals_swapped(dataset: Dataset) -> str:
    text = swap(dataset.manifest, "fx_px = 525.37, fy_px = 525.37", "fx_px = F, fy_px = F")
    text = swap(text, "fx_px = 585.0, fy_px = 585.0", "fx_px = 525.37, fy_px = 525.37")
    return swap(text, "fx_px = F, fy_px = F", "fx_px = 585.0, fy_px = 585.0")


LATE = "[odometry] clock_offset_ms = "
ON_WALK = (
    *COMMON,
    Fault("late", poses_late, "pose_timing", "error", (LATE + "-500.0",)),
    Fault("colour focal length × 1.11", colour_focal_wrong, "registration", "error"),
    Fault(
        "wrong size",
        wrong_size,
        "image_size",
        "error",
        ("[camera] color.width_px = 320", "[camera] color.height_px = 240"),
    ),
)
IN_KITCHEN = (
    *COMMON,
    Fault("late", poses_late, "pose_timing", "error", (LATE + "-167.0",)),
    Fault(
        "focal lengths swapped",
        focals_swapped,
        "registration",
        "error",
        (
            "[camera] color.fx_px = 525.37",
            "[camera] color.fy_px = 525.37",
            "[camera] depth.fx_px = 585.0",
            "[camera] depth.fy_px = 585.0",
        ),
        "swapped",
    ),
    Fault(
        "wrong size",
        wrong_size,
        "image_size",
        "error",
        ("[camera] color.width_px = 640", "[camera] color.height_px = 480"),
    ),
)


def assert_found(dataset: Dataset, fault: Fault, tmp_path: Path, examined: Any) -> None:
    damaged = dataset.copy(tmp_path / "damaged")
    text = fault.plant(damaged)
    exit_code, output, outcomes = examined(text)
    assert outcomes[fault.check]["state"] == "found", output
    finding = outcomes[fault.check]["findings"][0]
    assert finding["severity"] == fault.severity
    assert exit_code == (1 if fault.severity == "error" else 0)
    assert fault.says in finding["seen"]
    assert finding["seen"] in output
    errors = {c for c, o in outcomes.items() for f in o["findings"] if f["severity"] == "error"}
    assert errors <= {fault.check}, output
    if fault.mend:
        assert tuple(finding["mend"]) == fault.mend
    if finding["mend"]:
        for line in finding["mend"]:
            assert f"mend: {line}" in output
            text = mended(text, line)
        exit_code, output, outcomes = examined(text)
        assert exit_code == 0, output
        assert not any(o["findings"] for o in outcomes.values()), output


@pytest.mark.parametrize("fault", ON_WALK, ids=lambda fault: fault.name)
def test_a_fault_of_the_analytic_scene_is_found_and_mended(
    fault: Fault, walk: Dataset, tmp_path: Path, examined: Any
) -> None:
    assert_found(walk, fault, tmp_path, examined)


@pytest.mark.parametrize("fault", IN_KITCHEN, ids=lambda fault: fault.name)
def test_a_fault_of_real_frames_is_found_and_mended(
    fault: Fault, kitchen: Dataset, tmp_path: Path, examined: Any
) -> None:
    assert_found(kitchen, fault, tmp_path, examined)


def test_the_clean_analytic_scene_is_not_complained_of(walk: Dataset, examined: Any) -> None:
    exit_code, output, outcomes = examined(walk.manifest)
    assert exit_code == 0
    assert not any(o["findings"] for o in outcomes.values()), output
    assert output.splitlines()[-1].startswith("doctor analytic: nothing wrong in 1")
    made = {check for check, outcome in outcomes.items() if outcome["state"] == "passed"}
    assert {"units", "pose_convention", "pose_timing", "registration", "focal_length"} <= made
    assert {"boxes", "boxes_in_world", "classes"} <= made


def test_clean_real_frames_are_not_complained_of(kitchen: Dataset, examined: Any) -> None:
    exit_code, output, outcomes = examined(kitchen.manifest)
    assert exit_code == 0
    assert not any(o["findings"] for o in outcomes.values()), output


def test_inverse_poses_of_a_layout_with_poses_of_its_own(
    kitchen: Dataset, tmp_path: Path, examined: Any
) -> None:
    """Without [odometry] in the manifest the whole section is proposed."""
    folder = kitchen.copy(tmp_path / "inverse").folder
    poses = np.loadtxt(folder / "trajectory.txt")
    assert len(poses) == N_KITCHEN
    given = Path(os.environ["IMODBATCH_DATA"]) / "redkitchen/seq-01"
    for number in range(N_KITCHEN):
        name = f"frame-{number:06d}.pose.txt"
        np.savetxt(folder / name, invert(np.loadtxt(given / name)))
    text = kitchen.manifest[: kitchen.manifest.index("[images]")]
    text = swap(text, 'adapter = "folder"', 'adapter = "seven_scenes"')
    text = swap(text, kitchen.folder.parent.as_posix(), folder.parent.as_posix())
    sequence = '[[sequences]]\nid = "seq-01"\npath = "seq-01"\n'
    exit_code, output, outcomes = examined(text + sequence)
    assert exit_code == 1
    lines = outcomes["pose_convention"]["findings"][0]["mend"]
    section = "[odometry]\n" + "\n".join(line.removeprefix("[odometry] ") for line in lines)
    assert 'convention = "cam_from_world"' in section
    exit_code, output, _ = examined(f"{text}{section}\n\n{sequence}")
    assert exit_code == 0, output


def test_what_cannot_be_read_is_a_finding(walk: Dataset, examined: Any) -> None:
    text = swap(walk.manifest, "{sequence}/trajectory.txt", "{sequence}/none.txt")
    exit_code, _, outcomes = examined(text)
    assert exit_code == 1
    assert "none.txt" in outcomes["poses"]["findings"][0]["seen"]
    assert outcomes["pose_convention"]["state"] == "skipped"
    text = swap(walk.manifest, 'path = "walk_1"', 'path = "walk_9"')
    exit_code, _, outcomes = examined(text)
    assert exit_code == 1
    assert "walk_9" in outcomes["files"]["findings"][0]["seen"]


def test_without_poses_and_annotations_their_checks_are_skipped(
    walk: Dataset, examined: Any
) -> None:
    text = walk.manifest
    for name in ("odometry", "reference", "annotations", "detections"):
        start = text.index(f"[{name}]")
        text = text[:start] + text[text.index("\n\n", start) + 2 :]
    exit_code, output, outcomes = examined(text)
    assert exit_code == 0, output
    for check in ("poses", "pose_convention", "pose_timing", "boxes", "boxes_in_world", "up"):
        assert outcomes[check]["state"] == "skipped", check
    assert outcomes["registration"]["state"] == "passed"
