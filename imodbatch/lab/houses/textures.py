"""Surface textures drawn from random numbers: wood, tiles, carpet, wallpaper, plaster, stone.

Every texture repeats without a seam. A recipe is a function of random numbers and a palette; which
split uses which recipe is said in `styles`, nowhere else.
"""

from collections.abc import Callable

import cv2
import numpy as np

from imodbatch.lab.houses.patterns import (
    SIDE_PX,
    Palette,
    Picture,
    clouds,
    grain,
    noise,
    per_cell,
    picture,
    pixels,
    shade,
    tint,
)

Recipe = Callable[[np.random.Generator, Palette], Picture]


def wood(rng: np.random.Generator, palette: Palette) -> Picture:
    """Solid wood or veneer, fibres along x."""
    return picture(shade(tint(rng, palette), grain(rng), rng.uniform(0.08, 0.16)))


def burl(rng: np.random.Generator, palette: Palette) -> Picture:
    """Root wood: whorls instead of streaks."""
    whorl = np.sin(2 * np.pi * (1.6 * clouds(rng, 3, 3)))
    return picture(shade(tint(rng, palette), 0.7 * whorl + 0.4 * clouds(rng, 32, 2), 0.14))


def brushed(rng: np.random.Generator, palette: Palette) -> Picture:
    """Varnished or painted board with brush marks along x."""
    marks = noise(rng, 3, 170) + 0.6 * noise(rng, 6, 250) + 0.5 * clouds(rng, 2, 2)
    return picture(shade(tint(rng, palette), marks, rng.uniform(0.05, 0.09)))


def planks(rng: np.random.Generator, palette: Palette) -> Picture:
    """Floor boards along x, each of another shade, with dark joints."""
    x, y = pixels()
    n = int(rng.integers(5, 9))
    row = (y * n).astype(np.int64)
    shift = rng.random(n)[row]
    cell = row * 2 + ((x + shift) % 1 > 0.5)
    joint = ((y * n) % 1 < 0.03) | (((x + shift) % 0.5) < 0.004)
    pattern = grain(rng) + per_cell(rng, cell.astype(np.int64), 1.0)
    return picture(shade(tint(rng, palette), pattern, 0.09) * (1 - 0.5 * joint[..., None]))


def mosaic(rng: np.random.Generator, palette: Palette) -> Picture:
    """Parquet of squares whose strips run along and across in turn."""
    x, y = pixels()
    n = 4
    i, j = (x * n).astype(np.int64), (y * n).astype(np.int64)
    across = (i + j) % 2 == 0
    along = np.where(across, x, y) * n * 4
    strips = (i + n * j) * 4 + (along % 4).astype(np.int64)
    fibre = np.where(across, grain(rng).T, grain(rng))
    joint = (along % 1 < 0.06) | ((x * n) % 1 < 0.015) | ((y * n) % 1 < 0.015)
    pattern = fibre * 0.7 + per_cell(rng, strips, 1.0)
    return picture(shade(tint(rng, palette), pattern, 0.1) * (1 - 0.4 * joint[..., None]))


def herringbone(rng: np.random.Generator, palette: Palette) -> Picture:
    """Parquet of slanting strips in columns that mirror each other."""
    x, y = pixels()
    column = (x * 4).astype(np.int64)
    slant = np.where(column % 2 == 0, x * 4 % 1, 1 - x * 4 % 1)
    level = (y * 12 + slant * 2) % 12
    cell = column * 12 + level.astype(np.int64)
    joint = (level % 1 < 0.06) | (x * 4 % 1 < 0.015)
    fibre = noise(rng, 64, 96) * 0.8
    pattern = fibre + per_cell(rng, cell, 1.0)
    return picture(shade(tint(rng, palette), pattern, 0.1) * (1 - 0.45 * joint[..., None]))


def tiles(rng: np.random.Generator, palette: Palette) -> Picture:
    """Square tiles with light joints; sometimes two colours in turn."""
    x, y = pixels()
    n = int(rng.choice([2, 4]))
    i, j = (x * n).astype(np.int64), (y * n).astype(np.int64)
    base, other = tint(rng, palette), tint(rng, palette)
    second = ((i + j) % 2 == 1)[..., None] & bool(rng.random() < 0.4)
    color = np.where(second, other, base)
    joint = ((x * n % 1 < 0.025) | (y * n % 1 < 0.025))[..., None]
    pattern = 0.6 * clouds(rng, 6) + per_cell(rng, i + n * j, 0.5)
    return picture(np.where(joint, 170 + 20 * color / 255, color * (1 + 0.05 * pattern[..., None])))


