"""The layouts this version reads, by the name that a manifest's `adapter` uses."""

from dataclasses import replace
from typing import Any

import numpy as np

from imodbatch.core.errors import ConfigError
from imodbatch.datasets import (
    folder,
    rgbd_scenes_v1,
    rgbd_scenes_v2,
    robot,
    scannet,
    seven_scenes,
    tum,
)
from imodbatch.datasets.base import CameraModel
from imodbatch.datasets.layout import Layout
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.toml import did_you_mean

LAYOUTS: dict[str, Layout] = {
    "folder": folder.LAYOUT,
    "seven_scenes": seven_scenes.LAYOUT,
    "robot": robot.LAYOUT,
    "scannet": scannet.LAYOUT,
    "tum": tum.LAYOUT,
    "rgbd_scenes_v1": rgbd_scenes_v1.LAYOUT,
    "rgbd_scenes_v2": rgbd_scenes_v2.LAYOUT,
}


def layout_of(manifest: Manifest) -> Layout:
    """The layout that a manifest's `adapter` names.

    Raises:
        ConfigError: there is none of that name, or it has no use for a key of `[images]`.
    """
    if manifest.adapter not in LAYOUTS:
        hint = did_you_mean(manifest.adapter, list(LAYOUTS))
        raise ConfigError(f"manifest {manifest.name}: unknown adapter {manifest.adapter!r}.{hint}")
    layout = LAYOUTS[manifest.adapter]
    layout.refuse_images(manifest)
    return layout


def annotated(manifest: Manifest, sequence: SequenceSection) -> Manifest:
    """The manifest with the true boxes that the layout has beside a sequence, if it names none."""
    own = layout_of(manifest).own_boxes
    if own is None or own.path is None or "annotations" in manifest.model_fields_set:
        return manifest
    is_there = manifest.path_in(sequence, own.path).is_file()
    return manifest.model_copy(update={"annotations": own}) if is_there else manifest


def miscount(manifest: Manifest, sequence: SequenceSection) -> tuple[int, str] | None:
    """How many frames a whole sequence has, and a sentence; None = as many as it should."""
    if sequence.n_frames is None:
        return None
    n_found = len(layout_of(manifest).all_frames(manifest, sequence))
    if n_found == sequence.n_frames:
        return None
    return n_found, (
        f"{n_found} of {sequence.n_frames} frames (sequences.n_frames) in {manifest.root_path}. "
        "Is the download complete?"
    )


def camera_model(manifest: Manifest, sequence: SequenceSection | None = None) -> CameraModel:
    """The cameras: key by key what the manifest says, else what the layout knows.

    Args:
        manifest: the split.
        sequence: one of its sequences. Without it, where sequences have cameras of their own, the
            intrinsics are typical ones; what depth numbers mean is the same for all.
    """
    section, model = manifest.camera, layout_of(manifest).cameras(manifest, sequence)
    given: dict[str, Any] = {}
    if section.color_from_depth is not None:
        given["color_from_depth"] = np.array(section.color_from_depth)
    if section.color is not None:
        given["color"] = section.color.camera(section.pixel_origin)
    if section.depth is not None:
        own = section.depth.intrinsics()
        if own is not None:
            given["depth"] = own.camera(section.pixel_origin)
        for name in section.depth.model_fields_set & {"scale_m", "invalid"}:
            given[f"depth_{name}"] = getattr(section.depth, name)
    return replace(model, **given)
