"""What Blender is asked for: one folder with ``mesh.npz``, ``texture.png`` and ``request.json``.

The script inside Blender only carries out; all conventions are turned into Blender's here:

- Its cameras look along −z with +y up, ours along +z with +y down.
- Its texture coordinates have v = 0 at the bottom, ours at the top.
- A sun of strength π makes a white surface that faces it exactly white; ours has intensity 1.
- Our sky says what light surfaces receive that face up, or down; Blender's background says what
  light comes from a direction. Light a + b·z from directions with height z lets a surface whose
  normal has height n receive a + ⅔·b·n (its mean, weighted with the cosine), so b is 3/2 of half
  the difference.
- Our highlight's exponent n is a roughness of (2 / (n + 2))^¼ (Walter et al. 2007).
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.lab.render.raycast.interface import Floats, Mesh, Sky, SunLight, View
from imodbatch.lab.render.raycast.views import viewpoint_transform

N_SAMPLES = 8
"""Paths per pixel; the noise that is left goes with the denoiser."""
BLENDER_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


def write_request(folder: Path, mesh: Mesh, views: Sequence[View]) -> Path:
    """Write all that Blender needs.

    Returns:
        The JSON's path, which the script takes.
    """
    shine = np.stack([mesh.face_specular, mesh.face_shininess], axis=1)
    materials, face_material = np.unique(shine, axis=0, return_inverse=True)
    arrays: dict[str, NDArray[Any]] = {
        "vertices": np.asarray(mesh.vertices, np.float32),
        "faces": np.asarray(mesh.faces, np.int32),
        "corner_uvs": np.asarray(mesh.corner_uvs * [1, -1] + [0, 1], np.float32),
        "face_material": face_material.reshape(-1).astype(np.int32),
    }
    if mesh.corner_normals is not None:
        arrays["corner_normals"] = np.asarray(mesh.corner_normals, np.float32)
    np.savez(folder / "mesh.npz", **arrays)  # type: ignore[arg-type]
    png = cv2.imencode(".png", cv2.cvtColor(mesh.texture, cv2.COLOR_RGB2BGR))[1]
    (folder / "texture.png").write_bytes(png.tobytes())
    request = folder / "request.json"
    content = {
        "n_samples": N_SAMPLES,
        "does_texture_repeat": bool(mesh.corner_uvs.min() < 0 or mesh.corner_uvs.max() > 1),
        "materials": [
            {"specular": float(specular), "roughness": float((2 / (shininess + 2)) ** 0.25)}
            for specular, shininess in materials
        ],
        "views": [_view_entry(mesh, view) for view in views],
    }
    request.write_text(json.dumps(content), encoding="utf-8")
    return request


def read_light(folder: Path, index: int) -> Floats:
    """Light of a view (H, W, 4) float32: RGB weighted with the coverage, and the coverage.

    Raises:
        ConfigError: Blender left none.
    """
    try:
        return np.asarray(np.load(folder / f"{index:05d}.npy"), np.float32)
    except (OSError, ValueError) as error:
        raise ConfigError(f"Blender left no picture of view {index} ({error}).") from None


def _view_entry(mesh: Mesh, view: View) -> dict[str, Any]:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = 0.5 * (low + high).astype(np.float64)
    object_from_cam = viewpoint_transform(
        middle, view.azimuth_rad, view.elevation_rad, view.distance_m, view.roll_rad
    )
    return {
        "object_from_camera": (object_from_cam @ BLENDER_AXES).tolist(),
        "size_px": view.size_px,
        "focal_px": float(view.focal_px),
        "suns": [_sun_entry(light) for light in view.lights],
        "sky": _sky_entry(view.sky),
        "seed": view.settings.seed,
    }


def _sun_entry(light: SunLight) -> dict[str, Any]:
    return {
        "to_sun": list(light.to_sun),
        "irradiance": (np.pi * np.asarray(light.intensity)).tolist(),
        "angle_rad": 2 * light.half_angle_rad,
    }


def _sky_entry(sky: Sky) -> dict[str, Any]:
    """Light from straight up and straight down; in between it changes with the height."""
    above, below = np.asarray(sky.from_above), np.asarray(sky.from_below)
    mean, rise = 0.5 * (above + below), 1.5 * 0.5 * (above - below)
    return {
        "from_top": np.maximum(mean + rise, 0).tolist(),
        "from_bottom": np.maximum(mean - rise, 0).tolist(),
    }
