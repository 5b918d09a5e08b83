"""Drink cans: slim, regular and short, with wrapping prints; the name's middle is in front (+x)."""

import numpy as np

from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.paint import Colour, Sketch, brushed, noise, plain, shaded
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import Strip, lathe, rounded_box
from imodbatch.lab.variants.grounds import disc, ground, seed
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import Rng, brand, hsv, mixed, noun, readable_on, scheme
from imodbatch.lab.variants.prints import ball, burst, fruit
from imodbatch.lab.variants.small_print import bar_code, logo, nutrition, paragraph, worn

_WIDTH, _HEIGHT = 480, 260
Colours = tuple[Colour, ...]
_SIZES = ((3.3, 12.2), (2.9, 13.4), (3.3, 9.2), (2.65, 8.9), (3.3, 16.5))
"""Radius and height: regular, slim, short, small slim, tall."""


def make_soda_can(rng: Rng) -> ObjectModel:
    """A can."""
    radius, height = _SIZES[rng.choice(5, p=[0.66, 0.12, 0.08, 0.06, 0.08])]
    r, h = radius * rng.uniform(0.99, 1.01), height * rng.uniform(0.985, 1.015)
    tone = int(rng.integers(165, 212))
    steel = brushed((tone, tone, tone + 4), 64, 24, seed(rng))
    surface = Surface(rng.uniform(0.35, 0.7), rng.uniform(30, 80))
    neck = rng.uniform(0.8, 0.86) * r
    slope = rng.uniform(0.9, 1.35)
    low, high = 0.95, h - slope - 0.3
    foot = [(0, 0.9), (0.45 * r, 0.75), (0.68 * r, 0.25), (0.73 * r, 0.0), (0.78 * r, 0.0)]
    foot += [(0.82 * r, 0.15), (0.93 * r, 0.62), (r, low)]
    shoulder = [
        (r - (r - neck) * (0.5 - 0.5 * np.cos(np.pi * t)), high + slope * t)
        for t in np.linspace(0, 1, 7)
    ]
    wall = [(r, float(z)) for z in np.linspace(low, high, 12)] + shoulder[1:]
    rim = [(neck, high + slope), (neck + 0.06, h - 0.2), (neck + 0.1, h - 0.1)]
    rim += [(neck + 0.07, h), (neck - 0.02, h), (neck - 0.1, h - 0.08)]
    lid = [rim[-1], (neck - 0.16, h - 0.3), (neck - 0.24, h - 0.55), (neck - 0.36, h - 0.6)]
    lid += [(neck - 0.46, h - 0.42), (0.5 * neck, h - 0.42), (0, h - 0.42)]
    opened = rng.random() < 0.3
    can = lathe(
        [
            Strip(foot, steel),
            Strip(wall, _print(rng)),
            Strip(rim, plain((tone + 20,) * 3)),
            Strip(lid, _lid(rng, tone, opened), "top"),
        ],
        surface,
    )
    parts = [can, *_tab(rng, h - 0.42, tone)]
    turn = rng.choice([0.0, 90.0, 180.0]) if rng.random() < 0.6 else rng.uniform(0, 360)
    parts[1:] = [part.turned(z_deg=turn) for part in parts[1:]]
    parts[0] = can
    return assemble("soda_can", parts)


def _tab(rng: Rng, z: float, tone: int) -> list[Part]:
    """The ring pull and its rivet."""
    paint = plain(hsv(rng.random(), 0.8, 0.7) if rng.random() < 0.1 else (tone - 12,) * 3)
    shine = Surface(0.8, 60)
    ring = rounded_box((1.5, 1.3, 0.12), 0.055, paint, shine).moved(x=-0.35, z=z + 0.18)
    hole = rounded_box((0.7, 0.8, 0.13), 0.06, plain((70, 70, 74)), shine).moved(
        x=-0.65, z=z + 0.185
    )
    nose = rounded_box((0.9, 0.9, 0.12), 0.055, paint, shine).moved(x=0.45, z=z + 0.12)
    return [ring, hole, nose]


def _lid(rng: Rng, tone: int, opened: bool) -> Picture:
    """The lid from above; its opening to the front."""
    base = brushed((tone, tone, tone + 3), 112, 112, seed(rng), 0.05)
    lid = Sketch(112, 112, base)
    dark, light = (tone - 60,) * 3, (min(tone + 30, 255),) * 3
    for radius, colour in ((48, dark), (46, light), (44, (tone, tone, tone + 3))):
        lid.ellipse(56, 56, radius, radius, colour)
    lid.ellipse(56, 78, 17, 15, dark)
    lid.ellipse(56, 78, 15.5, 13.5, (22, 20, 20) if opened else (tone - 12,) * 3)
    lid.ellipse(56, 56, 4, 4, dark)
    return lid.picture()


