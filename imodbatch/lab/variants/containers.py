"""Round containers that are neither mugs, bowls nor drink cans; and plates and pans."""

import numpy as np

from imodbatch.lab.mesh import Surface
from imodbatch.lab.objects.curves import profile
from imodbatch.lab.objects.paint import brushed, plain
from imodbatch.lab.objects.part import Part
from imodbatch.lab.objects.primitives import Strip, ellipsoid, lathe, tube
from imodbatch.lab.variants.grounds import flat, seed
from imodbatch.lab.variants.palettes import Rng, any_colour, hsv, scheme, vivid
from imodbatch.lab.variants.printed_things import label
from imodbatch.lab.variants.small_print import worn
from imodbatch.lab.variants.vessels import disc_part, radius_of, steel_wall, vessel


def tumbler(rng: Rng) -> list[Part]:
    """A glass, a beaker or a paper cup: taller than wide, no handle."""
    height, radius = rng.uniform(9, 16), rng.uniform(3.0, 4.3)
    wall = radius_of([(radius * rng.uniform(0.65, 1.0), 0), (radius, height)])
    colours = scheme(rng)
    pale = hsv(rng.random(), rng.uniform(0.0, 0.15), rng.uniform(0.6, 0.85))
    kind = rng.integers(3)
    if kind == 0:  # Glass, seen as pale grey with streaks of light.
        outside = steel_wall(64, 200, int(rng.integers(130, 210)), seed(rng), 0.5)
        inside, lip, shine = outside, plain((225, 228, 228)), Surface(0.9, 160)
    elif kind == 1:
        outside = worn(label(rng, 150, 380), rng)
        inside, lip, shine = plain((236, 234, 228)), plain((246, 244, 240)), Surface(0.06, 10)
    else:
        outside = inside = lip = plain(colours[0] if rng.random() < 0.6 else pale)
        shine = Surface(0.35, 50)
    parts = [vessel(wall, height, 0.2, (lip, outside, lip, inside), shine)]
    if kind == 1 and rng.random() < 0.6:  # With a lid.
        lid = plain((240, 240, 238) if rng.random() < 0.5 else (30, 28, 28))
        parts.append(disc_part(radius + 0.25, height - 0.5, height + 0.5, lid, Surface(0.3, 40)))
        parts.append(disc_part(radius - 0.4, height + 0.3, height + 1.1, lid, Surface(0.3, 40)))
    return parts


def jar(rng: Rng) -> list[Part]:
    """A jar with a lid."""
    r, h = rng.uniform(3, 5.2), rng.uniform(6, 15)
    neck = r * rng.uniform(0.75, 0.95)
    food = any_colour(rng)
    body = [(0.0, 0.0), (r - 0.4, 0.0), (r - 0.1, 0.15), (r, 0.5), (r, 0.25 * h)]
    middle = [(r, 0.25 * h), (r, 0.5 * h), (r, 0.72 * h)]
    top = [(r, 0.72 * h), (r * 0.98, 0.8 * h), (neck, 0.88 * h), (neck, h), (0.0, h)]
    jar = lathe(
        [
            Strip(body, plain(food)),
            Strip(middle, worn(label(rng, 110, 400), rng)),
            Strip(top, plain(food)),
        ],
        Surface(0.6, 120),
    )
    lid = disc_part(neck + 0.25, 0.9 * h, h + 0.3, plain(vivid(rng)), Surface(0.5, 50))
    return [jar, lid]


def bottle(rng: Rng) -> list[Part]:
    """A bottle: drink, sauce, shampoo or detergent."""
    r, h = rng.uniform(2.6, 4.6), rng.uniform(16, 30)
    neck, cap = rng.uniform(1.0, 1.6), plain(any_colour(rng))
    liquid = any_colour(rng)
    start, end = rng.uniform(0.08, 0.3) * h, rng.uniform(0.45, 0.62) * h
    low = [(0.0, 0.0), (r - 0.5, 0.0), (r - 0.1, 0.2), (r, 0.7), (r, start)]
    middle = [(r, start), (r, (start + end) / 2), (r, end)]
    shoulder = profile(
        [
            (r, end),
            (r * 0.97, 0.66 * h),
            (0.6 * r + 0.4 * neck, 0.76 * h),
            (neck, 0.85 * h),
            (neck, 0.92 * h),
        ],
        16,
    )
    bottle = lathe(
        [
            Strip(low, plain(liquid)),
            Strip(middle, worn(label(rng, 130, 400), rng)),
            Strip([*shoulder, (0.0, 0.92 * h)], plain(liquid)),
        ],
        Surface(rng.uniform(0.3, 0.9), rng.uniform(40, 160)),
    )
    squash = rng.uniform(0.55, 1.0) if rng.random() < 0.35 else 1.0
    lid = disc_part(neck + 0.2, 0.9 * h, h, cap, Surface(0.3, 40))
    return [bottle.scaled(x=squash), lid]