def bricks(rng: np.random.Generator, palette: Palette) -> Picture:
    """Oblong tiles in a running bond."""
    x, y = pixels()
    row = (y * 8).astype(np.int64)
    along = (x * 3 + 0.5 * (row % 2)) % 3
    cell = row * 3 + along.astype(np.int64)
    joint = ((along % 1 < 0.02) | (y * 8 % 1 < 0.05))[..., None]
    pattern = 0.5 * clouds(rng, 8) + per_cell(rng, cell, 1.0)
    color = tint(rng, palette)
    return picture(np.where(joint, 0.5 * color + 40, shade(color, pattern, 0.07)))


def diamonds(rng: np.random.Generator, palette: Palette) -> Picture:
    """Tiles laid aslant, a small dark one at every crossing."""
    x, y = pixels()
    u, v = (x + y) * 3 % 1, (x - y) * 3 % 1
    joint = ((u < 0.03) | (v < 0.03))[..., None]
    small = (np.abs((x * 6 + 0.5) % 1 - 0.5) + np.abs((y * 6 + 0.5) % 1 - 0.5) < 0.16)[..., None]
    color, dark = tint(rng, palette), 0.45 * tint(rng, palette)
    body = shade(color, clouds(rng, 5), 0.05)
    return picture(np.where(small, dark, np.where(joint, 0.7 * color, body)))


def carpet(rng: np.random.Generator, palette: Palette) -> Picture:
    """Short pile: fine speckles over faint clouds."""
    fine = rng.normal(0, 1, (SIDE_PX, SIDE_PX))
    pattern = cv2.GaussianBlur(fine, (3, 3), 0.7, borderType=cv2.BORDER_REFLECT)
    return picture(shade(tint(rng, palette), 0.6 * pattern + 0.3 * clouds(rng), 0.16))


def woven(rng: np.random.Generator, palette: Palette) -> Picture:
    """Coarse weave: threads over and under each other, in two colours."""
    x, y = pixels()
    n = int(rng.choice([32, 48, 64]))
    over = ((x * n).astype(np.int64) + (y * n).astype(np.int64)) % 2 == 0
    bulge = np.where(over, np.sin(np.pi * (y * n % 1)), np.sin(np.pi * (x * n % 1))) - 0.6
    color = np.where(over[..., None], tint(rng, palette), tint(rng, palette))
    return picture(color * (1 + 0.3 * bulge[..., None] + 0.08 * noise(rng, 24, 24)[..., None]))


def melange(rng: np.random.Generator, palette: Palette) -> Picture:
    """Felted fabric of two mixed colours."""
    mix = np.clip(0.5 + 0.7 * noise(rng, 170, 170) + 0.2 * clouds(rng), 0, 1)[..., None]
    return picture(mix * tint(rng, palette) + (1 - mix) * tint(rng, palette))


def cord(rng: np.random.Generator, palette: Palette) -> Picture:
    """Ribbed fabric."""
    x, _ = pixels()
    rib = np.sin(2 * np.pi * x * int(rng.choice([24, 32, 40])))
    return picture(shade(tint(rng, palette), 0.8 * rib + 0.5 * noise(rng, 96, 96), 0.12))


def rug(rng: np.random.Generator, palette: Palette) -> Picture:
    """A rug's ornament: bands and lozenges of several colours."""
    x, y = pixels()
    ring = np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) * 2
    lozenge = (np.abs(x * 4 % 1 - 0.5) + np.abs(y * 4 % 1 - 0.5)) * 2
    colors = np.stack([tint(rng, palette) for _ in range(6)])
    index = np.where(ring > 0.75, (ring * 16).astype(int) % 3, 3 + (lozenge * 5).astype(int) % 3)
    return picture(shade(colors[index], noise(rng, 128, 128), 0.1))


def plaster(rng: np.random.Generator, palette: Palette) -> Picture:
    """Painted plaster: nearly plain."""
    return picture(shade(tint(rng, palette), clouds(rng, 8, 5), rng.uniform(0.015, 0.03)))


def roughcast(rng: np.random.Generator, palette: Palette) -> Picture:
    """Rough plaster: small grains that catch the light."""
    rough = clouds(rng, 48, 3)
    return picture(shade(tint(rng, palette), rough - np.roll(rough, 2, 0), 0.10))


def stripes(rng: np.random.Generator, palette: Palette) -> Picture:
    """Wallpaper with upright stripes."""
    x, _ = pixels()
    n = int(rng.integers(4, 10))
    band = (x * n % 1 < rng.uniform(0.3, 0.6))[..., None]
    color = tint(rng, palette)
    return picture(shade(np.where(band, color, 0.93 * color), noise(rng, 90, 90), 0.015))


