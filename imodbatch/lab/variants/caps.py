"""Caps that lie on their opening: a sewn crown, a button, and a bent brim in front (+x)."""

from dataclasses import replace

import cv2
import numpy as np

from imodbatch.lab.mesh import ObjectModel, Surface
from imodbatch.lab.objects.assembly import assemble
from imodbatch.lab.objects.charts import box_mapped
from imodbatch.lab.objects.curves import Outline
from imodbatch.lab.objects.paint import Colour, noise, plain, shaded
from imodbatch.lab.objects.part import Array, Part, Picture
from imodbatch.lab.objects.primitives import Strip, ellipsoid, lathe, sandwich
from imodbatch.lab.variants.grounds import blend, disc, flat, seed
from imodbatch.lab.variants.lettering import word
from imodbatch.lab.variants.palettes import (
    Rng,
    Shades,
    any_colour,
    brand,
    brightness,
    from_shades,
    hsv,
    mixed,
    readable_on,
    vivid,
)
from imodbatch.lab.variants.small_print import fill, logo

_WIDTH, _HEIGHT = 480, 190
_BRIM_PX = 160
_CLOTH = Surface(0.03, 6)
_CLOTHS: Shades = (
    (0.18, (0.0, 1.0), (0.0, 0.2), (0.06, 0.18)),
    (0.16, (0.58, 0.66), (0.5, 0.9), (0.15, 0.45)),
    (0.12, (0.08, 0.13), (0.2, 0.5), (0.4, 0.85)),
    (0.1, (0.0, 1.0), (0.0, 0.06), (0.82, 0.96)),
    (0.12, (0.95, 1.02), (0.7, 0.95), (0.4, 0.8)),
    (0.08, (0.0, 1.0), (0.06, 0.06), (0.25, 0.7)),
    (0.12, (0.0, 1.0), (0.1, 0.6), (0.15, 0.9)),
    (0.12, (0.0, 1.0), (0.65, 1.0), (0.5, 1.0)),
)


def make_cap(rng: Rng) -> ObjectModel:
    """A cap."""
    half_width = rng.uniform(7.6, 8.8)
    half_length = half_width * rng.uniform(1.08, 1.25)
    height = rng.uniform(8.0, 11.8)
    cloth = _cloth_colour(rng)
    front = cloth if rng.random() < 0.6 else _cloth_colour(rng)
    back = cloth if rng.random() < 0.8 else _cloth_colour(rng)
    brim_colour = cloth if rng.random() < 0.5 else _cloth_colour(rng)
    pattern = int(rng.choice(5, p=[0.62, 0.1, 0.12, 0.08, 0.08]))
    picture = _crown_picture(rng, cloth, front, back, pattern)
    power = rng.uniform(2.0, 3.4)
    crown = _crown(rng, half_length, half_width, height, power, picture)
    parts = [crown]
    top = crown.vertices[crown.vertices[:, 2].argmax()]
    if rng.random() < 0.9:
        paint = plain(brim_colour if rng.random() < 0.5 else front)
        button = ellipsoid((0.75, 0.75, 0.4), paint, _CLOTH, 16)
        parts.append(button.moved(top[0], top[1], top[2] + 0.08))
    parts.append(_brim(rng, half_length, half_width, brim_colour, pattern, cloth))
    return assemble("cap", parts)


def _cloth_colour(rng: Rng) -> Colour:
    """Navy, black, khaki, white, red, grey and others."""
    return from_shades(rng, _CLOTHS)


def _ellipse(half_length: float, half_width: float, n: int = 72) -> Outline:
    """Ellipses; a radius of 1 is the whole one."""
    angles = np.linspace(-np.pi, np.pi, n, endpoint=False)
    unit = np.stack([half_length * np.cos(angles), half_width * np.sin(angles)], axis=1)
    return lambda radius: radius * unit


def _crown(
    rng: Rng, half_length: float, half_width: float, height: float, power: float, picture: Picture
) -> Part:
    """The dome: steeper in front, perhaps flattened, leaning or dented; closed below."""
    angle = np.linspace(0, np.pi / 2, 22)
    dome = [
        (float(np.cos(a) ** (2 / power)) if a < np.pi / 2 - 1e-6 else 0.0,
         float(height * np.sin(a) ** (2 / min(power, 2.4))))
        for a in angle
    ]  # fmt: skip
    lining = plain(mixed((40, 40, 44), (120, 116, 110), rng.random()))
    crown = lathe(
        [Strip([(0, 0), (0.5, 0), dome[0]], lining), Strip(dome, picture)],
        _CLOTH,
        _ellipse(half_length, half_width),
        60.0,
    )
    v = crown.vertices.copy()
    up = np.clip(v[:, 2] / height, 0, 1)
    # The front panels stand upright, so the top lies forward of the middle.
    v[:, 0] += rng.uniform(-0.2, 1.6) * up**2
    v[:, 1] += rng.normal(0, 0.3) * up**2
    azimuth = np.arctan2(v[:, 1], v[:, 0])
    ribs = 1 - rng.uniform(0.0, 0.025) * np.abs(np.cos(3 * azimuth)) ** 8 * np.sin(np.pi * up)
    v[:, :2] *= ribs[:, None]
    deep = 0.17 if rng.random() < 0.35 else 0.08
    for _ in range(rng.integers(0, 5)):  # Soft dents.
        at = rng.uniform(-np.pi, np.pi)
        level = rng.uniform(0.3, 1.0)
        apart = np.angle(np.exp(1j * (azimuth - at))) ** 2 / 0.35 + (up - level) ** 2 / 0.05
        dent = rng.uniform(-0.03, deep) * np.exp(-apart) * np.clip(3 * up, 0, 1)
        v *= np.where(v[:, 2:] > 0, 1 - dent[:, None], 1.0)
    return replace(crown, vertices=v)


