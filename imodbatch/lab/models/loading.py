"""A file or folder → an `ObjectModel` whose frame and size are as the rest expects them."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from imodbatch.core.errors import DataError
from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.mesh import ObjectModel, Surface, TexturedMesh
from imodbatch.lab.models.atlas import make_atlas
from imodbatch.lab.models.gazebo import is_gazebo_model, read_gazebo_parts
from imodbatch.lab.models.normals import corner_normals, weld
from imodbatch.lab.models.parts import MESH_SUFFIXES, Part, read_parts

LARGEST_M = 5.0
SMALLEST_M = 0.005


def load_model(
    path: Path | str,
    name: str | None = None,
    *,
    up: Literal["x", "y", "z"] | None = None,
    unit_m: float | None = None,
    symmetry: Symmetry = "none",
) -> ObjectModel:
    """One object from a Gazebo model folder or a mesh file (GLB, OBJ, DAE, PLY, STL).

    Args:
        path: of the folder or file.
        name: the class's name; by default the folder's or file's.
        up: the axis that is up in a mesh file; None = what the file says (DAE), or its format
            (GLB: y), else z.
        unit_m: metres per unit of a mesh file; None = what the file says (DAE), else 1.
        symmetry: how it looks from different azimuths.

    Raises:
        DataError: a file is missing or damaged, has no faces, or has an absurd size.
    """
    path = Path(path)
    if is_gazebo_model(path):
        parts = read_gazebo_parts(path)
    elif path.is_dir():
        parts = read_parts(_only_mesh(path), up, unit_m)
    else:
        parts = read_parts(path, up, unit_m)
    mesh = _merge(parts)
    size_m = float(mesh.extent_m.max())
    if not SMALLEST_M <= size_m <= LARGEST_M:
        raise DataError(
            f"{path}: the object is {size_m:.4g} m long, expected {SMALLEST_M} to {LARGEST_M:g} m. "
            "Is its unit another than the metre (millimetres: unit_m = 0.001)?"
        )
    return ObjectModel(name or (path.name if path.is_dir() else path.stem), mesh, symmetry)


def load_models(folder: Path | str) -> list[ObjectModel]:
    """All objects of a folder of Gazebo models, of mesh files or of folders with one each.

    A folder that holds none itself but whose entries are models is a class, and they are its
    objects: ``MODELS/coffee_mug/red/mug.obj``.

    Raises:
        DataError: there are none, two have the same name, or one cannot be loaded.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder of object models. Correct the path.")
    models = [model for path in sorted(folder.iterdir()) for model in _models_at(path)]
    if not models:
        raise DataError(
            f"{folder}: no object models. Expected Gazebo model folders or files with one of the "
            f"endings {', '.join(MESH_SUFFIXES)}."
        )
    names = [model.instance_name for model in models]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(f"{folder}: two object models are called {twice[0]!r}. Rename one.")
    return models


def _models_at(path: Path) -> list[ObjectModel]:
    """The model that a path is, or the objects of the class that it is; neither = none."""
    if _is_model(path):
        return [load_model(path)]
    if not path.is_dir():
        return []
    return [
        replace(load_model(inner, path.name), instance=f"{path.name}_{inner.stem}")
        for inner in sorted(path.iterdir())
        if _is_model(inner)
    ]


def _is_model(path: Path) -> bool:
    if path.is_dir():
        return is_gazebo_model(path) or bool(_meshes(path))
    return path.suffix.lower() in MESH_SUFFIXES


def _meshes(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.iterdir()) if p.suffix.lower() in MESH_SUFFIXES]


def _only_mesh(folder: Path) -> Path:
    """The mesh of a folder that holds exactly one."""
    found = _meshes(folder)
    if len(found) != 1:
        raise DataError(
            f"{folder}: expected a Gazebo model (model.config) or one mesh file, found "
            f"{len(found)} mesh files. Name the file."
        )
    return found[0]


def _merge(parts: list[Part]) -> TexturedMesh:
    """All parts as one mesh that stands on z = 0, its footprint centred."""
    images = {id(part.texture): part.texture for part in parts}
    number = {key: i for i, key in enumerate(images)}
    atlas = make_atlas(list(images.values()))
    corners = np.concatenate([part.corners for part in parts])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    corners -= [*(0.5 * (low + high))[:2], low[2]]
    vertices, corner = weld(corners.reshape(-1, 3))
    faces = corner.reshape(-1, 3)
    surfaces: dict[tuple[float, float], int] = {}
    face_surface = [
        np.full(
            len(part.corners),
            surfaces.setdefault((part.surface.specular, part.surface.shininess), len(surfaces)),
            np.int16,
        )
        for part in parts
    ]
    return TexturedMesh(
        vertices=vertices.astype(np.float32),
        faces=faces,
        corner_uvs=np.concatenate([atlas.move(number[id(p.texture)], p.uvs) for p in parts]),
        texture=atlas.texture,
        face_surface=np.concatenate(face_surface),
        surfaces=tuple(Surface(*shine) for shine in surfaces),
        corner_normals=corner_normals(vertices, faces),
    )
