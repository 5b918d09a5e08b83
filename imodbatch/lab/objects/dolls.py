"""The plush dolls, sitting or standing, faces to the front. Lengths are centimetres."""

from collections.abc import Sequence

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.curves import profile
from imodbatch.lab.objects.finishes import GLASS, PLUSH
from imodbatch.lab.objects.paint import Colour, Sketch, furry, plain
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import Strip, ellipsoid, lathe, tube

BLACK = plain((18, 16, 16))
WHITE = plain((245, 243, 238))
Path = Sequence[tuple[float, float, float]]


def _plush(colour: Colour, seed: int, amount: float = 0.12) -> Picture:
    """Plush of one colour."""
    return furry(plain(colour, 96), seed, amount)


def _blob(
    radii: tuple[float, float, float], at: tuple[float, float, float], picture: Picture, n: int = 24
) -> Part:
    """A stuffed ellipsoid."""
    return box_mapped(ellipsoid(radii, picture, PLUSH, n), picture).moved(*at)


def _bead(radius: float, at: tuple[float, float, float], picture: Picture) -> Part:
    """A glossy eye or nose."""
    return ellipsoid((radius,) * 3, picture, GLASS, 14).moved(*at)


def gorilla_doll() -> ObjectModel:
    """A gorilla that sits with its arms hanging down and shows its soles; 17 cm tall."""
    coat = _plush((78, 58, 50), 11, 0.2)
    skin = _plush((176, 138, 108), 13, 0.06)
    chest = Sketch(128, 128, (78, 58, 50))
    chest.ellipse(64, 66, 40, 47, (164, 128, 102))
    torso = ellipsoid((3.7, 4.3, 5.2), coat, PLUSH)
    torso = box_mapped(torso, coat, front_reach=2, front=furry(chest.picture(), 15, 0.16))
    parts = [
        torso.moved(z=4.9),
        _blob((2.9, 4.9, 2.7), (-0.3, 0, 8.4), coat),
        *_gorilla_head(coat, skin),
    ]
    arm: Path = ((0, 4.2, 8.7), (1.2, 6.1, 6.0), (3.0, 5.9, 2.9), (4.2, 5.3, 1.5))
    leg: Path = ((0.5, 2.6, 2.0), (3.5, 3.2, 2.0), (5.6, 2.5, 1.9))
    for part in (
        tube(arm, (2.0, 1.9, 1.7, 1.5), coat, PLUSH),
        _blob((1.5, 1.2, 1.2), (4.9, 5.1, 1.2), skin),
        tube(leg, (2.0, 1.9, 1.6), coat, PLUSH),
        _blob((0.9, 1.5, 2.1), (6.9, 2.4, 2.1), skin),
        # Toes
        _blob((0.55, 0.5, 0.6), (7.1, 1.5, 4.0), skin, 12),
        _blob((0.55, 0.5, 0.6), (7.1, 2.4, 4.25), skin, 12),
        _blob((0.55, 0.5, 0.6), (7.1, 3.3, 4.0), skin, 12),
    ):
        parts += part.both_sides()
    return assemble("gorilla_doll", parts)


def _gorilla_head(coat: Picture, skin: Picture) -> list[Part]:
    """A high crown, a bare face under a heavy brow, and a broad muzzle."""
    colour = (176, 138, 108)
    mouth = Sketch(112, 80, colour)
    mouth.arc(56, 26, 34, 26, (25, 155), (58, 34, 28), 4)
    mouth.ellipse(45, 17, 6, 5, (40, 24, 20))
    mouth.ellipse(67, 17, 6, 5, (40, 24, 20))
    muzzle = ellipsoid((1.7, 2.1, 1.5), skin, PLUSH, 24)
    muzzle = box_mapped(muzzle, skin, front_reach=1.6, front=furry(mouth.picture(), 17, 0.05))
    parts = [
        _blob((3.2, 3.3, 3.3), (0.6, 0, 12.4), coat, 28),
        _blob((3.0, 2.5, 2.9), (-0.1, 0, 13.7), coat),
        _blob((1.4, 2.55, 2.2), (2.7, 0, 12.4), skin),
        muzzle.moved(3.7, 0, 11.2),
        tube(((2.9, -2.1, 13.6), (3.8, 0, 14.1), (2.9, 2.1, 13.6)), (0.6, 0.75, 0.6), coat, PLUSH),
    ]
    for part in (
        _bead(0.42, (3.85, 0.95, 13.05), BLACK),
        _bead(0.13, (4.2, 1.05, 13.2), WHITE),
        _blob((0.6, 0.9, 1.05), (0.6, 3.5, 12.6), coat, 16),
        _blob((0.45, 0.6, 0.7), (0.95, 3.6, 12.6), skin, 16),
    ):
        parts += part.both_sides()
    return parts


