"""Object model → cutouts from all M·N viewpoints of a grid, several variants of each.

Variant 0 is the bin's centre itself, as in the paper, unless settings say otherwise. The others
differ from it within the bin, in roll, in distance (and so perspective) and in light; their labels
are their true angles.
"""

import hashlib
import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError
from imodbatch.core.viewpoint import FULL_TURN_RAD, ViewGrid
from imodbatch.lab.mesh import ObjectModel, TexturedMesh
from imodbatch.lab.pictures.cutouts import Cutout, crop_to_object, write_cutouts
from imodbatch.lab.pictures.lighting import random_lights, random_settings
from imodbatch.lab.processes import results
from imodbatch.lab.progress import Progress, silent
from imodbatch.lab.render import blender
from imodbatch.lab.render.raycast import View, viewpoint_transform
from imodbatch.lab.scene import ViewRenderer, render_views

PAPER_GRID = ViewGrid(16, tuple(np.deg2rad([10.0, 30.0, 50.0]).tolist()))
VERSION = 1
"""Part of the cache's key: raise it when the same settings give other pictures."""
WITHIN_BIN = 0.999
"""Of half a bin: a jittered view never lands on the border, so its bin is not in doubt."""
FILL = 0.96
"""Share of the render's side that the object's longer side spans."""


@dataclass(frozen=True)
class ViewSettings:
    """What is rendered of each object.

    Attributes:
        grid: bins; every one is rendered.
        n_variants: pictures per bin.
        first_is_center: whether the first variant is the bin's center, as in the paper.
        size_px: side of a render; the object's longer side spans most of it.
        elevation_jitter_rad: to either side; None = half the smallest gap between elevations, so
            that a detector sees all elevations between the bins' too.
        lowest_elevation_rad: no view from below it.
        roll_rad: to either side.
        distance_m: nearest and farthest camera, measured from the middle of the object.
        seed: of all variation.
        renderer: ``embree`` (fast) | ``blender`` (path traced, as in the paper).
    """

    grid: ViewGrid = PAPER_GRID
    n_variants: int = 8
    first_is_center: bool = True
    size_px: int = 224
    elevation_jitter_rad: float | None = None
    lowest_elevation_rad: float = float(np.deg2rad(3))
    roll_rad: float = float(np.deg2rad(5))
    distance_m: tuple[float, float] = (0.5, 3.0)
    seed: int = 0
    renderer: ViewRenderer = "embree"

    def __post_init__(self) -> None:
        if self.n_variants < 1:
            raise ConfigError(f"n_variants: expected at least 1, found {self.n_variants}.")
        if not 0 < self.distance_m[0] <= self.distance_m[1]:
            raise ConfigError(f"distance_m: expected 0 < near ≤ far, found {self.distance_m}.")

    @property
    def n_views(self) -> int:
        """Pictures per object."""
        return self.grid.n_elevations * self.grid.n_azimuths * self.n_variants

    def elevation_range_rad(self, elevation_bin: int) -> tuple[float, float]:
        """From where to where a bin's elevations are drawn."""
        elevations = np.sort(self.grid.elevations_rad)
        gap = float(np.diff(elevations).min()) if len(elevations) > 1 else np.deg2rad(20)
        jitter = self.elevation_jitter_rad
        reach = WITHIN_BIN * min(0.5 * gap if jitter is None else jitter, 0.5 * gap)
        middle = self.grid.elevations_rad[elevation_bin]
        return max(middle - reach, min(self.lowest_elevation_rad, middle)), middle + reach


def prepare_views(
    models: Sequence[ObjectModel],
    cache: Path,
    settings: ViewSettings | None = None,
    *,
    workers: int = 1,
    progress: Progress = silent,
) -> list[Path]:
    """Render what the cache does not hold yet.

    Args:
        models: objects; their order is that of the class numbers later.
        cache: folder; files are named by object and a digest of model and settings.
        settings: what is rendered.
        workers: objects at a time, in processes of their own.
        progress: called with pictures done and pictures in all.

    Returns:
        Per model, the path that `load_cutouts` takes.
    """
    settings = settings or ViewSettings()
    stems = [
        cache / f"{_file_name(model.instance_name)}-{view_digest(model, settings)}"
        for model in models
    ]
    tables = [stem.with_name(f"{stem.name}.json") for stem in stems]
    todo = [i for i, table in enumerate(tables) if not table.is_file()]
    done = (len(models) - len(todo)) * settings.n_views
    total = len(models) * settings.n_views
    progress(done, total)
    for _ in results(_render_to, [(stems[i], models[i], settings) for i in todo], workers):
        done += settings.n_views
        progress(done, total)
    return tables


