"""The ball and the bricks. Lengths are centimetres."""

import numpy as np

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.curves import circle
from imodbatch.lab.objects.finishes import FOAM, PLASTIC
from imodbatch.lab.objects.paint import Colour, plain, speckled
from imodbatch.lab.objects.part import Part
from imodbatch.lab.objects.primitives import Strip, ellipsoid, lathe, rounded_box


def ball_pink() -> ObjectModel:
    """A soft ball of foam, 7 cm across."""
    # The same 16 times round, finer than any grid of views used: no azimuth stands out.
    sector = speckled(np.full((160, 20, 3), (238, 118, 160), np.uint8), 51, 0.025)
    foam = np.tile(sector, (1, 16, 1))
    return assemble("ball_pink", [ellipsoid((3.5, 3.5, 3.5), foam, FOAM, 64)], "full")


def lego_green() -> ObjectModel:
    """A green brick for small hands."""
    return assemble("lego_green", _brick((34, 140, 66)), 2)


def lego_red() -> ObjectModel:
    """A red brick for small hands."""
    return assemble("lego_red", _brick((200, 32, 34)), 2)


def _brick(colour: Colour) -> list[Part]:
    """A brick of 2 × 4 studs, its long side to the front; 6.36 × 3.16 × 2.4 cm with studs."""
    plastic, shadow = plain(colour), plain((colour[0] // 2, colour[1] // 2, colour[2] // 2))
    body = rounded_box((3.16, 6.36, 1.92), 0.08, plastic, PLASTIC)
    # A stud is a short pipe.
    wall = [(0.33, 0.9), (0.33, 1.4), (0.36, 1.44), (0.43, 1.44), (0.47, 1.4), (0.47, 0.9)]
    hollow = [(0.33, 0.9), (0.33, 1.02), (0.0, 1.02)]
    stud = lathe(
        [
            Strip([(0.0, 0.9), wall[-1]], plastic),
            Strip(wall[1:][::-1], plastic),
            Strip([wall[1], hollow[1]], shadow),
            Strip(hollow[1:], shadow),
        ],
        PLASTIC,
        circle(24),
    )
    places = [(x, y) for x in (-0.8, 0.8) for y in (-2.4, -0.8, 0.8, 2.4)]
    return [body, *(stud.moved(x, y) for x, y in places)]
