"""The layouts this version reads, by the name that a manifest's `adapter` uses."""

from dataclasses import replace
from typing import cast

import numpy as np

from imodbatch.config import did_you_mean
from imodbatch.datasets import folder, seven_scenes
from imodbatch.datasets.base import Adapter, CameraModel
from imodbatch.errors import ConfigError
from imodbatch.manifest import Manifest

ADAPTERS: dict[str, Adapter] = {
    "folder": cast(Adapter, folder),
    "seven_scenes": cast(Adapter, seven_scenes),
}


def adapter_of(manifest: Manifest) -> Adapter:
    """The adapter a manifest names."""
    if manifest.adapter not in ADAPTERS:
        hint = did_you_mean(manifest.adapter, list(ADAPTERS))
        raise ConfigError(f"manifest {manifest.name}: unknown adapter {manifest.adapter!r}.{hint}")
    return ADAPTERS[manifest.adapter]


def camera_model(manifest: Manifest) -> CameraModel:
    """The cameras: what the manifest says, else what the layout knows.

    Without intrinsics of its own, a depth image given in the manifest is taken as registered to the
    colour image.
    """
    section = manifest.camera
    baseline = section.color_from_depth
    color_from_depth = None if baseline is None else np.array(baseline)
    if section.color is None:
        model = replace(adapter_of(manifest).cameras(manifest), color_from_depth=color_from_depth)
    else:
        color = section.color.camera(section.pixel_origin)
        model = CameraModel(color, color, 0.001, (0,), color_from_depth)
    if section.depth is None:
        return model
    model = replace(model, depth_scale_m=section.depth.scale_m, depth_invalid=section.depth.invalid)
    own = section.depth.intrinsics()
    return model if own is None else replace(model, depth=own.camera(section.pixel_origin))
