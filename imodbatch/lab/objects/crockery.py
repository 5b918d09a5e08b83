"""Bowls, a dish and a cup, all hollow. Lengths are centimetres."""

import numpy as np

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.curves import profile, rounded_rectangle
from imodbatch.lab.objects.finishes import GLAZE
from imodbatch.lab.objects.paint import Colour, Sketch, plain
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.objects.primitives import Strip, lathe, tube

PORCELAIN = (240, 238, 230)
INDIGO = (38, 58, 120)


def rice_bowl() -> ObjectModel:
    """A porcelain bowl on a foot, with a band of 16 blue flowers; 11.6 cm across.

    It looks the same after each turn by a sixteenth, which is finer than any grid of views used.
    """
    outer = profile([(2.5, 0.8), (3.9, 1.6), (5.1, 3.4), (5.75, 6.0)], 14)
    inner = profile([(5.55, 6.0), (4.9, 3.5), (3.7, 1.9), (2.0, 1.3), (0.0, 1.2)], 16)
    white = plain(PORCELAIN)
    bowl = lathe(
        [
            Strip([(0, 0.5), (2.1, 0.5), (2.2, 0.05), (2.3, 0), (2.4, 0.05), outer[0]], white),
            Strip(outer, _flower_band()),
            Strip([outer[-1], (5.75, 6.1), (5.65, 6.15), (5.55, 6.1), inner[0]], plain(INDIGO)),
            Strip(inner, _inside_line()),
        ],
        GLAZE,
    )
    return assemble("rice_bowl", [bowl], "full")


def _flower_band() -> Picture:
    """Sixteen flowers between lines, over a ring of petals round the foot."""
    n, step = 16, 28
    band = Sketch(n * step, 88, PORCELAIN)
    for y, width in ((7, 3), (60, 2), (65, 1.2)):
        band.line([(0, y), (n * step, y)], INDIGO, width)
    # Copies beyond both edges keep the seam at the back invisible.
    for k in range(-1, n + 1):
        x = (k + 0.5) * step
        for angle in np.arange(5) * 2 * np.pi / 5:
            band.ellipse(x + 5.5 * np.sin(angle), 34 - 5.5 * np.cos(angle), 4.4, 4.4, INDIGO)
        band.ellipse(x, 34, 2.6, 2.6, (214, 150, 60))
        band.line([(x - 14, 20), (x, 51), (x + 14, 20)], (96, 124, 180), 1.6)
        band.polygon([(x - 12, 88), (x, 69), (x + 12, 88)], (70, 98, 164))
    return band.picture()


def _inside_line() -> Picture:
    """White, with a blue line under the rim."""
    inside = Sketch(16, 96, PORCELAIN)
    inside.box(0, 5, 16, 8, INDIGO)
    return inside.picture()


def square_bowl() -> ObjectModel:
    """A deep square bowl with round corners, dark outside and celadon inside; 11 cm wide."""
    outer = profile([(3.6, 0.6), (4.5, 1.3), (5.0, 3.4), (5.4, 6.4)], 14)
    inner = profile([(5.1, 6.4), (4.65, 3.4), (4.1, 1.6), (2.8, 1.0), (0.0, 0.95)], 18)
    clay = plain((66, 60, 62))
    bowl = lathe(
        [
            Strip([(0, 0.3), (3.1, 0.3), (3.2, 0.05), (3.4, 0.0), (3.5, 0.1), outer[0]], clay),
            Strip(outer, _dripping_glaze()),
            Strip(
                [outer[-1], (5.38, 6.52), (5.25, 6.56), (5.12, 6.52), inner[0]],
                plain((150, 104, 62)),
            ),
            Strip(inner, _pooled_glaze()),
        ],
        GLAZE,
        rounded_rectangle(lambda r: 0.36 * r, n_arc=9, n_side=10),
    )
    return assemble("square_bowl", [bowl], 4)


def _dripping_glaze() -> Picture:
    """Four times the same: a pale glaze that ends in a wavy edge over dark clay."""
    wall = Sketch(256, 72, (72, 66, 70))
    x = np.linspace(0, 256, 129)
    edge = 24 + 5 * np.cos(x * 2 * np.pi / 64) + 3 * np.cos(x * 2 * np.pi / 32 + 1)
    wall.polygon([(0, 0), *zip(x, edge, strict=True), (256, 0)], (116, 158, 146))
    return wall.picture()


def _pooled_glaze() -> Picture:
    """Pale at the rim, deeper where glaze has gathered at the foot of the wall."""
    t = np.linspace(0, 1, 64)[:, None, None]
    rim, pool, floor = np.array([(156, 190, 170), (96, 152, 138), (130, 176, 160)], dtype=float)
    depth = rim + (pool - rim) * np.clip(t / 0.55, 0, 1) ** 2
    depth = depth + (floor - pool) * np.clip((t - 0.55) / 0.3, 0, 1)
    return np.broadcast_to(depth, (64, 4, 3)).astype(np.uint8)


