"""Bowls: china, wood, steel, plastic and stoneware, with bands, patterns and two glazes."""

import numpy as np

from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.curves import Outline, rounded_rectangle
from imodbatch.lab.objects.paint import Colour, noise, plain, shaded
from imodbatch.lab.objects.part import Array, Picture
from imodbatch.lab.variants.grounds import blend, disc, flat, ground, seed
from imodbatch.lab.variants.palettes import Rng, any_colour, hsv, mixed, readable_on, scheme
from imodbatch.lab.variants.prints import fruit, polygon
from imodbatch.lab.variants.vessels import Radius, deeper_darker, radius_of, vessel

_WIDTH, _HEIGHT = 480, 110


def make_bowl(rng: Rng) -> ObjectModel:
    """A bowl."""
    radius = rng.uniform(5.5, 9.0) if rng.random() < 0.75 else rng.uniform(8.0, 11.0)
    height = float(np.clip(radius * rng.uniform(0.6, 1.15), 4.5, 9.0))
    wall = _wall(rng, height, radius)
    material = rng.choice(4, p=[0.72, 0.1, 0.08, 0.1])
    outline, symmetry = _outline(rng)
    if material == 0:
        pictures, same = _china(rng)
        surface = Surface(rng.uniform(0.15, 0.6), rng.uniform(30, 120))
        thickness = rng.uniform(0.3, 0.6)
    elif material == 1:
        pictures, same = (_turned_wood(rng),) * 4, True
        surface, thickness = Surface(rng.uniform(0.03, 0.25), 20), rng.uniform(0.5, 0.9)
    elif material == 2:
        tone = int(rng.integers(130, 205))
        pictures, same = (_turned_steel(rng, tone),) * 4, True
        surface, thickness = Surface(0.85, rng.uniform(40, 100)), 0.2
    else:
        tint = any_colour(rng)
        inner = tint if rng.random() < 0.8 else any_colour(rng)
        pictures, same = (plain(tint), plain(tint), plain(tint), flat(32, 8, inner)), True
        surface, thickness = Surface(rng.uniform(0.15, 0.4), 40), 0.25
    if not same:
        symmetry = "none"
    bottom, outside, lip, inside = pictures
    inside = deeper_darker(inside, rng.uniform(0.05, 0.3))
    part = vessel(
        wall, height, thickness, (bottom, outside, lip, inside), surface,
        floor=rng.uniform(0.5, 0.9), foot=rng.uniform(0.12, 0.4), outline=outline, n_rings=22,
    )  # fmt: skip
    return assemble("bowl", [part], symmetry)


def _outline(rng: Rng) -> tuple[Outline | None, Symmetry]:
    """Round; seldom square or scalloped."""
    kind = rng.random()
    if kind < 0.86:
        return None, "full"
    if kind < 0.93:
        share = rng.uniform(0.35, 0.6)
        return rounded_rectangle(lambda r: share * r, n_arc=9, n_side=8), 4
    waves, depth = 16, rng.uniform(0.008, 0.018)
    angles = np.linspace(-np.pi, np.pi, waves * 6, endpoint=False)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    unit = unit * (1 + depth * np.cos(waves * angles))[:, None]

    def scalloped(radius: float) -> Array:
        return np.asarray(radius * unit)

    # Finer than any grid of views in use.
    return scalloped, "full"


