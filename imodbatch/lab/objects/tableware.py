"""The plastic cup, the spoon, the can and the coaster. Lengths are centimetres."""

import numpy as np

from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.curves import arc, smooth
from imodbatch.lab.objects.finishes import LABEL, PLASTIC, STEEL, WOOD
from imodbatch.lab.objects.paint import Sketch, brushed, noise, plain, shaded, wood
from imodbatch.lab.objects.part import Array, Picture
from imodbatch.lab.objects.primitives import Strip, lathe, rounded_box, sandwich


def plastic_cup_yellow() -> ObjectModel:
    """A tapered cup with a rolled lip and three rings; 9.6 cm tall."""
    yellow = plain((248, 206, 36))
    wall = [(2.75, 0.25)]
    for middle in (6.6, 7.0, 7.4):
        wall += [
            (_cup_radius(middle + dz) + bulge, middle + dz)
            for dz, bulge in ((-0.2, 0), (-0.1, 0.07), (0.0, 0.1), (0.1, 0.07))
        ]
    wall += [(_cup_radius(z), z) for z in (7.6, 8.4, 9.25)]
    lip = arc((_cup_radius(9.4), 9.4), 0.2, -60, 180, 10)
    inner = [(_cup_radius(z) - 0.16, z) for z in (9.2, 8, 6, 4, 2, 0.7)]
    base = [(0, 0.2), (2.3, 0.2), (2.4, 0.02), (2.55, 0.0), (2.7, 0.08)]
    outside = Strip([*base, *wall, *lip, inner[0]], yellow)
    inside = Strip([*inner, (2.4, 0.45), (0, 0.45)], plain((232, 186, 24)))
    return assemble("plastic_cup_yellow", [lathe([outside, inside], PLASTIC)], "full")


def _cup_radius(height: float) -> float:
    """Outer radius of the cup's wall."""
    return 2.72 + 0.12 * height


def steel_juice() -> ObjectModel:
    """A small steel can of orange juice, fruit and text in front, small print behind; 10.4 cm."""
    steel = brushed((186, 188, 192), 64, 24, 81)
    bottom = [(0, 0.5), (1.8, 0.4), (2.2, 0.1), (2.35, 0), (2.5, 0.1), (2.65, 0.55)]
    neck = [(2.65, 9.65), (2.6, 9.85), (2.42, 10.1), (2.4, 10.2), (2.47, 10.3), (2.44, 10.4)]
    lid = [(2.32, 10.38), (2.26, 10.2), (2.2, 10.02), (2.05, 9.98), (1.95, 10.06), (0, 10.06)]
    can = lathe(
        [
            Strip(bottom, steel),
            Strip([bottom[-1], *((2.65, z) for z in np.linspace(0.55, 9.65, 9)[1:])], _label()),
            Strip(neck, steel),
            Strip([neck[-1], *lid], _lid(), "top"),
        ],
        LABEL,
    )
    tab = rounded_box((1.5, 0.8, 0.14), 0.06, plain((148, 150, 156)), STEEL).moved(x=0.35, z=10.16)
    return assemble("steel_juice", [can, tab])


def _label() -> Picture:
    """What is printed round the can; the middle is the front."""
    label = Sketch(360, 196, (246, 150, 40))
    green, cream = (36, 110, 60), (255, 246, 224)
    label.box(0, 0, 360, 16, green)
    label.box(0, 182, 360, 196, green)
    label.polygon([(106, 20), (254, 20), (240, 178), (120, 178)], cream)
    label.text(180, 42, "ORANGE", 30, (214, 74, 20))
    label.text(180, 68, "JUICE", 24, green)
    _orange_slice(label, 166, 120, 32)
    label.ellipse(206, 140, 22, 22, (250, 136, 18))
    label.ellipse(199, 132, 6, 5, (255, 186, 90))
    label.polygon([(206, 118), (228, 104), (236, 112), (220, 122)], green)
    label.text(180, 171, "100%", 15, green)
    # Behind: contents, bar code, mark.
    label.box(6, 40, 62, 112, cream)
    for row in range(8):
        label.line([(11, 48 + row * 8), (57 - 9 * (row % 3), 48 + row * 8)], (90, 70, 50), 1.6)
    label.box(6, 124, 62, 168, (255, 255, 255))
    widths = np.random.default_rng(83).choice([1.0, 1.6, 2.6], 14)
    for k, width in enumerate(widths):
        label.box(10 + 3.5 * k, 128, 10 + 3.5 * k + width, 162, (20, 20, 20))
    label.ellipse(318, 70, 19, 19, green)
    label.text(318, 70, "C", 24, cream)
    label.text(318, 110, "190 ml", 14, cream)
    return label.picture()


def _orange_slice(label: Sketch, x: float, y: float, size: float) -> None:
    """An orange cut across."""
    label.ellipse(x, y, size, size, (246, 120, 10))
    label.ellipse(x, y, size * 0.88, size * 0.88, (255, 240, 205))
    label.ellipse(x, y, size * 0.81, size * 0.81, (252, 158, 36))
    for angle in np.arange(8) * np.pi / 4 + 0.2:
        dx, dy = size * 0.81 * np.cos(angle), size * 0.81 * np.sin(angle)
        label.line([(x, y), (x + dx, y + dy)], (255, 240, 205), 2.4)