def _print(rng: Rng) -> Picture:
    """What is printed round a can: two fronts, half a turn apart, and small print between."""
    colours = scheme(rng)
    wall = ground(rng, _HEIGHT, _WIDTH, colours)
    silver = rng.random() < 0.15
    if silver:
        metal = brushed((196, 198, 204), _WIDTH, _HEIGHT, seed(rng), 0.05)
        share = rng.uniform(0.5, 1.0)
        wall = np.round(wall * (1 - share) + metal * share).astype(np.uint8)
    average = wall[:, _WIDTH // 3 : 2 * _WIDTH // 3].reshape(-1, 3).mean(axis=0)
    behind = (int(average[0]), int(average[1]), int(average[2]))
    ink = readable_on(behind, colours[1:], rng)
    edge = readable_on(ink, colours, rng) if rng.random() < 0.6 else None
    _scatter(rng, wall, colours)
    state = rng.bit_generator.state
    fronts = (240,) if rng.random() < 0.15 else (120, 360)
    for centre in fronts:
        rng.bit_generator.state = state
        _front(rng, wall, centre, ink, edge, colours)
    if len(fronts) == 2:
        wall = np.roll(wall, 120, axis=1)
    side = 120 if len(fronts) == 2 else 40
    if rng.random() < 0.8:
        x = side - 30
        nutrition(wall, rng, (x, 70, x + 60, 160))
        bar_code(wall, rng, (x, 175, x + 56, 215))
        paragraph(wall, rng, (x, 222, x + 60, 245), ink, 4)
    if rng.random() < 0.5:
        paragraph(wall, rng, (340, 90, 385, 200), ink, 4)
    if rng.random() < 0.4:
        wall[: rng.integers(6, 26)] = colours[rng.integers(5)]
    if rng.random() < 0.4:
        wall[-int(rng.integers(6, 22)) :] = (190, 192, 198) if silver else colours[rng.integers(5)]
    return _metallic(worn(wall, rng, 0.02), rng)


def _front(
    rng: Rng, wall: Picture, x: float, ink: Colour, edge: Colour | None, colours: Colours
) -> None:
    """The name, level, slanted, or upright, and what goes with it."""
    kind = rng.integers(5)
    name, second = brand(rng, int(rng.integers(1, 3))), noun(rng)
    y = _HEIGHT * rng.uniform(0.35, 0.55)
    if kind <= 1:
        turn = rng.uniform(10, 35) if kind else 0.0
        if rng.random() < 0.3:
            disc(wall, (x, y), rng.uniform(60, 85), readable_on(ink, colours, rng))
        word(wall, rng, name, (x, y), (140, rng.uniform(45, 90)), ink, edge, turn)
        word(wall, rng, second, (x, y + 62), (110, 26), ink, None, turn)
    elif kind == 2:
        turn = 90.0 if rng.random() < 0.7 else -90.0
        word(wall, rng, name, (x, _HEIGHT / 2), (215, rng.uniform(60, 110)), ink, edge, turn)
    elif kind == 3:
        logo(wall, rng, (x, y), rng.uniform(50, 75), ink)
        word(wall, rng, second, (x, 0.82 * _HEIGHT), (130, 30), ink, edge)
    else:
        word(wall, rng, name, (x, 0.25 * _HEIGHT), (140, 55), ink, edge)
        word(wall, rng, second, (x, 0.45 * _HEIGHT), (120, 30), ink)
        for _ in range(rng.integers(1, 5)):
            at = (x + rng.uniform(-45, 45), _HEIGHT * rng.uniform(0.62, 0.85))
            fruit(wall, rng, at, rng.uniform(16, 36))
    if rng.random() < 0.2:
        at = (x + rng.uniform(-60, 60), _HEIGHT * 0.82)
        burst(wall, rng, at, 26, colours[1])
        word(wall, rng, "NEW", at, (34, 16), readable_on(colours[1], colours, rng))


def _scatter(rng: Rng, wall: Picture, colours: Colours) -> None:
    """Bubbles, drops of water, or nothing."""
    kind = rng.random()
    if kind < 0.25:
        for _ in range(rng.integers(20, 90)):
            at = (rng.random() * _WIDTH, rng.random() * _HEIGHT)
            disc(wall, at, rng.uniform(1.5, 8), mixed(colours[0], (255, 255, 255), rng.random()))
    elif kind < 0.35:
        for _ in range(rng.integers(6, 20)):
            at = (rng.random() * _WIDTH, rng.random() * _HEIGHT)
            ball(wall, rng, at, rng.uniform(5, 20), colours[rng.integers(5)])


def _metallic(picture: Picture, rng: Rng) -> Picture:
    """Inks on metal: fine upright streaks as it mirrors its surroundings."""
    streaks = noise(4, _WIDTH, seed(rng), (10, 3))[:1]
    return shaded(picture, 1 + rng.uniform(0.0, 0.09) * np.repeat(streaks, _HEIGHT, axis=0))