def _wall(rng: Rng, height: float, radius: float) -> Radius:
    """Half a ball, flared, straight, on a foot, with a rim, or conical."""
    h, r = height, radius
    foot = rng.uniform(0.35, 0.5)
    shapes = (
        [(foot * r, 0), (0.72 * r, 0.2 * h), (0.92 * r, 0.55 * h), (r, h)],
        [(foot * r, 0), (0.62 * r, 0.2 * h), (0.8 * r, 0.55 * h), (r, h)],
        [(0.7 * r, 0), (0.9 * r, 0.15 * h), (0.97 * r, 0.5 * h), (r, h)],
        [(0.48 * r, 0), (0.44 * r, 0.1 * h), (0.75 * r, 0.3 * h), (0.93 * r, 0.62 * h), (r, h)],
        [(foot * r, 0), (0.72 * r, 0.25 * h), (0.82 * r, 0.7 * h), (0.84 * r, 0.9 * h), (r, h)],
        [(foot * r, 0), (0.7 * r, 0.5 * h), (r, h)],
        [(0.55 * r, 0), (0.9 * r, 0.25 * h), (1.0 * r, 0.6 * h), (0.96 * r, h)],
    )
    return radius_of(shapes[rng.choice(7, p=[0.32, 0.17, 0.14, 0.14, 0.06, 0.09, 0.08])])


def _china_colour(rng: Rng) -> Colour:
    """White and cream half of the time."""
    if rng.random() < 0.45:
        return hsv(rng.uniform(0.05, 0.17), rng.uniform(0, 0.12), rng.uniform(0.85, 0.97))
    return any_colour(rng)


def _china(rng: Rng) -> tuple[tuple[Picture, Picture, Picture, Picture], bool]:
    """Bottom, outside, lip and inside; and whether every side looks the same."""
    body = _china_colour(rng)
    inner = body if rng.random() < 0.55 else _china_colour(rng)
    colours = scheme(rng)
    outside, same = _outside(rng, body, (body, *colours[1:]))
    inside, same_inside = _inside(rng, inner, colours)
    lip = plain(inner if rng.random() < 0.7 else (readable_on(body, colours, rng)))
    bare = mixed(body, (214, 196, 172), 0.6 * (rng.random() < 0.4))
    speckle = rng.random() < 0.12
    if speckle:
        outside, inside = _speckled(rng, _wide(outside)), _speckled(rng, _wide(inside))
    return (plain(bare), outside, lip, inside), same and same_inside


def _wide(picture: Picture) -> Picture:
    """At least as wide as the whole circumference is drawn."""
    return picture if picture.shape[1] >= _WIDTH // 2 else np.repeat(picture[:, :1], 400, axis=1)


def _speckled(rng: Rng, picture: Picture) -> Picture:
    """Fine dark and light spots, everywhere alike."""
    grain = noise(picture.shape[0], picture.shape[1], seed(rng), (0.7, 0.7))
    return shaded(picture, 1 - 0.35 * np.float64(1) * (grain > rng.uniform(1.7, 2.4)))


def _outside(rng: Rng, body: Colour, colours: tuple[Colour, ...]) -> tuple[Picture, bool]:
    """Plain, bands, a row of motifs, two glazes, ribs or a print; whether all sides are alike."""
    kind = rng.choice(7, p=[0.4, 0.2, 0.12, 0.1, 0.08, 0.05, 0.05])
    if kind == 5:
        return ground(rng, _HEIGHT, _WIDTH, colours), False
    if kind == 6:
        wall = flat(_HEIGHT, _WIDTH, body)
        for _ in range(rng.integers(4, 16)):
            at = (rng.uniform(20, _WIDTH - 20), rng.uniform(15, _HEIGHT - 15))
            fruit(wall, rng, at, rng.uniform(8, 20))
        return wall, False
    uniform = (_plain, _bands, _row_of_motifs, _two_glazes, _ribs)
    return uniform[kind](rng, body, colours), True


def _plain(_: Rng, body: Colour, __: tuple[Colour, ...]) -> Picture:
    return flat(32, 8, body)


def _bands(rng: Rng, body: Colour, colours: tuple[Colour, ...]) -> Picture:
    wall = flat(_HEIGHT, 8, body)
    for _ in range(rng.integers(1, 5)):
        at, wide = int(rng.random() * _HEIGHT), int(rng.choice([2, 3, 5, 8, 16, 40]))
        wall[at : at + wide] = colours[rng.integers(1, len(colours))]
    return wall


