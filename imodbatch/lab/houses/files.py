"""How a drive lies on disk: JPEG colour, 16-bit depth, TUM trajectories, COCO annotations."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.symmetry import Symmetry
from imodbatch.datasets.coco import box_entry, coco_text, image_entry
from imodbatch.lab.disk.images import write_depth, write_image
from imodbatch.lab.disk.trajectory import write_tum
from imodbatch.lab.houses.arranging import Target
from imodbatch.lab.houses.sequence import GRID_8, GRID_16, HouseFrame, SeenTarget
from imodbatch.tables.atomic import write_text

FRAMES_PER_SECOND = 5
ODOMETRY_FILE, TRUE_POSES_FILE = "odometry.txt", "trajectory_true.txt"
JPEG_QUALITY = 93


def color_file(frame_index: int) -> str:
    """A colour image's path within its sequence."""
    return f"color/{frame_index:06d}.jpg"


def write_color(path: Path, color: NDArray[np.uint8]) -> None:
    """A JPEG without chroma subsampling: small print stays. Whole or not at all."""
    write_image(path, color, "JPEG", quality=JPEG_QUALITY, subsampling=0)


def write_images(folder: Path, frame_index: int, frame: HouseFrame) -> None:
    """Colour as JPEG, measured depth as 16-bit millimetres (0 = none)."""
    write_color(folder / color_file(frame_index), frame.color)
    write_depth(folder / f"depth/{frame_index:06d}.png", frame.measured_depth_m, compress_level=4)


def write_trajectory(path: Path, world_from_cam: NDArray[np.float64], what: str) -> None:
    """Poses (F, 4, 4), world_from_cam, of which `what` says how they were found."""
    comment = f"{what}: stamp_s tx_m ty_m tz_m qx qy qz qw, camera in the world, +z up"
    write_tum(path, world_from_cam, FRAMES_PER_SECOND, comment)


def write_annotations(
    path: Path,
    camera: PinholeCamera,
    classes: Mapping[str, Symmetry],
    seen_by_frame: Sequence[Sequence[SeenTarget]],
    image_file: Callable[[int], str] = color_file,
) -> None:
    """True boxes as COCO, with viewpoints; `ignore` = 1 for hidden, cut and tiny objects."""
    size_px = camera.width_px, camera.height_px
    text = coco_text(
        {
            "description": "Simulated house. Boxes enclose whole outlines within the image, hidden "
            "parts included, in continuous pixels (corner = 0). azimuth_deg and elevation_deg: of "
            "the camera in the object's own frame. Bins: 3 x 16 and 3 x 8, elevations 10 30 50."
        },
        classes,
        [image_entry(k, image_file(k), size_px) for k in range(len(seen_by_frame))],
        [[_box(seen) for seen in all_seen] for all_seen in seen_by_frame],
    )
    write_text(path, text)


def _box(seen: SeenTarget) -> dict[str, Any]:
    return box_entry(
        seen.target.class_id,
        seen.box_px,
        seen.n_pixels,
        is_ignored=seen.is_ignored,
        instance=seen.target.instance_id,
        visibility=round(seen.visibility, 4),
        azimuth_deg=round(float(np.rad2deg(seen.azimuth_rad)), 6),
        elevation_deg=round(float(np.rad2deg(seen.elevation_rad)), 6),
        azimuth_bin16=int(GRID_16.azimuth_bins(seen.azimuth_rad)),
        azimuth_bin8=int(GRID_8.azimuth_bins(seen.azimuth_rad)),
        elevation_bin=int(GRID_16.elevation_bins(seen.elevation_rad)),
    )


def write_camera(path: Path, camera: PinholeCamera) -> None:
    """Intrinsics in continuous pixels; depth is registered to colour, in millimetres."""
    content = {
        **asdict(camera),
        "depth_scale_m": 0.001,
        "frames_per_second": FRAMES_PER_SECOND,
    }
    write_text(path, json.dumps(content, indent=1) + "\n")


def true_place(target: Target) -> dict[str, Any]:
    """Where a target truly stands, for ``objects.json``."""
    return {
        "instance": target.instance_id,
        "class": target.model.name,
        "xyz_world_m": [round(float(v), 6) for v in target.middle_world],
        "yaw_deg": round(float(np.rad2deg(target.yaw_rad)), 6),
    }
