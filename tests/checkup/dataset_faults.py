"""Faults as people make them, planted in a copy of a dataset whose images are links.

A dataset here is a folder for the adapter `folder` with ``trajectory.txt`` (TUM) and
``annotations.json`` (COCO) beside the images of one sequence, and its manifest's text.
"""

import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imodbatch.core.frames import (
    invert,
    make_transform,
    matrix_from_quaternion,
    quaternion_from_matrix,
)


@dataclass(frozen=True)
class Dataset:
    """A dataset that may be damaged.

    Attributes:
        folder: of the one sequence.
        manifest: its manifest's text.
        width_px: of the colour images.
        step_ms: between frames.
    """

    folder: Path
    manifest: str
    width_px: int
    step_ms: float

    def copy(self, to: Path) -> "Dataset":
        """A copy whose files are links."""
        shutil.copytree(self.folder, to / self.folder.name, copy_function=os.symlink)
        text = re.sub(r'root = ".*"', f'root = "{to.as_posix()}"', self.manifest)
        return Dataset(to / self.folder.name, text, self.width_px, self.step_ms)


@dataclass(frozen=True)
class Fault:
    """What is done, and what must be said of it."""

    name: str
    plant: Callable[[Dataset], str]
    check: str
    severity: str
    mend: tuple[str, ...] = ()
    says: str = ""


def swap(text: str, old: str, new: str) -> str:
    assert old in text, old
    return text.replace(old, new)


def replace_file(path: Path, content: bytes | str) -> None:
    """Write a file in place of a link, not through it."""
    path.unlink()
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def trajectory_text(stamps_s: np.ndarray, world_from_cam: np.ndarray) -> str:
    quaternion = quaternion_from_matrix(world_from_cam[:, :3, :3])[:, [1, 2, 3, 0]]
    rows = np.column_stack([world_from_cam[:, :3, 3], quaternion])
    lines = (
        f"{stamp:.6f} " + " ".join(f"{value:.9f}" for value in row)
        for stamp, row in zip(stamps_s, rows, strict=True)
    )
    return "\n".join(lines) + "\n"