def _two_glazes(rng: Rng, body: Colour, _: tuple[Colour, ...]) -> Picture:
    below = np.linspace(0, 1, _HEIGHT)[:, None] - rng.uniform(0.25, 0.75)
    return blend(body, _china_colour(rng), below * rng.choice([3, 80]) * np.ones((1, 8)))


def _ribs(rng: Rng, body: Colour, _: tuple[Colour, ...]) -> Picture:
    ribs = np.sin(np.linspace(0, rng.uniform(20, 70), _HEIGHT))[:, None] * np.ones((1, 8))
    return shaded(flat(_HEIGHT, 8, body), 1 + rng.uniform(0.04, 0.14) * ribs)


def _row_of_motifs(rng: Rng, body: Colour, colours: tuple[Colour, ...]) -> Picture:
    """The same motif 16 or 32 times, which is finer than any grid of views in use."""
    ink = readable_on(body, colours[1:], rng)
    step = int(rng.choice([15, 30]))
    tile = flat(_HEIGHT, step, body)
    y, size = rng.uniform(0.2, 0.6) * _HEIGHT, 0.36 * step
    kind = rng.integers(4)
    if kind == 0:
        disc(tile, (step / 2, y), size, ink)
    elif kind == 1:
        polygon(tile, np.array([[0, y + size], [step / 2, y - size], [step, y + size]]), ink)
    elif kind == 2:
        for angle in np.arange(5) * 2 * np.pi / 5:
            at = (step / 2 + 0.6 * size * np.cos(angle), y + 0.6 * size * np.sin(angle))
            disc(tile, at, 0.45 * size, ink)
    else:
        tile[:, : step // 2] = ink
    for _ in range(rng.integers(0, 3)):
        row = int(rng.random() * _HEIGHT)
        tile[row : row + 3] = colours[rng.integers(1, len(colours))]
    return np.tile(tile, (1, _WIDTH // step, 1))


def _inside(rng: Rng, body: Colour, colours: tuple[Colour, ...]) -> tuple[Picture, bool]:
    """Plain; bands under the rim; a pool of glaze; or prints."""
    kind = rng.random()
    inside = flat(128, 8, body)
    if kind < 0.6:
        return inside, True
    if kind < 0.78:
        for _ in range(rng.integers(1, 4)):
            at = int(rng.random() ** 2 * 90)
            inside[at : at + int(rng.choice([2, 4, 8]))] = colours[rng.integers(1, 5)]
        return inside, True
    if kind < 0.92:
        pool = (np.linspace(0, 1, 128)[:, None] - rng.uniform(0.3, 0.7)) * np.ones((1, 8))
        return blend(body, any_colour(rng), pool * rng.choice([2, 20])), True
    wall = flat(100, 320, body)
    for _ in range(rng.integers(3, 12)):
        disc(
            wall,
            (rng.random() * 320, rng.random() * 70),
            rng.uniform(4, 12),
            colours[rng.integers(1, 5)],
        )
    return wall, False


def _turned_wood(rng: Rng) -> Picture:
    """Wood turned on a lathe; its grain shows as faint rings."""
    light = hsv(rng.uniform(0.05, 0.1), rng.uniform(0.35, 0.7), rng.uniform(0.35, 0.85))
    rings = noise(128, 128, seed(rng), (40, 1.2)) + 0.7 * noise(128, 128, seed(rng), (30, 8))
    return shaded(flat(128, 128, light), 1 + 0.06 * rings)


def _turned_steel(rng: Rng, tone: int) -> Picture:
    """Spun steel: rings of light and dark, as it mirrors what is above and below."""
    y = np.linspace(0, 1, 96)[:, None]
    light = sum(
        rng.normal(0, 0.12 / k) * np.cos(2 * np.pi * k * y + rng.uniform(0, 6.3))
        for k in range(1, 6)
    )
    fine = 0.04 * rng.standard_normal((96, 1))
    return shaded(flat(96, 8, (tone, tone, tone + 3)), (1 + light + fine) * np.ones((1, 8)))