def square_dish() -> ObjectModel:
    """A shallow square plate with a spray of plum blossom painted in a corner; 16 cm wide."""
    outer = profile([(5.2, 0.4), (6.6, 0.7), (7.5, 1.4), (7.95, 2.1)], 12)
    inner = profile([(7.75, 2.15), (7.3, 1.6), (6.5, 1.0), (5.2, 0.8)], 12)
    grey = plain((206, 208, 204))
    dish = lathe(
        [
            Strip([(0, 0.25), (4.7, 0.25), (4.8, 0), (5.1, 0), outer[0]], grey),
            Strip(outer, grey),
            Strip([outer[-1], (7.92, 2.22), (7.84, 2.24), inner[0]], plain((120, 84, 52))),
            Strip([*inner, (2.5, 0.75), (0.0, 0.75)], _plum_blossom(), "top"),
        ],
        GLAZE,
        rounded_rectangle(lambda r: 0.2 * r, n_arc=9, n_side=10),
    )
    return assemble("square_dish", [dish])


def _plum_blossom() -> Picture:
    """A branch from a corner with red blossoms and a bird's worth of empty space."""
    plate = Sketch(240, 240, (236, 236, 228))
    bark = (70, 50, 40)
    plate.line([(12, 205), (60, 172), (96, 150), (140, 96), (176, 78)], bark, 6)
    plate.line([(96, 150), (150, 146), (196, 126)], bark, 4)
    plate.line([(60, 172), (70, 122), (92, 84)], bark, 4)
    for x, y, size in (
        (176, 76, 11), (140, 94, 9), (196, 126, 10), (152, 147, 8),
        (92, 82, 11), (70, 124, 8), (104, 148, 9), (44, 184, 8),
    ):  # fmt: skip
        for angle in np.arange(5) * 2 * np.pi / 5:
            dx, dy = size * 0.75 * np.sin(angle), -size * 0.75 * np.cos(angle)
            plate.ellipse(x + dx, y + dy, size * 0.62, size * 0.62, (200, 48, 62))
        plate.ellipse(x, y, size * 0.36, size * 0.36, (246, 214, 110))
    plate.line([(8, 8), (232, 8), (232, 232), (8, 232), (8, 8)], (58, 88, 140), 3)
    return plate.picture()


def teacup() -> ObjectModel:
    """A white cup with its handle on the left (+y) and a printed rose in front; 8.4 cm across."""
    outer = profile([(2.3, 0.5), (3.2, 1.3), (3.75, 3.4), (4.15, 6.6)], 16)
    inner = profile([(3.9, 6.6), (3.5, 3.5), (2.8, 1.4), (1.6, 0.9), (0.0, 0.85)], 18)
    white = (246, 243, 236)
    gold = plain((198, 160, 84))
    cup = lathe(
        [
            Strip([(0, 0.3), (2.0, 0.3), (2.1, 0), (2.3, 0), (2.36, 0.2), outer[0]], plain(white)),
            Strip(outer, _rose_print(white)),
            Strip([outer[-1], (4.13, 6.7), (4.02, 6.75), (3.92, 6.7), inner[0]], gold),
            Strip(inner, plain((242, 239, 231))),
        ],
        GLAZE,
    )
    path = (
        (0, 4.3, 5.6),
        (0, 5.2, 5.9),
        (0, 6.2, 4.9),
        (0, 5.9, 3.2),
        (0, 4.8, 2.3),
        (0, 3.75, 2.0),
    )
    radii = (0.42, 0.42, 0.42, 0.4, 0.38, 0.36)
    # A flattened tube, whose round ends stop short of the inside.
    handle = tube(path, radii, plain(white), GLAZE, 18, 32).scaled(x=1.25)
    return assemble("teacup", [cup, handle])


def _rose_print(white: Colour) -> Picture:
    """A rose with leaves in front, a bud at the back, and a thin line under the rim."""
    wall = Sketch(320, 88, white)
    wall.box(0, 6, 320, 7.5, (198, 160, 84))
    green, rose = (92, 140, 88), (214, 98, 120)
    for x, y, size in ((160, 47, 16), (0, 50, 8), (320, 50, 8)):
        wall.line([(x - 2.6 * size, y + 1.3 * size), (x, y), (x + 2.4 * size, y + size)], green, 2)
        wall.ellipse(x - 1.7 * size, y + 0.6 * size, size * 0.8, size * 0.42, green)
        wall.ellipse(x + 1.6 * size, y + 0.2 * size, size * 0.8, size * 0.42, green)
        wall.ellipse(x, y, size, size * 0.95, rose)
        wall.ellipse(x - 0.1 * size, y - 0.1 * size, size * 0.68, size * 0.62, (232, 138, 152))
        wall.arc(x, y, 0.5 * size, 0.45 * size, (30, 300), (176, 62, 90), 1.8)
    return wall.picture()
