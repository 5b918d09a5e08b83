"""A cellphone that lies on its back. Lengths are centimetres."""

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.curves import rounded_rectangle
from imodbatch.lab.objects.finishes import GLASS, PLASTIC, STEEL
from imodbatch.lab.objects.paint import Colour, Sketch, plain
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.objects.primitives import Strip, lathe, rounded_box

HALF_WIDTH, LONGER_BY, CORNER = 3.6, 3.7, 0.95
BUMP = 0.12
"""How far the camera sticks out below."""
THICKNESS = 0.78
APPS: tuple[Colour, ...] = (
    (70, 190, 110), (250, 130, 60), (60, 200, 210), (180, 100, 220),
    (236, 86, 74), (250, 250, 250), (120, 120, 130), (80, 100, 200),
    (250, 190, 60), (240, 100, 160), (70, 140, 240), (90, 210, 90),
)  # fmt: skip


def cellphone() -> ObjectModel:
    """A phone of 14.6 × 7.2 cm, its screen up, to be read from the front; keys on both sides."""
    frame, back = plain((60, 62, 68)), plain((36, 40, 52))
    outline = rounded_rectangle(lambda r: CORNER - HALF_WIDTH + r, LONGER_BY, n_arc=14, n_side=12)
    low, high, r = BUMP, BUMP + THICKNESS, HALF_WIDTH
    edge = [(r - 0.25, low), (r - 0.1, low + 0.04), (r - 0.02, low + 0.14), (r, low + 0.24)]
    glass = [(1.8, high + 0.01), (0, high + 0.01)]
    body = lathe(
        [
            Strip([(0, low), (1.8, low), edge[0]], back),
            Strip(
                [*edge, *((radius, low + high - z) for radius, z in edge[:0:-1]), (r - 0.16, high)],
                frame,
            ),
            Strip([(r - 0.16, high), (r - 0.3, high + 0.01), *glass], _screen(), "top"),
        ],
        GLASS,
        outline,
    )
    middle = (low + high) / 2
    keys = [
        rounded_box((1.3, 0.12, 0.26), 0.05, plain((120, 122, 128)), STEEL).moved(x, y, middle)
        for x, y in ((-2.6, 3.62), (-3.4, -3.62), (-1.8, -3.62))
    ]
    lens = rounded_box((1.9, 1.9, 2 * BUMP), 0.1, plain((20, 20, 24)), PLASTIC)
    return assemble("cellphone", [body, *keys, lens.moved(-5.8, -2.2, BUMP)])


def _screen() -> Picture:
    """A home screen seen from above, its foot towards the front."""
    width, height = 168, 352
    screen = Sketch(width, height, (10, 10, 12))
    for row in range(8, height - 8):
        t = row / height
        colour = (round(20 + 50 * t), round(34 + 30 * (1 - t)), round(84 + 50 * (1 - t)))
        screen.box(8, row, width - 8, row + 1, colour)
    screen.box(58, 8, 110, 18, (10, 10, 12), 5)
    screen.text(30, 17, "9:41", 11, (240, 240, 240))
    screen.box(132, 13, 148, 20, (240, 240, 240), 2)
    screen.text(84, 62, "9:41", 44, (245, 245, 248))
    screen.text(84, 96, "Monday 12", 14, (210, 216, 230))
    for index, colour in enumerate(APPS):
        x, y = 34 + 33.5 * (index % 4), 140 + 42 * (index // 4)
        screen.box(x - 12, y - 12, x + 12, y + 12, colour, 6)
        screen.ellipse(x, y, 5, 5, (250, 250, 250) if index % 2 else (40, 44, 60))
    screen.box(14, 296, width - 14, 338, (150, 160, 190), 12)
    for index, colour in enumerate(((60, 200, 90), (60, 130, 240), (245, 245, 245), (240, 90, 80))):
        x = 34 + 33.5 * index
        screen.box(x - 12, 305, x + 12, 329, colour, 6)
    screen.box(58, 341, 110, 343, (230, 230, 230), 1)
    return screen.picture()
