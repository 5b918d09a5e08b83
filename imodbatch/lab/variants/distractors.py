"""Things found beside bowls, caps, cereal boxes, mugs and cans that are none of these.

Many are hard to tell from them: tumblers without a handle, squat tins, tissue boxes, cartons.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.paint import Colour, noise, plain, shaded, wood
from imodbatch.lab.objects.part import Part
from imodbatch.lab.objects.primitives import Strip, ellipsoid, lathe, rounded_box, tube
from imodbatch.lab.variants.containers import bottle, jar, plate, pot, thermos, tin, tumbler
from imodbatch.lab.variants.grounds import flat, seed
from imodbatch.lab.variants.palettes import Rng, any_colour, hsv, mixed, vivid
from imodbatch.lab.variants.printed_things import (
    book,
    cover,
    panel_device,
    phone_or_keyboard,
    small_carton,
    tissue_box,
)
from imodbatch.lab.variants.small_print import worn
from imodbatch.lab.variants.vessels import disc_part

Maker = Callable[[Rng], list[Part]]


def make_any_distractor(rng: Rng) -> ObjectModel:
    """A thing of any kind."""
    kind = _KINDS[rng.integers(len(_KINDS))]
    parts = kind(rng)
    if rng.random() < 0.5:
        turn = rng.uniform(0, 360)
        parts = [part.turned(z_deg=turn) for part in parts]
    return assemble("distractor", parts)


def _shine(rng: Rng) -> Surface:
    """From paper to polish."""
    return Surface(rng.uniform(0.03, 0.7), rng.uniform(8, 120))


def _torch(rng: Rng) -> list[Part]:
    """A flashlight, lying."""
    r, length = rng.uniform(1.2, 2.0), rng.uniform(12, 24)
    head = r * rng.uniform(1.3, 2.0)
    paint = plain(any_colour(rng) if rng.random() < 0.5 else (26, 26, 28))
    points = [(0.0, 0.0), (r, 0.1), (r, 0.7 * length), (head, 0.8 * length), (head, length)]
    body = lathe(
        [
            Strip(points, paint),
            Strip(
                [(head, length), (0.85 * head, length), (0.0, length - 0.6)], plain((226, 226, 214))
            ),
        ],
        Surface(0.5, 50),
    )
    return [body.turned(y_deg=90)]


def _tape(rng: Rng) -> list[Part]:
    """A roll of tape or of paper, lying or standing."""
    r, w = rng.uniform(3.5, 6.5), rng.uniform(1.5, 12)
    hole = r * rng.uniform(0.3, 0.75)
    paint = plain((240, 238, 232) if w > 6 else any_colour(rng))
    ring = [(hole, 0.0), (r, 0.0), (r, w), (hole, w), (hole, 0.0)]
    part = lathe([Strip(ring, paint)], Surface(0.2, 30))
    return [part.turned(y_deg=90) if rng.random() < 0.35 else part]


def _fruit_heap(rng: Rng) -> list[Part]:
    """One to four pieces of fruit."""
    hue, r = rng.choice([0.0, 0.05, 0.09, 0.15, 0.25]), rng.uniform(2.8, 4.6)
    parts = []
    for k in range(int(rng.integers(1, 5))):
        skin = flat(48, 96, hsv(hue + rng.normal(0, 0.015), 0.85, rng.uniform(0.5, 0.95)))
        skin = shaded(skin, 1 + 0.07 * noise(48, 96, seed(rng), (3, 4)))
        piece = ellipsoid((r * rng.uniform(0.9, 1.4), r, r * 0.95), skin, Surface(0.3, 30), 28)
        at = 2 * np.pi * k / 4
        parts.append(
            piece.turned(z_deg=rng.uniform(0, 180)).moved(
                1.6 * r * np.cos(at), 1.6 * r * np.sin(at)
            )
        )
    return parts


def _blocks(rng: Rng) -> list[Part]:
    """Toy blocks, some on others."""
    parts, side = [], rng.uniform(3, 5)
    for k in range(int(rng.integers(1, 6))):
        paint = (
            plain(vivid(rng))
            if rng.random() < 0.7
            else wood((226, 190, 142), (190, 146, 98), 64, 64, seed(rng))
        )
        size = (side * rng.choice([1, 2]), side, side)
        block = rounded_box(size, 0.15, paint, Surface(0.15, 25)).turned(z_deg=rng.uniform(0, 90))
        parts.append(block.moved((k % 2) * 1.6 * side, rng.normal(0, 1), (k // 2) * side))
    return parts


def _plush(rng: Rng) -> list[Part]:
    """A soft toy of round parts."""
    fur = shaded(flat(64, 128, any_colour(rng)), 1 + 0.12 * noise(64, 128, seed(rng), (0.6, 1.4)))
    soft, dark = Surface(0.02, 5), plain((20, 18, 18))
    b = rng.uniform(4, 7)
    parts = [ellipsoid((b * 0.8, b * 0.9, b), fur, soft).moved(z=b)]
    head = 0.75 * b
    parts.append(ellipsoid((head, head, head * 0.95), fur, soft).moved(x=0.2, z=2.3 * b))
    for side in (-1, 1):
        parts.append(
            ellipsoid((0.25 * b, 0.3 * b, rng.uniform(0.3, 0.9) * b), fur, soft, 20).moved(
                y=side * 0.6 * b, z=3.0 * b
            )
        )
        parts.append(
            ellipsoid((0.7 * b, 0.35 * b, 0.35 * b), fur, soft, 20).moved(
                0.7 * b, side * 0.6 * b, 0.4 * b
            )
        )
        parts.append(
            ellipsoid((0.1 * b,) * 3, dark, Surface(0.9, 200), 12).moved(
                0.9 * head, side * 0.3 * b, 2.4 * b
            )
        )
    return parts


def _headphones(rng: Rng) -> list[Part]:
    """A band over two cups, lying on its side or standing."""
    r, paint = rng.uniform(7, 9), plain(any_colour(rng))
    angles = np.linspace(0, np.pi, 13)
    band = tube(
        [(0, r * np.cos(a), r * np.sin(a)) for a in angles], [0.5] * 13, paint, _shine(rng), 14, 40
    )
    parts = [band.scaled(x=2)]
    for side in (-1, 1):
        pad = ellipsoid((3.6, 1.7, 4.2), plain((30, 30, 32)), Surface(0.1, 15), 24)
        parts.append(pad.moved(y=side * (r - 0.6), z=-1.5))
    return [p.turned(y_deg=90) for p in parts] if rng.random() < 0.6 else parts


def _bag(rng: Rng) -> list[Part]:
    """A bag of crisps, flour or coffee: a swollen, crumpled pouch."""
    w, h, d = rng.uniform(9, 18), rng.uniform(12, 26), rng.uniform(3, 7)
    front = worn(cover(rng, 240, 180), rng)
    part = rounded_box((d, w, h), 0.4, front, Surface(rng.uniform(0.2, 0.7), 40), 2, 12)
    v = part.vertices.copy()
    t = np.clip(v[:, 2] / h + 0.5, 0, 1)
    thin = (
        np.clip(4 * t * (1 - t), 0.08, 1) ** 0.6
        if rng.random() < 0.6
        else np.clip(3 * (1 - t), 0.08, 1) ** 0.5
    )
    crumple = 1 + 0.06 * np.sin(v[:, 1] * 1.7 + 3 * rng.random()) * np.sin(v[:, 2] * 1.3)
    v[:, 0] *= thin * crumple
    return [box_mapped(replace(part, vertices=v), front)]


def _speaker(rng: Rng) -> list[Part]:
    """A small loudspeaker or a table clock: a box with round things in front."""
    w, h, d = rng.uniform(7, 18), rng.uniform(8, 26), rng.uniform(6, 16)
    body = any_colour(rng) if rng.random() < 0.4 else (30, 30, 32)
    shell: Colour = mixed(body, (120, 90, 60), 0.5 * (rng.random() < 0.3))
    parts = [rounded_box((d, w, h), rng.uniform(0.2, 1.5), plain(shell), _shine(rng), 4, 2)]
    r = 0.38 * w
    for z, size, out in ((-0.5 * h + 1.2 * r, r, 0.2), (0.5 * h - 0.7 * r, 0.45 * r, 0.3)):
        face = plain((235, 232, 222) if rng.random() < 0.3 else (46, 46, 48))
        parts.append(disc_part(size, 0, out, face, _shine(rng)).turned(y_deg=90).moved(d / 2, 0, z))
    return parts


def _stapler(rng: Rng) -> list[Part]:
    """A stapler: a long hinged block."""
    length, paint = rng.uniform(11, 18), plain(any_colour(rng))
    base = rounded_box((3.4, length, 0.9), 0.3, paint, _shine(rng)).moved(z=0.45)
    arm = rounded_box((2.6, length * 0.95, 1.6), 0.6, paint, _shine(rng)).turned(
        x_deg=rng.uniform(4, 14)
    )
    rail = rounded_box((1.6, length * 0.9, 0.8), 0.1, plain((170, 170, 174)), Surface(0.8, 60))
    return [base, arm.moved(z=3.2), rail.turned(x_deg=6).moved(z=2.0)]


_KINDS: tuple[Maker, ...] = (
    tumbler, tumbler, jar, bottle, bottle, tin, tin, plate, pot, thermos, _torch, _tape,
    _fruit_heap, _blocks, _plush, _headphones, _bag, _speaker, _stapler, book, book, tissue_box,
    small_carton, small_carton, panel_device, phone_or_keyboard,
)  # fmt: skip