def _lid() -> Picture:
    """The can's lid from above, its opening to the front."""
    lid = Sketch(96, 96, brushed((190, 192, 196), 96, 96, 85, 0.04))
    lid.ellipse(48, 68, 17, 16, (128, 130, 136))
    lid.ellipse(48, 68, 15.5, 14.5, (176, 178, 184))
    lid.ellipse(48, 50, 4, 4, (140, 142, 148))
    return lid.picture()


def wood_coaster() -> ObjectModel:
    """A round disc with a shallow recess; only its grain tells its sides apart; 9.6 cm across."""
    grain = wood((202, 152, 98), (122, 76, 42), 256, 256, 91, 8)
    board = Sketch(256, 256, grain)
    board.ellipse(178, 92, 11, 8, (96, 58, 34))
    board.ellipse(178, 92, 6, 4, (66, 38, 24))
    edge = wood((186, 136, 86), (118, 74, 42), 256, 16, 93, 3)
    side = [
        (4.5, 0),
        (4.62, 0.02),
        (4.72, 0.08),
        (4.8, 0.2),
        (4.8, 0.4),
        (4.8, 0.7),
        (4.74, 0.84),
        (4.6, 0.9),
    ]
    recess = [(4.6, 0.9), (4.4, 0.9), (4.32, 0.88), (4.24, 0.82), (4.12, 0.6), (4.0, 0.55)]
    inner = [(r, 0.55) for r in (3.0, 2.0, 1.0, 0.0)]
    disc = lathe(
        [
            Strip([(0, 0), (2.2, 0), (4.5, 0)], plain((190, 140, 90))),
            Strip(side, edge),
            Strip([*recess, *inner], board.picture(), "top"),
        ],
        WOOD,
    )
    return assemble("wood_coaster", [disc])


SPOON_PLAN = (
    # along x, half width, height of the edge, depth of the hollow
    (-8.7, 0.0, 0.85, 0.0),
    (-8.45, 0.75, 0.86, 0.12),
    (-7.8, 1.4, 0.88, 0.42),
    (-6.6, 1.92, 0.92, 0.75),
    (-5.2, 2.02, 1.0, 0.8),
    (-3.8, 1.55, 1.12, 0.55),
    (-2.7, 0.7, 1.35, 0.15),
    (-1.9, 0.34, 1.55, 0.02),
    (0.0, 0.3, 1.6, 0.0),
    (3.0, 0.42, 1.2, 0.0),
    (6.0, 0.72, 0.7, 0.0),
    (7.8, 0.95, 0.38, 0.0),
    (8.5, 0.75, 0.3, 0.0),
    (8.75, 0.0, 0.28, 0.0),
)


def spoon_iron() -> ObjectModel:
    """A table spoon that lies with its handle to the front; 17.4 cm long."""
    plan = smooth(SPOON_PLAN, 90)
    along, half_width, edge, depth = np.maximum(plan, [-9, 0, 0, 0]).T
    across = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 19))
    x, y = along[:, None] + 0 * across, half_width[:, None] * across
    top = edge[:, None] - depth[:, None] * (1 - across**2)
    # The handle is thicker in its middle; the tips are not, or the sheets would fold there.
    swelling = np.clip(along / 3 + 1, 0.2, 1) * np.minimum(half_width / 0.3, 1)
    thickness = 0.1 + 0.14 * (1 - across**2) * swelling[:, None]
    steel = _streaked_steel()
    sheets = np.stack([x, y, top], axis=-1), np.stack([x, y, top - thickness], axis=-1)
    spoon = sandwich(*sheets, steel, STEEL, crease_deg=60)
    return assemble("spoon_iron", [box_mapped(spoon, steel, top=_spoon_from_above())])


def _streaked_steel() -> Picture:
    """Polished steel: soft streaks, as if it mirrored a room."""
    ground = plain((172, 174, 178), 64)
    return shaded(ground, 1 + 0.1 * noise(64, 64, 95, (2, 14)))


def _spoon_from_above() -> Picture:
    """The same, the handle's end at the picture's foot: a bright bowl's bottom, an engraved end."""
    picture = shaded(np.full((256, 60, 3), (176, 178, 182), np.uint8), 1 + 0.08 * _streaks())
    sketch = Sketch(60, 256, picture)
    sketch.ellipse(30, 44, 19, 27, (150, 152, 158))
    sketch.ellipse(30, 50, 14, 18, (196, 198, 202))
    sketch.ellipse(33, 54, 6, 9, (228, 230, 232))
    for x in (22, 38):
        sketch.line([(x, 206), (x, 244)], (110, 112, 118), 1.6)
    sketch.ellipse(30, 230, 4, 8, (110, 112, 118))
    return sketch.picture()


def _streaks() -> Array:
    """Noise along the spoon."""
    return noise(256, 60, 97, (1.5, 30))