def mouse_doll() -> ObjectModel:
    """A grey mouse that sits up, with round ears, a pink nose and a tail round its side; 13 cm."""
    grey = (150, 150, 156)
    coat, pink = _plush(grey, 21), _plush((232, 160, 165), 23, 0.05)
    front = Sketch(128, 128, grey)
    front.ellipse(64, 72, 36, 44, (226, 222, 216))
    outline = profile([(0, 0), (3.0, 0.2), (3.9, 2.2), (3.1, 5.2), (1.8, 7.6), (0, 8.4)], 24)
    body = lathe([Strip(outline, coat)], PLUSH, crease_deg=180).scaled(x=0.95)
    body = box_mapped(body, coat, front_reach=1.6, front=furry(front.picture(), 25))
    tail: Path = (
        (-3.0, 0, 0.9),
        (-5.2, 0.4, 0.6),
        (-5.6, 3.2, 0.45),
        (-2.8, 5.4, 0.4),
        (0, 5.9, 0.4),
    )
    parts = [
        body,
        tube(tail, (0.55, 0.5, 0.45, 0.38, 0.25), pink, PLUSH, 12, 28),
        *_mouse_head(coat),
    ]
    arm: Path = ((0.9, 2.5, 5.6), (2.6, 2.6, 4.6), (3.6, 1.3, 4.7))
    for part in (
        tube(arm, (0.9, 0.8, 0.7), coat, PLUSH, 14),
        _blob((0.65, 0.65, 0.6), (4.1, 0.95, 4.8), pink, 14),
        _blob((2.0, 1.1, 0.8), (3.2, 2.0, 0.8), pink, 18),
    ):
        parts += part.both_sides()
    return assemble("mouse_doll", parts)


def _mouse_head(coat: Picture) -> list[Part]:
    """A pointed snout with whiskers, two teeth, and ears larger than anything else."""
    inner = Sketch(80, 80, (150, 150, 156))
    inner.ellipse(40, 42, 28, 28, (238, 168, 172))
    ear = ellipsoid((0.5, 2.1, 2.1), coat, PLUSH, 28)
    ear = box_mapped(ear, coat, front=furry(inner.picture(), 27, 0.07))
    snout: Path = ((0.6, 0, 9.0), (2.8, 0, 8.7), (4.3, 0, 8.5))
    parts = [
        _blob((2.9, 2.8, 2.6), (0.3, 0, 9.3), coat, 28),
        tube(snout, (2.4, 1.6, 0.8), coat, PLUSH),
        _bead(0.55, (5.15, 0, 8.65), plain((226, 92, 110))),
    ]
    for part in (
        ear.turned(z_deg=12).moved(-0.1, 2.75, 11.6),
        _bead(0.45, (2.45, 1.35, 10.1), BLACK),
        _bead(0.14, (2.83, 1.4, 10.3), WHITE),
        _blob((0.12, 0.22, 0.45), (4.2, 0.24, 7.5), WHITE, 10),
        *(
            tube(((4.3, 0.6, 8.4), (4.1, 2.9, 8.4 + rise)), (0.06, 0.04), BLACK, PLUSH, 6, 3)
            for rise in (-0.6, 0.1, 0.8)
        ),
    ):
        parts += part.both_sides()
    return parts


def kidney_beans_doll() -> ObjectModel:
    """A red kidney bean with a smiling face and little limbs, that stands; 15 cm tall."""
    red = (178, 36, 42)
    skin, dark = _plush(red, 31, 0.06), _plush((104, 26, 30), 33, 0.06)
    path: Path = (
        (0, 1.5, 3.9), (0, -0.1, 5.6), (0, -0.9, 8.2), (0, -0.1, 10.8), (0, 1.5, 12.4),
    )  # fmt: skip
    bean = tube(path, (2.7, 2.95, 2.8, 2.95, 2.7), skin, PLUSH, 40, 36).scaled(x=0.85)
    parts = [box_mapped(bean, skin, front_reach=1.5, front=furry(_bean_face(red), 35, 0.05))]
    leg: Path = ((0, 1.5, 2.4), (0, 1.8, 0.9))
    parts += [
        tube(leg, (0.7, 0.65), dark, PLUSH, 14, 6).moved(y=-1.9),
        tube(leg, (0.7, 0.65), dark, PLUSH, 14, 6).moved(y=0.9),
        _blob((1.5, 1.0, 0.75), (0.7, -0.1, 0.75), dark, 18),
        _blob((1.5, 1.0, 0.75), (0.7, 2.7, 0.75), dark, 18),
        tube(((0.3, 1.3, 8.6), (0.8, 3.2, 8.6), (1.2, 4.4, 9.8)), (0.6, 0.6, 0.7), dark, PLUSH, 14),
        # The pale scar in the hollow of a bean.
        _blob((0.85, 0.4, 1.3), (-0.1, 2.0, 6.9), _plush((236, 214, 190), 37, 0.05), 18),
        tube(
            ((0, -3.2, 7.4), (0.6, -4.6, 6.6), (1.2, -5.2, 5.2)), (0.6, 0.6, 0.7), dark, PLUSH, 14
        ),
    ]
    return assemble("kidney_beans_doll", parts)


def _bean_face(red: Colour) -> Picture:
    """Eyes, cheeks and a smile; the bean's back, convex, is on the picture's left."""
    face = Sketch(128, 192, red)
    for x in (42, 78):
        face.ellipse(x, 74, 12, 15, (250, 248, 244))
        face.ellipse(x + 1, 77, 7.5, 10, (24, 18, 18))
        face.ellipse(x + 4, 72, 2.5, 3, (250, 248, 244))
    face.arc(60, 98, 20, 17, (10, 170), (40, 8, 10), 4.5)
    face.ellipse(28, 100, 7, 6, (232, 110, 112))
    face.ellipse(91, 100, 7, 6, (232, 110, 112))
    return face.picture()
