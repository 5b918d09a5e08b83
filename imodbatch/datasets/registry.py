"""The layouts this version reads, by the name that a manifest's `adapter` uses."""

from dataclasses import replace
from typing import Any, cast

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
    """The cameras: key by key what the manifest says, else what the layout knows."""
    section, model = manifest.camera, adapter_of(manifest).cameras(manifest)
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
