"""The layouts this version reads, by the name that a manifest's `adapter` uses."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from imodbatch.config import did_you_mean
from imodbatch.datasets import (
    folder,
    rgbd_scenes_v1,
    rgbd_scenes_v2,
    robot,
    scannet,
    seven_scenes,
    tum,
)
from imodbatch.datasets.base import Adapter, CameraModel, Extras
from imodbatch.errors import ConfigError
from imodbatch.manifest import Manifest, SequenceSection

ADAPTERS: dict[str, Adapter] = {
    "folder": cast(Adapter, folder),
    "seven_scenes": cast(Adapter, seven_scenes),
    "robot": cast(Adapter, robot),
    "scannet": cast(Adapter, scannet),
    "tum": cast(Adapter, tum),
    "rgbd_scenes_v1": cast(Adapter, rgbd_scenes_v1),
    "rgbd_scenes_v2": cast(Adapter, rgbd_scenes_v2),
}
EXTRAS: dict[str, Extras] = {
    "folder": folder.EXTRAS,
    "robot": robot.EXTRAS,
    "scannet": scannet.EXTRAS,
    "tum": tum.EXTRAS,
}
"""Of the layouts that have any."""


def adapter_of(manifest: Manifest) -> Adapter:
    """The adapter a manifest names."""
    if manifest.adapter not in ADAPTERS:
        hint = did_you_mean(manifest.adapter, list(ADAPTERS))
        raise ConfigError(f"manifest {manifest.name}: unknown adapter {manifest.adapter!r}.{hint}")
    return ADAPTERS[manifest.adapter]


def layout_files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """Files besides images and poses that frames and cameras are read from; some may be missing."""
    return EXTRAS.get(manifest.adapter, Extras()).files(manifest, sequence)


def annotated(manifest: Manifest, sequence: SequenceSection) -> Manifest:
    """The manifest with the true boxes that the layout has beside a sequence, if it names none."""
    section = EXTRAS.get(manifest.adapter, Extras()).annotations(manifest, sequence)
    return manifest.model_copy(update={"annotations": section})


def camera_model(manifest: Manifest, sequence: SequenceSection | None = None) -> CameraModel:
    """The cameras: key by key what the manifest says, else what the layout knows.

    Args:
        manifest: the split.
        sequence: one of its sequences. Without it, where sequences have cameras of their own, the
            intrinsics are typical ones; what depth numbers mean is the same for all.
    """
    section, of_sequence = manifest.camera, EXTRAS.get(manifest.adapter, Extras()).cameras
    if sequence is None or of_sequence is None:
        model = adapter_of(manifest).cameras(manifest)
    else:
        model = of_sequence(manifest, sequence)
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