def tin(rng: Rng) -> list[Part]:
    """A squat food tin with ribs: tuna, beans, tomatoes; no neck, no tab."""
    r = rng.uniform(3.2, 5.2)
    h = rng.uniform(0.7, 2.3) * r if rng.random() < 0.7 else rng.uniform(3, 5)
    steel = brushed((180, 180, 184), 64, 32, seed(rng))
    z = np.linspace(0.35, h - 0.35, 36)
    ribs = rng.uniform(0.0, 0.07) * np.sin(z * rng.uniform(5, 9)) * (np.abs(z - h / 2) < 0.3 * h)
    side = [(r - 0.06 + float(b), float(t)) for b, t in zip(ribs, z, strict=True)]
    paper = worn(label(rng, 150, 420), rng) if rng.random() < 0.8 else steel
    foot = [(0.0, 0.2), (r - 0.3, 0.2), (r - 0.2, 0.0), (r + 0.03, 0.0), (r + 0.03, 0.3), side[0]]
    top = [side[-1], (r + 0.03, h - 0.3), (r + 0.03, h), (r - 0.2, h), (r - 0.3, h - 0.3)]
    top += [(0.7 * r, h - 0.25), (0.66 * r, h - 0.32), (0.0, h - 0.32)]
    return [lathe([Strip(foot, steel), Strip(side, paper), Strip(top, steel)], Surface(0.5, 50))]


def plate(rng: Rng) -> list[Part]:
    """A flat plate."""
    r, h = rng.uniform(7.5, 13.5), rng.uniform(1.2, 2.6)
    colour, ring = any_colour(rng), any_colour(rng)
    top = flat(64, 8, colour)
    top[4 : int(rng.integers(6, 22))] = ring
    outer = [
        (0.0, 0.3),
        (0.5 * r, 0.3),
        (0.55 * r, 0.0),
        (0.6 * r, 0.3),
        (0.8 * r, 0.5 * h),
        (r, h),
    ]
    inner = [(r, h), (r - 0.2, h + 0.15), (0.78 * r, 0.5 * h + 0.3), (0.6 * r, 0.7), (0.0, 0.65)]
    return [lathe([Strip(outer, plain(colour)), Strip(inner, top)], Surface(0.5, 90))]


def pot(rng: Rng) -> list[Part]:
    """A saucepan or a pan with a long handle, or a pot with a lid."""
    r, h = rng.uniform(7, 11), rng.uniform(4, 12)
    tone = int(rng.integers(35, 200))
    paint = steel_wall(64, 300, tone, seed(rng), 0.6) if rng.random() < 0.6 else plain(vivid(rng))
    parts = [
        vessel(lambda _: r, h, 0.3, (plain((60, 60, 62)), paint, paint, paint), Surface(0.7, 60))
    ]
    black = plain((28, 28, 30))
    path = [(r - 0.2, 0, 0.8 * h), (r + 3, 0, 0.86 * h), (r + rng.uniform(10, 18), 0, 0.95 * h)]
    parts.append(tube(path, (0.7, 0.8, 1.0), black, Surface(0.2, 30)).scaled(y=1.3))
    if rng.random() < 0.5:
        parts.append(disc_part(r + 0.1, h - 0.1, h + 0.5, paint, Surface(0.7, 60)))
        parts.append(ellipsoid((1.3, 1.3, 1.0), black, Surface(0.2, 30), 20).moved(z=h + 1.2))
    return parts


def thermos(rng: Rng) -> list[Part]:
    """A vacuum flask."""
    r, h = rng.uniform(3.2, 4.6), rng.uniform(20, 30)
    body = (
        steel_wall(64, 240, 150, seed(rng), 0.8) if rng.random() < 0.5 else plain(any_colour(rng))
    )
    points = [
        (0.0, 0.0),
        (r - 0.2, 0.0),
        (r, 0.3),
        (r, 0.4 * h),
        (r, 0.72 * h),
        (0.8 * r, 0.8 * h),
        (0.0, 0.8 * h),
    ]
    lid = plain(any_colour(rng))
    return [
        lathe([Strip(points, body)], Surface(0.7, 70)),
        disc_part(0.84 * r, 0.78 * h, h, lid, Surface(0.4, 50)),
    ]
