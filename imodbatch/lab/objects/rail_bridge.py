"""The bridge of a wooden railway: a hump with an arch below, between two sheets of points.

A half turn leaves it as it was, painting and grain included. Lengths are centimetres.
"""

import numpy as np

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.finishes import PAINTED_WOOD, WOOD
from imodbatch.lab.objects.paint import BEECH, Sketch, plain, wood
from imodbatch.lab.objects.part import Array, Picture
from imodbatch.lab.objects.primitives import ellipsoid, rounded_box, sandwich

HALF_LENGTH, ARCH_RADIUS, DECK_HEIGHT = 10.5, 4.4, 6.46


def rail_bridge() -> ObjectModel:
    """A bridge of a wooden railway: an arch to the front, two grooves for wheels on its hump."""
    beech = wood(*BEECH, 200, 64, 71, 7)
    deck = sandwich(*_deck(), beech, WOOD, crease_deg=50).turned(z_deg=90)
    stone = _stones()
    parts = [box_mapped(deck, beech, front=stone, back=stone, top=_tracks(beech))]
    for y in (-2.35, 2.35):
        rail = sandwich(*_parapet(y), plain((200, 44, 38)), PAINTED_WOOD, crease_deg=50)
        parts.append(rail.turned(z_deg=90))
    for x, y in [(x, y) for x in (-2.35, 2.35) for y in (-7.6, 7.6)]:
        post = rounded_box((0.9, 0.9, 5.6), 0.2, plain((48, 98, 180)), PAINTED_WOOD)
        parts.append(post.moved(x, y, 2.8))
        parts.append(
            ellipsoid((0.55,) * 3, plain((246, 200, 60)), PAINTED_WOOD, 12).moved(x, y, 5.9)
        )
    return assemble("rail_bridge", parts, 2)


def _hump(x: Array) -> Array:
    """Height of the track at a place along the bridge."""
    return np.asarray(1.3 + 2.55 * (1 + np.cos(np.pi * x / HALF_LENGTH)))


def _deck() -> tuple[Array, Array]:
    """Upper and lower sheet of the bridge, which lies along x."""
    inside = ARCH_RADIUS * np.cos(np.linspace(np.pi, 0, 25))
    outside = np.linspace(ARCH_RADIUS, HALF_LENGTH, 17)[1:]
    x = np.concatenate([-outside[::-1], inside, outside])
    groove = ((-2.1, 0), (-1.95, 0.06), (-1.3, 0.06), (-1.25, -0.24), (-0.7, -0.24), (-0.65, 0.06))
    across = [*groove, (0, 0.06), *((-y, dz) for y, dz in groove[::-1])]
    y, dz = np.array(across).T
    arch = np.sqrt(np.maximum(ARCH_RADIUS**2 - x**2, 0)) * (np.abs(x) < ARCH_RADIUS - 1e-6)
    return _sheet(x, y, _hump(x)[:, None] + dz), _sheet(x, y, arch[:, None] + 0 * dz)


def _parapet(middle: float) -> tuple[Array, Array]:
    """Upper and lower sheet of a wall along one side of the track."""
    x = np.linspace(-7.6, 7.6, 33)
    y = middle + np.array([-0.28, -0.2, 0.2, 0.28])
    top = _hump(x)[:, None] + np.array([0.85, 0.95, 0.95, 0.85])
    return _sheet(x, y, top), _sheet(x, y, _hump(x)[:, None] - 0.5 + 0 * y)


def _sheet(x: Array, y: Array, z: Array) -> Array:
    """Points (m, n, 3) over a grid."""
    return np.stack(np.broadcast_arrays(x[:, None], y[None], z), axis=-1)


def _stones() -> Picture:
    """The side of the bridge: rows of stones, and wedges round the arch.

    Both sides show it as seen from outside, so that a half turn leaves the bridge as it was.
    """
    scale = 13.0
    width, height = round(2 * HALF_LENGTH * scale), round(DECK_HEIGHT * scale)
    grey, joint = (176, 170, 160), (112, 104, 98)
    side = Sketch(width, height, grey)
    row_px = 11
    for row in range(height // row_px + 1):
        y = height - row * row_px
        side.line([(0, y), (width, y)], joint, 1.6)
        for column in range(-1, width // 22 + 1):
            x = column * 22 + 11 * (row % 2)
            side.line([(x, y), (x, y - row_px)], joint, 1.6)
    centre, radius = (width / 2, height), ARCH_RADIUS * scale
    side.ellipse(*centre, radius + 13, radius + 13, (206, 176, 132))
    for angle in np.linspace(0, np.pi, 14):
        dx, dy = np.cos(angle), -np.sin(angle)
        ends = [(centre[0] + r * dx, centre[1] + r * dy) for r in (radius - 3, radius + 13)]
        side.line(ends, joint, 1.8)
    return side.picture()


def _tracks(ground: Picture) -> Picture:
    """The deck from above: wood, darker in the grooves; the bridge lies along the columns."""
    # The mean with its own half turn keeps the bridge two-fold.
    turned = ground[::-1, ::-1]
    grain = (ground.astype(np.int64) + turned) // 2
    deck = Sketch(200, 48, grain.astype(np.uint8))
    for y in (0.975, -0.975):
        middle = 24 + y * 48 / 4.2
        deck.box(0, middle - 3.6, 200, middle + 3.6, (168, 124, 80))
    return deck.picture()
