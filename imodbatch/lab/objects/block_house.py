"""The house of wooden blocks: every block is a box with round edges, painted on some sides.

Lengths are centimetres.
"""

import numpy as np

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.curves import rounded_polygon
from imodbatch.lab.objects.finishes import PAINTED_WOOD, WOOD
from imodbatch.lab.objects.paint import BEECH, Colour, Sketch, plain, wood
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import Strip, lathe, rounded_box


def building_block_house() -> ObjectModel:
    """A house built of painted wooden blocks: a door in front, other things on each side; 16 cm."""
    beech = wood(*BEECH, 96, 64, 61, 6)
    blue, yellow, green, red = (48, 98, 180), (244, 196, 58), (70, 150, 78), (206, 52, 46)
    blocks = [
        _block((6, 4, 6), (0, -4, 3), blue, front=_window(blue), right=_sun(blue)),
        _block((6, 4, 6), (0, 4, 3), yellow, front=_window(yellow), left=_heart(yellow)),
        box_mapped(rounded_box((6, 4, 6), 0.25, beech, WOOD), beech, front=_door(beech)).moved(z=3),
        rounded_box((6.2, 12.4, 1.0), 0.2, beech, WOOD).moved(z=6.5),
        _block((5.6, 3.6, 3.4), (0, -3.4, 8.7), green, front=_window(green)),
        _block((5.6, 3.6, 3.4), (0, 3.4, 8.7), red, front=_window(red), back=_heart(red)),
        box_mapped(
            rounded_box((5.6, 3.2, 3.4), 0.25, beech, WOOD), beech, front=_clock(beech)
        ).moved(z=8.7),
        _roof().moved(z=10.4),
        _block((1.6, 1.6, 3.0), (-1.2, 3.2, 14.2), (52, 60, 80)),
    ]
    return assemble("building_block_house", blocks)


def _block(
    size: tuple[float, float, float],
    at: tuple[float, float, float],
    colour: Colour,
    **sides: Picture,
) -> Part:
    """A painted block."""
    paint = plain(colour)
    block = rounded_box(size, 0.25, paint, PAINTED_WOOD)
    return box_mapped(block, paint, front_reach=1, **sides).moved(*at)


def _roof() -> Part:
    """A red prism along y with tiles painted on both slopes."""
    tiles = Sketch(120, 44, (192, 44, 40))
    for row in range(4):
        for column in range(-1, 10):
            x, y = column * 13.3 + 6.6 * (row % 2), row * 11
            tiles.arc(x + 6.6, y + 3, 6.6, 7, (0, 180), (128, 22, 24), 1.6)
    ends = [(0, -6.6), (0.95, -6.6), (1, -6.35), (1, 6.35), (0.95, 6.6), (0, 6.6)]
    # Drawn upright: turned about x to lie along y, the triangle's tip up.
    middle = rounded_polygon([(-3.7, -1.3), (3.7, -1.3), (0, 2.6)], 0.5)
    prism = lathe([Strip(ends, plain((192, 44, 40)))], PAINTED_WOOD, middle, crease_deg=35)
    lying = prism.turned(x_deg=90).moved(z=1.3)
    gable = Sketch(48, 28, (192, 44, 40))
    gable.ellipse(24, 18, 6, 6, (250, 236, 200))
    picture = tiles.picture()
    return box_mapped(
        lying, plain((192, 44, 40)), front=picture, back=picture, top=picture, left=gable.picture()
    )


def _window(ground: Colour) -> Picture:
    """A white window with a cross."""
    sketch = Sketch(56, 84, ground)
    sketch.box(12, 20, 44, 60, (250, 248, 240), 3)
    sketch.box(16, 24, 40, 56, (150, 206, 236))
    sketch.box(26.5, 22, 29.5, 58, (250, 248, 240))
    sketch.box(14, 38.5, 42, 41.5, (250, 248, 240))
    return sketch.picture()


def _door(ground: Picture) -> Picture:
    """An arched door with a knob."""
    sketch = Sketch(64, 96, ground)
    brown, dark = (140, 74, 38), (92, 44, 22)
    sketch.ellipse(32, 40, 22, 22, dark)
    sketch.box(10, 40, 54, 96, dark)
    sketch.ellipse(32, 40, 18.5, 18.5, brown)
    sketch.box(13.5, 40, 50.5, 96, brown)
    for x in (26, 38):
        sketch.line([(x, 24), (x, 95)], dark, 1.4)
    sketch.ellipse(45, 66, 3.2, 3.2, (246, 208, 70))
    return sketch.picture()


def _clock(ground: Picture) -> Picture:
    """A clock at ten past ten."""
    sketch = Sketch(60, 64, ground)
    sketch.ellipse(30, 32, 22, 22, (40, 44, 60))
    sketch.ellipse(30, 32, 18.5, 18.5, (252, 250, 244))
    for hour in range(12):
        angle = hour * np.pi / 6
        sketch.ellipse(30 + 15 * np.sin(angle), 32 - 15 * np.cos(angle), 1.2, 1.2, (40, 44, 60))
    sketch.line([(21.5, 27), (30, 32), (38, 22)], (40, 44, 60), 2.4)
    return sketch.picture()


def _sun(ground: Colour) -> Picture:
    """A sun with rays."""
    sketch = Sketch(64, 64, ground)
    for angle in np.arange(8) * np.pi / 4:
        dx, dy = np.cos(angle), np.sin(angle)
        sketch.line([(32 + 15 * dx, 32 + 15 * dy), (32 + 23 * dx, 32 + 23 * dy)], (250, 214, 70), 4)
    sketch.ellipse(32, 32, 12, 12, (250, 214, 70))
    return sketch.picture()


def _heart(ground: Colour) -> Picture:
    """A white heart."""
    t = np.linspace(0, 2 * np.pi, 60)
    x = 32 + 1.35 * 16 * np.sin(t) ** 3
    y = 30 - 1.35 * (13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t))
    sketch = Sketch(64, 64, ground)
    sketch.polygon(list(zip(x, y, strict=True)), (252, 246, 240))
    return sketch.picture()
