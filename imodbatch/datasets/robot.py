"""A robot's drives as this package writes them: the layout of `imodbatch simulate --world house`.

    camera.json                                     intrinsics, frames per second
    <sequence>/color/%06d.jpg or .png               depth/%06d.png (mm, 0 = none)
    <sequence>/odometry.txt  trajectory_true.txt    TUM trajectories
    <sequence>/annotations.json                     COCO

It is the adapter `folder` with these names filled in wherever the manifest says nothing else. The
layout of the robot dataset of Konno et al. is not published, so nothing here claims to be that.
"""

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.datasets import folder
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.layout import Layout, always, registered
from imodbatch.datasets.patterns import PathPattern
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import (
    AnnotationsSection,
    ImagesSection,
    Intrinsics,
    OdometrySection,
    ReferenceSection,
)
from imodbatch.settings.toml import validate

CAMERA_FILE = "camera.json"
COLOR = ("color/{frame}.jpg", "color/{frame}.png")
DEPTH = "depth/{frame}.png"
ODOMETRY = OdometrySection(format="tum", path="{sequence}/odometry.txt")
REFERENCE = ReferenceSection(format="tum", path="{sequence}/trajectory_true.txt", up="+z")
ANNOTATIONS = AnnotationsSection(format="coco", path="{sequence}/annotations.json")


class CameraFile(Intrinsics):
    """camera.json: intrinsics in continuous pixels, and how depth and time are counted."""

    depth_scale_m: Annotated[float, Field(gt=0)] = 0.001
    frames_per_second: Annotated[float, Field(gt=0)] | None = None


def _as_folder(manifest: Manifest, sequence: SequenceSection) -> Manifest:
    """The manifest with all that the adapter `folder` has to know of a sequence's images.

    Raises:
        ConfigError: camera.json says what cannot be meant.
        DataError: camera.json is damaged, or colour images of both endings lie side by side.
    """
    return manifest.model_copy(update={"images": _images(manifest, sequence)})


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Colour images by number, each with its depth image."""
    return folder.LAYOUT.all_frames(_as_folder(manifest, sequence), sequence)


def _cameras(manifest: Manifest, _sequence: SequenceSection | None) -> CameraModel:
    """The camera of camera.json, unless the manifest gives another; depth is registered to it.

    Raises:
        ConfigError: neither is there.
    """
    file = _camera_file(manifest)
    if file is None and manifest.camera.color is None:
        raise ConfigError(
            f"manifest {manifest.name}: adapter 'robot' needs {CAMERA_FILE} in "
            f"{manifest.root_path}, or camera.color with width_px, height_px, fx_px, fy_px, cx_px, "
            "cy_px."
        )
    if file is None:
        return folder.LAYOUT.cameras(manifest, None)
    return registered(manifest, file.camera("corner"), file.depth_scale_m)


def _files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """camera.json, and what `folder` reads besides images."""
    own = folder.LAYOUT.other_files(_as_folder(manifest, sequence), sequence)
    return [manifest.root_path / CAMERA_FILE, *own]


def _images(manifest: Manifest, sequence: SequenceSection) -> ImagesSection:
    """`[images]`, key by key what the manifest says, else what the layout is."""
    given, file = manifest.images or ImagesSection(), _camera_file(manifest)
    filled: dict[str, Any] = {
        "color": given.color or _color(manifest.root_path / sequence.path),
        "depth": given.depth or DEPTH,
    }
    has_stamps = given.timestamps is not None or "{stamp}" in filled["color"]
    if given.frames_per_second is None and file is not None and not has_stamps:
        filled["frames_per_second"] = file.frames_per_second
    return given.model_copy(update=filled)


def _color(base: Path) -> str:
    """The pattern that the colour images of a sequence fit."""
    found = [pattern for pattern in COLOR if PathPattern(pattern).values(base)]
    if len(found) > 1:
        raise DataError(
            f"{base}: both {found[0]} and {found[1]} are there. Name one as images.color in the "
            "manifest."
        )
    return found[0] if found else COLOR[0]


def _camera_file(manifest: Manifest) -> CameraFile | None:
    """What camera.json says; None = there is none."""
    path = manifest.root_path / CAMERA_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path}: not readable as JSON ({error}). Restore it, or take it away and give "
            "camera.color in the manifest."
        ) from None
    return validate(CameraFile, content, str(path))


LAYOUT = Layout(
    _frames,
    _cameras,
    images=f"{COLOR[0]} and {DEPTH}",
    images_keys=folder.LAYOUT.images_keys,
    own_poses=always(ODOMETRY),
    true_poses=always(REFERENCE),
    own_boxes=ANNOTATIONS,
    other_files=_files,
)
