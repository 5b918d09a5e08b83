"""Gazebo model folders: model.config → sdf → visuals.

Gazebo heeds a Collada file's unit but not its up axis (gazebo-classic issue 1305), and the models
made for it rely on that.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError
from imodbatch.core.frames import make_transform
from imodbatch.lab.models.parts import Part, read_parts

Element = ElementTree.Element


def is_gazebo_model(folder: Path) -> bool:
    """Whether a folder is laid out as a Gazebo model."""
    return folder.is_dir() and (
        (folder / "model.config").is_file() or any(folder.glob("model*.sdf"))
    )


def read_gazebo_parts(folder: Path) -> list[Part]:
    """The triangles of all visuals of a model, in metres, z up.

    Raises:
        DataError: a file is missing or damaged, or nothing is visible.
    """
    sdf = _sdf_path(folder)
    parts = []
    for link in _parse(sdf).iter("link"):
        for visual in link.findall("visual"):
            model_from_visual = _pose(link, sdf) @ _pose(visual, sdf)
            visible = _visual_parts(visual, folder, sdf)
            parts += [part.moved(model_from_visual) for part in visible]
    if not parts:
        raise DataError(f"{sdf}: no visual with a mesh, box, cylinder or sphere; nothing to draw.")
    return parts


def _sdf_path(folder: Path) -> Path:
    """The sdf that model.config names, its newest version; without it, the last model*.sdf."""
    config = folder / "model.config"
    if not config.is_file():
        found = sorted(folder.glob("model*.sdf"))
        if not found:
            raise DataError(f"{folder}: neither model.config nor model*.sdf; no Gazebo model.")
        return found[-1]
    names = [
        (element.get("version", "0"), (element.text or "").strip())
        for element in _parse(config).iter("sdf")
    ]
    if not names:
        raise DataError(f"{config}: names no <sdf>. Add the name of the model's sdf file.")
    newest = max(names, key=lambda item: [int(n) for n in item[0].split(".") if n.isdigit()])
    path = folder / newest[1]
    if not path.is_file():
        raise DataError(f"{config}: names {newest[1]!r}, which is not in the folder. Restore it.")
    return path


def _visual_parts(visual: Element, folder: Path, sdf: Path) -> list[Part]:
    """What one visual shows, in its own frame."""
    import trimesh

    geometry = visual.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return []
    if shape.tag == "mesh":
        scale = _numbers(shape.findtext("scale", "1 1 1"), 3, sdf)
        path = _resolve(shape.findtext("uri", "").strip(), folder)
        matrix = np.diag([*scale, 1.0])
        parts = [part.moved(matrix) for part in read_parts(path, up="z")]
    else:
        if shape.tag == "box":
            mesh = trimesh.creation.box(_numbers(shape.findtext("size", "1 1 1"), 3, sdf))
        elif shape.tag == "cylinder":
            radius, height = (float(shape.findtext(tag, "1")) for tag in ("radius", "length"))
            mesh = trimesh.creation.cylinder(radius, height)
        elif shape.tag == "sphere":
            mesh = trimesh.creation.icosphere(3, float(shape.findtext("radius", "1")))
        else:
            return []
        corners = np.asarray(mesh.vertices)[mesh.faces]
        blank = np.zeros((len(corners), 3, 2), np.float32)
        parts = [Part(corners, blank, np.full((4, 4, 3), 160, np.uint8), is_plain=True)]
    diffuse = visual.findtext("material/diffuse")
    if diffuse is None:
        return parts
    red, green, blue = (round(255 * v) for v in _numbers(diffuse, None, sdf)[:3])
    return [part.painted((red, green, blue)) if part.is_plain else part for part in parts]


def _resolve(uri: str, folder: Path) -> Path:
    """The file that a uri means: in this model, in one beside it, or relative to this one."""
    if not uri.startswith("model://"):
        return folder / uri.removeprefix("file://")
    model, _, rest = uri.removeprefix("model://").partition("/")
    beside = folder.parent / model / rest
    # A folder that was renamed still calls itself by its old name.
    return beside if beside.is_file() else folder / rest


def _pose(element: Element, sdf: Path) -> NDArray[np.float64]:
    """``parent_from_element`` (4, 4) of x y z roll pitch yaw, turned about fixed axes."""
    x, y, z, roll, pitch, yaw = _numbers(element.findtext("pose", "0 0 0 0 0 0"), 6, sdf)
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    rotation = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return make_transform(rotation, [x, y, z])


def _numbers(text: str, count: int | None, where: Path) -> list[float]:
    """Numbers with blanks between them."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if not numbers or (count is not None and len(numbers) != count):
        raise DataError(f"{where}: expected {count or 'some'} numbers, found {text!r}. Correct it.")
    return numbers


def _parse(path: Path) -> Element:
    try:
        return ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise DataError(f"{path}: not readable as XML ({error}). Restore it.") from None
