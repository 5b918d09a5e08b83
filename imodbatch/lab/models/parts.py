"""What trimesh reads from a file, as triangles with a texture each."""

import warnings
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.frames import apply
from imodbatch.datasets.images import only_listed_formats
from imodbatch.lab.mesh import Surface
from imodbatch.lab.models.atlas import texture_of_corner_colors, unrepeat

GREY = (160, 160, 160)
MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".webp")
UP_ROTATIONS = {
    "x": np.array([[0.0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    "y": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "z": np.eye(4),
}
"""``z-up from`` each axis being up."""
PAPER = Surface()


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles with one texture.

    Attributes:
        corners: (F, 3, 3) metres.
        uvs: (F, 3, 2), all in 0..1, (0, 0) the texture's top-left corner.
        texture: (H, W, 3) uint8 sRGB.
        surface: how it shines.
        is_plain: whether the file gave it no colour at all.
    """

    corners: NDArray[np.float64]
    uvs: NDArray[np.float32]
    texture: NDArray[np.uint8]
    surface: Surface = PAPER
    is_plain: bool = False

    def moved(self, matrix: NDArray[np.float64]) -> "Part":
        """Under an affine transform (4, 4); a mirroring one turns the faces inside out again."""
        part = replace(self, corners=apply(matrix, self.corners))
        if np.linalg.det(matrix[:3, :3]) >= 0:
            return part
        return replace(part, corners=part.corners[:, ::-1], uvs=part.uvs[:, ::-1])

    def painted(self, color: tuple[int, int, int]) -> "Part":
        """The same in one colour."""
        texture, uvs = _plain(len(self.corners), color)
        return replace(self, texture=texture, uvs=uvs, is_plain=False)


def read_parts(path: Path, up: str | None = None, unit_m: float | None = None) -> list[Part]:
    """The triangles of a mesh file, in metres, z up.

    Args:
        path: of the file.
        up: the axis that is up in it; None = what the file or its format says, else z.
        unit_m: metres per unit; None = what the file says, else 1.

    Raises:
        DataError: it is missing, unreadable or has no faces.
        ConfigError: what reads models is not installed.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such mesh file. Restore it, or correct the path to it.")
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise DataError(f"{path}: expected one of {', '.join(MESH_SUFFIXES)}. Convert the model.")
    if find_spec("trimesh") is None or find_spec("collada") is None:
        raise ConfigError(f"{path}: models need more packages. pip install 'imodbatch[lab]'")
    import trimesh

    resolver: Any = _Asked(path)
    try:
        with only_listed_formats("TGA"):
            scene = trimesh.load_scene(
                str(path), file_type=path.suffix[1:].lower(), resolver=resolver, process=False
            )
        nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
        stated_up, stated_unit_m = _stated(path)
    except Exception as error:  # trimesh lets through whatever its parsers meet
        line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{path}: damaged mesh ({line}). Restore or re-export it.") from error
    upright = UP_ROTATIONS[up or stated_up] * np.array([*[unit_m or stated_unit_m] * 3, 1.0])
    parts = []
    for matrix, name in nodes:
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            parts.append(_part(geometry, path, resolver).moved(upright @ matrix))
    if not parts:
        raise DataError(f"{path}: no faces (a cloud of points?). Export it as a triangle mesh.")
    return parts


class _Asked:
    """Hands trimesh the files beside the mesh, and remembers which pictures it asked for."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent
        self.images: list[str] = []

    def get(self, name: str) -> bytes:
        """The bytes of a file beside the mesh."""
        clean = str(name).strip().replace("\\", "/").removeprefix("file://")
        if clean.lower().endswith(IMAGE_SUFFIXES):
            self.images.append(clean)
        return (self._folder / clean).read_bytes()

    def keys(self) -> list[str]:
        """Names of the files beside the mesh."""
        return [file.name for file in self._folder.iterdir() if file.is_file()]

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def __contains__(self, name: str) -> bool:
        return (self._folder / name).is_file()


def _stated(path: Path) -> tuple[str, float]:
    """The up axis and unit that a file or its format states."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return "y", 1.0
    if suffix != ".dae":
        return "z", 1.0
    up, unit_m = "y", 1.0
    for _, element in ElementTree.iterparse(path):
        tag = element.tag.rpartition("}")[2]
        if tag == "up_axis":
            up = (element.text or "").strip()[:1].lower() or "y"
        elif tag == "unit":
            unit_m = float(element.get("meter", 1.0))
        elif tag == "asset":
            break
    return up, unit_m


def _part(geometry: Any, path: Path, resolver: _Asked) -> Part:
    """One geometry of trimesh's."""
    corners = np.asarray(geometry.vertices, np.float64)[geometry.faces]
    visual = geometry.visual
    if getattr(visual, "kind", None) in ("vertex", "face"):
        by_face = visual.kind == "face"
        colors = np.asarray(visual.face_colors if by_face else visual.vertex_colors)[:, :3]
        corner_colors = np.repeat(colors[:, None], 3, 1) if by_face else colors[geometry.faces]
        texture, uvs = texture_of_corner_colors(corner_colors.astype(np.uint8))
        return Part(corners, uvs, texture)
    material = getattr(visual, "material", None)
    image, uv = _image(material), getattr(visual, "uv", None)
    color, is_plain = _main_color(material)
    if image is None or uv is None or not len(uv):
        if image is None and resolver.images:
            warnings.warn(
                f"{path}: its texture {resolver.images[-1]!r} cannot be read; drawn in one colour.",
                stacklevel=2,
            )
        texture, uvs = _plain(len(corners), color)
        return Part(corners, uvs, texture, _surface(material), is_plain)
    # trimesh's texture coordinates count from the bottom.
    corner_uvs = np.asarray(uv, np.float64)[geometry.faces] * [1, -1] + [0, 1]
    texture, uvs = unrepeat(image, np.nan_to_num(corner_uvs))
    return Part(corners, uvs, texture, _surface(material))


def _image(material: Any) -> NDArray[np.uint8] | None:
    """A material's picture (H, W, 3), tinted if it is meant to be."""
    image = getattr(material, "baseColorTexture", None)
    factor = getattr(material, "baseColorFactor", None) if image is not None else None
    image = image if image is not None else getattr(material, "image", None)
    if image is None:
        return None
    pixels = np.asarray(image.convert("RGB"), np.uint8)
    if factor is not None:
        tint = np.asarray(factor, np.float64)[:3] / 255
        # The factor is linear, the picture is not: its power 1/2.2 does for both.
        pixels = np.rint(pixels * tint ** (1 / 2.2)).astype(np.uint8)
    return pixels


def _main_color(material: Any) -> tuple[tuple[int, int, int], bool]:
    """A material's one colour, and whether it is only our stand-in."""
    color = getattr(material, "baseColorFactor", None)
    color = getattr(material, "diffuse", None) if color is None else color
    if color is None:
        return GREY, True
    red, green, blue = (int(value) for value in np.asarray(color)[:3])
    return (red, green, blue), False


def _surface(material: Any) -> Surface:
    """How a physically based material shines; of older ones little is to be believed."""
    roughness = getattr(material, "roughnessFactor", None)
    if roughness is None:
        return PAPER
    metallic = float(getattr(material, "metallicFactor", None) or 0.0)
    alpha = max(float(roughness), 0.15) ** 2
    return Surface(0.04 + 0.5 * metallic, float(np.clip(2 / alpha**2 - 2, 2, 300)))


def _plain(
    n_faces: int, color: tuple[int, int, int]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A texture of one colour and coordinates in it."""
    return np.full((4, 4, 3), color, np.uint8), np.full((n_faces, 3, 2), 0.5, np.float32)