def dots(rng: np.random.Generator, palette: Palette) -> Picture:
    """Wallpaper with dots in a quincunx."""
    x, y = pixels()
    n = int(rng.integers(5, 9))
    far = [np.hypot((x * n + s) % 1 - 0.5, (y * n + s) % 1 - 0.5) for s in (0.0, 0.5)]
    mark = (np.minimum(*far) < rng.uniform(0.07, 0.16))[..., None]
    color = tint(rng, palette)
    return picture(shade(np.where(mark, 0.82 * color, color), noise(rng, 60, 60), 0.015))


def lattice(rng: np.random.Generator, palette: Palette) -> Picture:
    """Wallpaper with crossing slanted lines."""
    x, y = pixels()
    n = int(rng.integers(5, 9))
    line = (((x + y) * n % 1 < 0.07) | ((x - y) * n % 1 < 0.07))[..., None]
    color = tint(rng, palette)
    return picture(shade(np.where(line, 0.86 * color, color), noise(rng, 70, 70), 0.015))


def damask(rng: np.random.Generator, palette: Palette) -> Picture:
    """Wallpaper with a curled ornament, mirrored left and right."""
    x, y = pixels()
    n = int(rng.integers(3, 5))
    u, v = np.abs(x * n % 1 - 0.5) * 2, y * n % 1
    curl = np.sin(2 * np.pi * (u + 0.35 * np.sin(2 * np.pi * v))) * np.sin(2 * np.pi * (v + u**2))
    color = tint(rng, palette)
    mark = np.clip(curl * 6, -1, 1)
    return picture(shade(color, 0.06 * mark + 0.015 * noise(rng, 60, 60), 1.0))


def panels(rng: np.random.Generator, palette: Palette) -> Picture:
    """Painted boards that stand side by side."""
    x, _ = pixels()
    groove = x * 6 % 1
    edge = -1.0 * (groove < 0.03) + 0.4 * (groove > 0.97)
    return picture(shade(tint(rng, palette), 0.3 * edge + 0.03 * grain(rng).T, 0.6))


def marble(rng: np.random.Generator, palette: Palette) -> Picture:
    """Stone with veins."""
    vein = np.exp(-np.abs(clouds(rng, 3)) * 14)
    return picture(shade(tint(rng, palette), -0.8 * vein + 0.3 * clouds(rng, 2), 0.25))


def granite(rng: np.random.Generator, palette: Palette) -> Picture:
    """Stone of dark and light grains."""
    spots = np.sign(noise(rng, 128, 128)) * (np.abs(noise(rng, 100, 100)) > 0.35)
    return picture(shade(tint(rng, palette), spots + 0.5 * noise(rng, 200, 200), 0.18))


def terrazzo(rng: np.random.Generator, palette: Palette) -> Picture:
    """Chips of several colours in cement."""
    body = shade(tint(rng, palette), clouds(rng, 6), 0.03)
    for _ in range(3):
        chips = (noise(rng, 40, 40) > 0.62)[..., None]
        body = np.where(chips, tint(rng, palette) * rng.uniform(0.6, 1.1), body)
    return picture(body)


def laminate(rng: np.random.Generator, palette: Palette) -> Picture:
    """A plain coloured board with a faint structure."""
    return picture(shade(tint(rng, palette), noise(rng, 128, 128), 0.02))


def gingham(rng: np.random.Generator, palette: Palette) -> Picture:
    """A checked table cloth."""
    x, y = pixels()
    n = int(rng.choice([8, 10, 12]))
    level = (((x * n) % 1 < 0.5).astype(float) + ((y * n) % 1 < 0.5)) / 2
    color = tint(rng, palette)
    cloth = color * level[..., None] + np.array([235, 232, 225]) * (1 - level[..., None])
    return picture(shade(cloth, noise(rng, 200, 200), 0.05))


def print_of(rng: np.random.Generator, palette: Palette) -> Picture:
    """A printed surface (a book's cover, a carton, a painting): patches, bars and a blot."""
    image = np.full((128, 128, 3), tint(rng, palette, 15))
    for _ in range(int(rng.integers(3, 9))):
        color = tuple(float(v) for v in np.clip(tint(rng, palette, 25), 0, 255))
        x, y = (int(v) for v in rng.integers(0, 110, 2))
        w, h = (int(v) for v in rng.integers(6, 70, 2))
        if rng.random() < 0.5:
            cv2.rectangle(image, (x, y), (x + w, y + h), color, -1)
        else:
            cv2.ellipse(image, (x, y), (w // 2, h // 2), float(x), 0, 360, color, -1)
    for row in range(int(rng.integers(0, 5))):
        y = 90 + 7 * row
        cv2.line(image, (14, y), (int(rng.integers(50, 114)), y), (40.0, 40.0, 45.0), 2)
    return picture(image)
