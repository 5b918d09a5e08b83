"""How a drive lies on disk: JPEG colour, 16-bit depth, TUM trajectories, COCO annotations."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import quaternion_from_matrix
from imodbatch.core.symmetry import Symmetry
from imodbatch.datasets.coco import box_entry, coco_text, image_entry
from imodbatch.lab.analytic.sensor import to_millimetres
from imodbatch.lab.houses.sequence import GRID_8, GRID_16, HouseFrame, SeenTarget
from imodbatch.tables.atomic import replacing, write_text

FRAMES_PER_SECOND = 5
ODOMETRY_FILE, TRUE_POSES_FILE = "odometry.txt", "trajectory_true.txt"
JPEG_QUALITY = 93


def color_file(frame_index: int) -> str:
    """A colour image's path within its sequence."""
    return f"color/{frame_index:06d}.jpg"


def write_color(path: Path, color: NDArray[np.uint8]) -> None:
    """A JPEG without chroma subsampling: small print stays. Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        Image.fromarray(color).save(file, "JPEG", quality=JPEG_QUALITY, subsampling=0)


def write_images(folder: Path, frame_index: int, frame: HouseFrame) -> None:
    """Colour as JPEG, measured depth as 16-bit millimetres (0 = none)."""
    write_color(folder / color_file(frame_index), frame.color)
    path = folder / f"depth/{frame_index:06d}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    depth = to_millimetres(frame.measured_depth_m.astype(np.float64))
    with replacing(path) as file:
        Image.fromarray(depth).save(file, "PNG", compress_level=4)


def write_trajectory(path: Path, world_from_cam: NDArray[np.float64], what: str) -> None:
    """Poses (F, 4, 4) as TUM lines ``stamp tx ty tz qx qy qz qw``, world_from_cam."""
    lines = [f"# {what}: stamp_s tx_m ty_m tz_m qx qy qz qw, camera in the world, +z up"]
    for frame_index, pose in enumerate(world_from_cam):
        w, x, y, z = quaternion_from_matrix(pose[:3, :3])
        numbers = " ".join(f"{value:.9f}" for value in (*pose[:3, 3], x, y, z, w))
        lines.append(f"{frame_index / FRAMES_PER_SECOND:.6f} {numbers}")
    write_text(path, "\n".join(lines) + "\n")


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
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.fx_px,
        "fy_px": camera.fy_px,
        "cx_px": camera.cx_px,
        "cy_px": camera.cy_px,
        "depth_scale_m": 0.001,
        "frames_per_second": FRAMES_PER_SECOND,
    }
    write_text(path, json.dumps(content, indent=1) + "\n")