def render_cutouts(model: ObjectModel, settings: ViewSettings) -> Iterator[Cutout]:
    """Cutouts of one object in the order elevation, azimuth, variant."""
    views = [
        plan_view(model, settings, e, a, variant)
        for e in range(settings.grid.n_elevations)
        for a in range(settings.grid.n_azimuths)
        for variant in range(settings.n_variants)
    ]
    return _cutouts_of(model, views, settings.renderer)


def plan_view(
    model: ObjectModel, settings: ViewSettings, elevation_bin: int, azimuth_bin: int, variant: int
) -> View:
    """From where and in which light one picture is taken; the same for all renderers."""
    name = zlib.crc32(model.instance_name.encode())
    rng = np.random.default_rng([settings.seed, name, elevation_bin, azimuth_bin, variant])
    grid = settings.grid
    azimuth, elevation = azimuth_bin * grid.azimuth_step_rad, grid.elevations_rad[elevation_bin]
    roll = 0.0
    if variant or not settings.first_is_center:
        half_step = 0.5 * WITHIN_BIN * grid.azimuth_step_rad
        azimuth = (azimuth + rng.uniform(-half_step, half_step)) % FULL_TURN_RAD
        elevation = float(rng.uniform(*settings.elevation_range_rad(elevation_bin)))
        roll = float(rng.uniform(-settings.roll_rad, settings.roll_rad))
    near, far = np.log(settings.distance_m)
    distance_m = max(float(np.exp(rng.uniform(near, far))), 1.5 * _radius_m(model.mesh))
    lights, sky, exposure = random_lights(rng)
    return View(
        float(azimuth),
        float(elevation),
        settings.size_px,
        distance_m,
        fitting_focal_px(model.mesh, azimuth, elevation, distance_m, roll, settings.size_px),
        roll,
        lights,
        sky,
        random_settings(exposure, rng),
    )


def fitting_focal_px(
    mesh: TexturedMesh,
    azimuth_rad: float,
    elevation_rad: float,
    distance_m: float,
    roll_rad: float,
    size_px: int,
) -> float:
    """Focal length at which the object just fits into a render."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = 0.5 * (low + high).astype(np.float64)
    object_from_cam = viewpoint_transform(middle, azimuth_rad, elevation_rad, distance_m, roll_rad)
    points = (mesh.vertices - object_from_cam[:3, 3]) @ object_from_cam[:3, :3]
    reach = np.abs(points[:, :2] / np.maximum(points[:, 2:], 1e-3)).max()
    return float(0.5 * FILL * size_px / reach)


def view_digest(model: ObjectModel, settings: ViewSettings) -> str:
    """Names all that a model's cutouts depend on."""
    mesh = model.mesh
    sha = hashlib.sha256()
    arrays: list[NDArray[np.generic] | None] = [
        mesh.vertices, mesh.faces, mesh.corner_uvs, mesh.texture, mesh.face_surface,
        mesh.corner_normals,
    ]  # fmt: skip
    for array in arrays:
        sha.update(b"-" if array is None else f"{array.shape}{array.dtype}".encode())
        sha.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    chosen = asdict(settings)
    if settings.renderer == "embree":
        del chosen["renderer"]  # keys from when there was no choice stay good
    else:
        chosen["renderer_version"] = blender.VERSION
    if settings.first_is_center:
        del chosen["first_is_center"]
    rest = [VERSION, chosen, [asdict(s) for s in mesh.surfaces], model.name, model.symmetry]
    if model.instance:
        rest.append(model.instance)
    sha.update(json.dumps(rest, sort_keys=True).encode())
    return sha.hexdigest()[:16]


def _cutouts_of(
    model: ObjectModel, views: Sequence[View], renderer: ViewRenderer
) -> Iterator[Cutout]:
    for view, picture in zip(views, render_views(model, views, renderer), strict=True):
        cropped = crop_to_object(picture)
        if cropped is None:
            raise ConfigError(
                f"{model.name}: nothing of it is to be seen from azimuth {view.azimuth_rad:.2f}."
            )
        yield Cutout(cropped, view.azimuth_rad, view.elevation_rad)


def _render_to(stem: Path, model: ObjectModel, settings: ViewSettings) -> None:
    cutouts = render_cutouts(model, settings)
    write_cutouts(stem, model.name, model.instance_name, model.symmetry, cutouts)


def _radius_m(mesh: TexturedMesh) -> float:
    return 0.5 * float(np.linalg.norm(mesh.extent_m))


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in name)