def _poses(dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    rows = np.loadtxt(dataset.folder / "trajectory.txt")
    rotation = matrix_from_quaternion(rows[:, [7, 4, 5, 6]])
    return rows[:, 0], make_transform(rotation, rows[:, 1:4])


def _write_poses(dataset: Dataset, stamps_s: np.ndarray, world_from_cam: np.ndarray) -> str:
    replace_file(dataset.folder / "trajectory.txt", trajectory_text(stamps_s, world_from_cam))
    return dataset.manifest


def inverse_poses(dataset: Dataset) -> str:
    stamps, poses = _poses(dataset)
    return _write_poses(dataset, stamps, invert(poses))


def scalar_first(dataset: Dataset) -> str:
    rows = np.loadtxt(dataset.folder / "trajectory.txt")[:, [0, 1, 2, 3, 7, 4, 5, 6]]
    lines = (" ".join(f"{value:.9f}" for value in row) for row in rows)
    replace_file(dataset.folder / "trajectory.txt", "\n".join(lines) + "\n")
    return dataset.manifest


def poses_in_mm(dataset: Dataset) -> str:
    stamps, poses = _poses(dataset)
    poses[:, :3, 3] *= 1000
    return _write_poses(dataset, stamps, poses)


def poses_late(dataset: Dataset) -> str:
    """Each pose bears the stamp of the fifth frame after its own."""
    stamps, poses = _poses(dataset)
    return _write_poses(dataset, stamps + 5 * dataset.step_ms / 1000, poses)


def one_pose_is_nan(dataset: Dataset) -> str:
    path = dataset.folder / "trajectory.txt"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    lines[7] = lines[7].split()[0] + " nan" * 7
    replace_file(path, "\n".join(lines) + "\n")
    return dataset.manifest


def depth_unit(scale_m: str) -> Callable[[Dataset], str]:
    return lambda dataset: swap(dataset.manifest, "scale_m = 0.001", f"scale_m = {scale_m}")


def _change_boxes(dataset: Dataset, change: Callable[[list[float]], list[float]]) -> str:
    path = dataset.folder / "annotations.json"
    document = json.loads(path.read_text())
    for entry in document["annotations"]:
        entry["bbox"] = change(entry["bbox"])
    replace_file(path, json.dumps(document))
    return dataset.manifest


def boxes_as_corners(dataset: Dataset) -> str:
    """COCO's width and height replaced by the second corner."""
    return _change_boxes(dataset, lambda b: [b[0], b[1], b[0] + b[2], b[1] + b[3]])


def boxes_mirrored(dataset: Dataset) -> str:
    width = dataset.width_px
    return _change_boxes(dataset, lambda b: [width - b[0] - b[2], b[1], b[2], b[3]])


def sizes_as_corners(dataset: Dataset) -> str:
    """VOC files whose second corner is a width and a height."""
    document = json.loads((dataset.folder / "annotations.json").read_text())
    class_of = {entry["id"]: entry["name"] for entry in document["categories"]}
    labels = dataset.folder / "labels"
    labels.mkdir()
    for image in document["images"]:
        objects = "".join(
            f"<object><name>{class_of[entry['category_id']]}</name><bndbox>"
            f"<xmin>{entry['bbox'][0]}</xmin><ymin>{entry['bbox'][1]}</ymin>"
            f"<xmax>{entry['bbox'][2]}</xmax><ymax>{entry['bbox'][3]}</ymax></bndbox></object>"
            for entry in document["annotations"]
            if entry["image_id"] == image["id"]
        )
        stem = Path(image["file_name"]).stem
        (labels / f"{stem}.xml").write_text(f"<annotation>{objects}</annotation>")
    coco = 'format = "coco"\npath = "{sequence}/annotations.json"'
    return swap(dataset.manifest, coco, 'format = "voc"\npath = "{sequence}/labels"')


def truncated_depth(dataset: Dataset) -> str:
    path = sorted(dataset.folder.rglob("*.png"))[-1]
    content = path.read_bytes()
    replace_file(path, content[: len(content) // 2])
    return dataset.manifest


def wrong_size(dataset: Dataset) -> str:
    width = dataset.width_px
    old = f"color = {{ width_px = {width}, height_px = {width * 3 // 4},"
    return swap(dataset.manifest, old, "color = { width_px = 400, height_px = 300,")


def mended(text: str, line: str) -> str:
    """A manifest's text with a proposed line in it."""
    found = re.fullmatch(r"\[(\w+)\] ([\w.]+) = (.+)", line)
    assert found is not None, line
    section, key, value = found.groups()
    if section == "camera":
        camera, name = key.split(".")
        pattern = rf"(?m)^({camera} = \{{.*\b{name} = )(\[[^\]]*\]|[^,}}\s]+)"
        text, n = re.subn(pattern, rf"\g<1>{value}", text)
        assert n == 1, line
        return text
    head, found_section, tail = text.partition(f"[{section}]\n")
    assert found_section, line
    body, blank, rest = tail.partition("\n\n")
    kept = [row for row in body.splitlines() if not row.startswith(f"{key} =")]
    return head + found_section + "\n".join([*kept, f"{key} = {value}"]) + blank + rest


COMMON = (
    Fault("depth × 5", depth_unit("0.005"), "units", "error", ("[camera] depth.scale_m = 0.001",)),
    Fault(
        "depth × 0.001", depth_unit("1e-06"), "units", "error", ("[camera] depth.scale_m = 0.001",)
    ),
    Fault(
        "inverse poses",
        inverse_poses,
        "pose_convention",
        "error",
        ('[odometry] convention = "cam_from_world"',),
    ),
    Fault(
        "quaternions w first",
        scalar_first,
        "pose_convention",
        "error",
        ('[odometry] quaternion_order = "wxyz"',),
    ),
    Fault("poses in mm", poses_in_mm, "units", "error", ("[odometry] unit_m = 0.001",)),
    Fault("one NaN pose", one_pose_is_nan, "poses", "warning", says="1 of the file's poses"),
    Fault("corners as sizes", boxes_as_corners, "boxes", "error", says="are a corner, read as"),
    Fault("sizes as corners", sizes_as_corners, "boxes", "error", says="width and height, read as"),
    Fault("mirrored boxes", boxes_mirrored, "boxes_in_world", "error", says="mirrored"),
    Fault("truncated PNG", truncated_depth, "files", "error", says="1 of"),
)
