"""Books, tissue boxes, small cartons and flat devices: boxes that are not cereal boxes."""

import numpy as np

from imodbatch.lab.mesh import Surface
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.paint import noise, plain, shaded
from imodbatch.lab.objects.part import Part, Picture
from imodbatch.lab.objects.primitives import rounded_box
from imodbatch.lab.variants.grounds import cells, flat, ground, seed
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import Rng, any_colour, brand, mixed, noun, readable_on, scheme
from imodbatch.lab.variants.prints import fruit, photograph
from imodbatch.lab.variants.small_print import fill, logo, nutrition, paragraph, worn


def label(rng: Rng, height: int, width: int) -> Picture:
    """A paper label that is wrapped round a jar, a bottle or a cup."""
    colours = scheme(rng)
    picture = ground(rng, height, width, colours)
    ink = readable_on(colours[0], colours[1:], rng)
    edge = readable_on(ink, colours, rng)
    word(
        picture,
        rng,
        brand(rng),
        (width / 2, 0.35 * height),
        (0.4 * width, 0.35 * height),
        ink,
        edge,
    )
    word(picture, rng, noun(rng), (width / 2, 0.68 * height), (0.3 * width, 0.2 * height), ink)
    if rng.random() < 0.6:
        fruit(picture, rng, (width * 0.2, height * 0.6), 0.2 * height)
    nutrition(picture, rng, (4, 8, width // 6, height - 8))
    return picture


def cover(rng: Rng, height: int, width: int) -> Picture:
    """The cover of a book or the front of a small pack."""
    colours = scheme(rng)
    if rng.random() < 0.35:
        picture = photograph(rng, height, width)
    else:
        picture = ground(rng, height, width, colours)
    top = picture[: height // 3].reshape(-1, 3).mean(axis=0)
    ink = readable_on((int(top[0]), int(top[1]), int(top[2])), colours, rng)
    word(picture, rng, brand(rng), (width / 2, 0.2 * height), (0.85 * width, 0.2 * height), ink)
    if rng.random() < 0.5:
        logo(picture, rng, (width / 2, 0.6 * height), 0.2 * min(height, width), ink)
    paragraph(picture, rng, (10, int(0.86 * height), width - 10, height - 6), ink, 6)
    return picture


def book(rng: Rng) -> list[Part]:
    """One to three books, lying or standing."""
    parts, z = [], 0.0
    standing = rng.random() < 0.3
    for _ in range(1 if standing else int(rng.integers(1, 4))):
        w, h, d = rng.uniform(11, 19), rng.uniform(16, 26), rng.uniform(0.8, 4.5)
        front = worn(cover(rng, 220, 150), rng)
        pages = np.full((24, 64, 3), (232, 226, 208), np.uint8)
        pages = shaded(pages, 1 + 0.08 * noise(24, 64, seed(rng), (8, 0.5)))
        colour = front.reshape(-1, 3).mean(axis=0).astype(np.uint8)
        spine = flat(160, 24, (int(colour[0]), int(colour[1]), int(colour[2])))
        word(spine, rng, brand(rng), (12, 80), (120, 18), (245, 240, 230), None, 90.0)
        part = rounded_box((d, w, h), 0.08, front, Surface(rng.uniform(0.03, 0.3), 25), 1, 2)
        part = box_mapped(part, pages, front=front, back=front, right=spine)
        if standing:
            return [part]
        part = part.turned(y_deg=-90, z_deg=rng.normal(0, 12)).moved(z=z + d / 2)
        z += d
        parts.append(part)
    return parts


def tissue_box(rng: Rng) -> list[Part]:
    """A wide, low box with a slit above; often a tissue sticks out."""
    low = rng.random() < 0.7
    w, h, d = (23, rng.uniform(6, 11), 12) if low else (11.5, rng.uniform(12, 14), 11.5)
    colours = scheme(rng)
    side = worn(
        ground(rng, 90, 190, colours) if rng.random() < 0.6 else cells(rng, 90, 190, colours), rng
    )
    top = worn(flat(100, 190, colours[0]), rng)
    fill(top, (55, 38, 135, 62), mixed(colours[0], (30, 30, 30), 0.8))
    box = rounded_box((d, w, h), 0.15, side, Surface(0.12, 20), 1, 3).moved(z=h / 2)
    parts = [box_mapped(box, side, top=top)]
    if rng.random() < 0.7:
        tissue = rounded_box((1.0, 7, 6), 0.4, plain((246, 246, 244)), Surface(0.02, 5), 2, 8)
        v = tissue.vertices
        v[:, 0] += 0.7 * np.sin(v[:, 1] * 1.3 + rng.uniform(0, 6)) * (v[:, 2] + 3) / 4
        v[:, 1] *= 0.7 + 0.12 * (v[:, 2] + 3)
        parts.append(tissue.moved(z=h + 1.5))
    return parts


def small_carton(rng: Rng) -> list[Part]:
    """Milk, juice, medicine, tea or shoes: any box but the tall, thin, wide one of cereals."""
    kind = rng.integers(4)
    if kind == 0:  # Milk, with a gable.
        side, h = rng.uniform(6.5, 9.5), rng.uniform(14, 22)
        size = (side, side, h)
    elif kind == 1:
        size = (rng.uniform(3.5, 5), rng.uniform(4.5, 7), rng.uniform(9, 13))
    elif kind == 2:
        size = (rng.uniform(5, 10), rng.uniform(8, 16), rng.uniform(2, 6.5))
    else:
        size = (rng.uniform(15, 22), rng.uniform(26, 34), rng.uniform(9, 13))
    front = worn(cover(rng, 190, 140) if kind < 2 else cover(rng, 120, 220), rng)
    other = worn(cover(rng, 190, 140), rng)
    paint = plain(any_colour(rng))
    shine = Surface(rng.uniform(0.05, 0.35), rng.uniform(10, 40))
    box = rounded_box(size, 0.12, front, shine, 1, 3).moved(z=size[2] / 2)
    parts = [box_mapped(box, paint, front=front, back=front, left=other, right=other)]
    if kind == 0:
        roof = rounded_box((size[0], size[1], 3.2), 0.1, paint, shine, 1, 4)
        v = roof.vertices
        v[:, 0] *= np.clip(0.5 - v[:, 2] / 3.2, 0.05, 1)
        parts.append(roof.moved(z=size[2] + 1.55))
    return parts


def panel_device(rng: Rng) -> list[Part]:
    """A small monitor, a picture frame or a calendar on a foot."""
    w, h = rng.uniform(14, 34), rng.uniform(12, 24)
    black = plain((24, 24, 26) if rng.random() < 0.7 else any_colour(rng))
    frame = rounded_box((1.6, w, h), 0.3, black, Surface(0.3, 40), 2, 2)
    screen = rounded_box(
        (0.2, 0.9 * w, 0.88 * h), 0.05, photograph(rng, 150, 220), Surface(0.5, 100)
    )
    lean = rng.uniform(-16, 0)
    parts = [p.turned(y_deg=lean) for p in (frame, screen.moved(x=0.75))]
    foot = rounded_box((rng.uniform(6, 12), 0.5 * w, 0.8), 0.3, black, Surface(0.3, 40))
    return [*parts, foot.moved(z=-h / 2 - 0.2)]


def phone_or_keyboard(rng: Rng) -> list[Part]:
    """A desk phone, a remote control, a calculator or a keyboard: a slab of keys."""
    keys = flat(140, 200, (40, 40, 44) if rng.random() < 0.6 else any_colour(rng))
    key = any_colour(rng) if rng.random() < 0.4 else (210, 210, 206)
    step_x, step_y = int(rng.integers(12, 30)), int(rng.integers(12, 28))
    for y in range(30, 134 - step_y, step_y):
        for x in range(8, 196 - step_x, step_x):
            fill(keys, (x, y, x + step_x - 4, y + step_y - 4), key)
    fill(keys, (20, 6, 180, 24), (130, 146, 130))
    size = (rng.uniform(5, 16), rng.uniform(8, 42), rng.uniform(1.2, 5))
    body = rounded_box(size, 0.4, plain((40, 40, 44)), Surface(0.3, 40), 2, 2)
    return [box_mapped(body, plain((60, 60, 64)), top=keys).turned(y_deg=rng.uniform(0, 12))]