def _crown_picture(rng: Rng, cloth: Colour, front: Colour, back: Colour, pattern: int) -> Picture:
    """Panels, seams, stitches, eyelets, the badge, and the opening behind."""
    w, h = _WIDTH, _HEIGHT
    picture = flat(h, w, cloth)
    panel = w // 6
    picture[:, w // 2 - panel : w // 2 + panel] = front
    picture[:, : panel // 2 * 2] = back
    picture[:, -panel:] = back
    if pattern:
        picture = _patterned(rng, picture, pattern)
    if rng.random() < 0.2:  # Mesh behind and at the sides.
        y, x = np.mgrid[:h, :w]
        holes = ((x % 6 < 3) & ((y + 3 * (x // 6 % 2)) % 6 < 3)) & (abs(x - w / 2) > panel)
        picture[holes] = mixed(back, (30, 30, 30), 0.7)
    picture = _woven(rng, picture)
    thread = (
        mixed(front, (255, 255, 255), 0.35) if rng.random() < 0.4 else mixed(cloth, (0, 0, 0), 0.3)
    )
    offset = 0 if rng.random() < 0.8 else panel // 2
    for k in range(6):
        x = (w // 2 + panel * k + offset) % w
        cv2.line(picture, (x, 0), (x, h), mixed(cloth, (0, 0, 0), 0.5), 1)
        for side in (-4, 4):
            for y in range(0, h, 5):
                cv2.line(picture, (x + side, y), (x + side, y + 2), thread, 1)
        eyelet = ((x + panel // 2) % w, int(0.36 * h))
        disc(picture, eyelet, 3.6, thread)
        disc(picture, eyelet, 1.8, (16, 16, 18))
    if rng.random() < 0.6:
        _opening(rng, picture, back)
    if rng.random() < 0.75:
        _badge(rng, picture, front)
    return picture


def _badge(rng: Rng, picture: Picture, front: Colour) -> None:
    """What is sewn or printed on the front."""
    w, h = _WIDTH, _HEIGHT
    ink = readable_on(front, (vivid(rng), any_colour(rng), (250, 250, 246)), rng)
    at = (w / 2, h * rng.uniform(0.5, 0.62))
    kind = rng.integers(4)
    if kind == 0:
        letters = brand(rng)[: rng.integers(1, 3)].upper()
        edge = vivid(rng) if rng.random() < 0.5 else None
        word(picture, rng, letters, at, (60, rng.uniform(40, 64)), ink, edge)
    elif kind == 1:
        word(picture, rng, brand(rng), at, (rng.uniform(70, 120), 40), ink)
    elif kind == 2:
        x, y, half = int(at[0]), int(at[1]), int(rng.uniform(22, 40))
        high = int(half * rng.uniform(0.5, 1))
        fill(picture, (x - half, y - high, x + half, y + high), ink)
        word(picture, rng, brand(rng), at, (1.7 * half, high), front)
    else:
        logo(picture, rng, at, rng.uniform(22, 40), ink)
    picture[:] = _stitched(picture, seed(rng))


def _stitched(picture: Picture, number: int) -> Picture:
    """A faint thread structure."""
    return shaded(picture, 1 + 0.03 * noise(picture.shape[0], picture.shape[1], number, (1.6, 0.5)))


def _opening(rng: Rng, picture: Picture, back: Colour) -> None:
    """The half-round hole behind, and the strap below it."""
    h = _HEIGHT
    half = int(rng.uniform(20, 30))
    inside = mixed(back, (18, 18, 20), 0.85)
    high = int(h * rng.uniform(0.2, 0.3))
    for x in (0, _WIDTH - 1):
        cv2.ellipse(picture, (x, h - 18), (half, high), 0, 180, 360, inside, -1, cv2.LINE_AA)
        cv2.ellipse(picture, (x, h - 18), (half + 2, high + 2), 0, 180, 360,
                    mixed(back, (255, 255, 255), 0.15), 2, cv2.LINE_AA)  # fmt: skip
        for k in range(-3, 4):
            cv2.circle(picture, (x + 8 * k, h - 9), 2, inside, -1, cv2.LINE_AA)


def _patterned(rng: Rng, picture: Picture, pattern: int) -> Picture:
    """Denim (1), camouflage (2), checks (3), stripes or washed patches (4)."""
    h, w = picture.shape[:2]
    if pattern == 1:
        blue = hsv(rng.uniform(0.57, 0.62), rng.uniform(0.35, 0.7), rng.uniform(0.3, 0.65))
        worn = noise(h, w, seed(rng), (14, 14)) + 0.8 * noise(h, w, seed(rng), (0.6, 2.5))
        return shaded(flat(h, w, blue), 1 + 0.1 * worn)
    if pattern == 2:
        hue = rng.choice([0.1, 0.22, 0.28, 0.6])
        tones = [
            hsv(hue + rng.normal(0, 0.03), rng.uniform(0.15, 0.5), v)
            for v in (0.62, 0.45, 0.3, 0.14)
        ]
        level = noise(h, w, seed(rng), (13, 8))
        shades = np.array(tones, np.uint8)
        return np.asarray(shades[np.digitize(level, [-0.6, 0.2, 0.9])])
    y, x = np.mgrid[:h, :w]
    other = any_colour(rng)
    if pattern == 3:
        step = 2 * np.pi * rng.integers(12, 30) / w
        share = 0.3 * (np.sin(step * x) > 0) + 0.3 * (np.sin(step * y) > 0)
    else:
        share = 0.4 + 0.25 * noise(h, w, seed(rng), (20, 20))
        if rng.random() < 0.5:
            share = np.asarray((np.sin(2 * np.pi * rng.integers(12, 40) * x / w) > 0.3) * 0.9)
    base = picture[h // 2, w // 4]
    return blend((int(base[0]), int(base[1]), int(base[2])), other, share)


def _woven(rng: Rng, picture: Picture) -> Picture:
    """Cloth: fine twill, and soft wear."""
    h, w = picture.shape[:2]
    y, x = np.mgrid[:h, :w]
    twill = 0.03 * np.sin(2 * np.pi * (x + y) / 4.0)
    soft = 0.05 * noise(h, w, seed(rng), (18, 18)) + 0.035 * noise(h, w, seed(rng), (0.7, 0.7))
    lifted = 10 + picture.astype(np.float64) * (225 / 255)
    return shaded(lifted, 1 + twill + soft)  # type: ignore[arg-type]


def _brim(
    rng: Rng, half_length: float, half_width: float,
    colour: Colour, pattern: int, cloth: Colour,
) -> Part:  # fmt: skip
    """A sheet from the crown's front edge forward, bent down at its sides."""
    length = rng.uniform(6.2, 8.4)
    spread = np.deg2rad(rng.uniform(66, 82))
    curve = rng.uniform(0.2, 3.6) if rng.random() < 0.8 else 0.1
    droop = rng.uniform(-0.02, 0.12)
    s = np.linspace(-1, 1, 41)[:, None]
    v = np.linspace(0, 1, 13)[None]
    angle = s * spread
    x_in, y_in = 0.93 * half_length * np.cos(angle), 0.97 * half_width * np.sin(angle)
    bow = np.clip(1 - np.abs(s) ** rng.uniform(2.2, 3.4), 0, 1) ** rng.uniform(0.6, 0.8)
    x = x_in + v * (length + 0.07 * half_length) * bow
    y = y_in * (1 + 0.02 * v)
    reach = np.abs(y) / (half_width * np.sin(spread))
    z = curve * (1 - reach**2) - droop * v * length * bow + 0.12
    z = np.maximum(z, 0.12)
    thick = 0.28
    bottom = np.stack([x, y, z], axis=-1)
    upper = bottom + np.array([0, 0, thick])
    picture = _brim_picture(rng, upper, colour, pattern, cloth)
    under = plain(
        mixed(colour, (20, 20, 20), rng.uniform(0.1, 0.6))
        if rng.random() < 0.7
        else any_colour(rng)
    )
    part = sandwich(upper, bottom, picture, _CLOTH, 50.0)
    edge = plain(mixed(colour, (0, 0, 0), 0.15) if rng.random() < 0.8 else vivid(rng))
    return box_mapped(part, edge, top=picture, bottom=under)


def _brim_picture(rng: Rng, sheet: Array, colour: Colour, pattern: int, cloth: Colour) -> Picture:
    """The brim from above, with rows of stitches along its edge."""
    w, h = 300, _BRIM_PX
    picture = flat(h, w, colour)
    if pattern in (1, 2) and colour == cloth:
        picture = _patterned(rng, picture, pattern)
    picture = _woven(rng, picture)
    low, high = sheet.min(axis=(0, 1)), sheet.max(axis=(0, 1))
    dark = brightness(colour) < 0.35
    thread = mixed(colour, (255, 255, 255) if dark else (0, 0, 0), rng.uniform(0.1, 0.35))
    rows = np.linspace(1, 0.15, int(rng.integers(4, 9))) - 0.05
    for row in rows if rng.random() < 0.85 else ():
        line = sheet[:, 0] + row * (sheet[:, -1] - sheet[:, 0])
        share = (line - low) / (high - low)
        pixels = np.stack([share[:, 1] * w, share[:, 0] * h], axis=1)
        cv2.polylines(picture, [np.round(pixels).astype(np.int32)], False, thread, 1, cv2.LINE_AA)
    return picture
