"""Motifs of prints: fruit, bursts, cartoon animals, bowls of cereal, and the like of photographs.

They are drawn in place on (H, W, 3) uint8 pictures.
"""

import cv2
import numpy as np

from imodbatch.lab.objects.paint import Colour, Point, noise, shaded
from imodbatch.lab.objects.part import Picture
from imodbatch.lab.variants.grounds import blend, disc, seed
from imodbatch.lab.variants.lettering import stamp
from imodbatch.lab.variants.palettes import Rng, any_colour, hsv, mixed, vivid

_AA = cv2.LINE_AA


def polygon(picture: Picture, points: np.ndarray, colour: Colour) -> None:
    """A filled polygon (P, 2) with smooth edges."""
    cv2.fillPoly(picture, [np.round(np.asarray(points) * 16).astype(np.int32)], colour, _AA, 4)


def ball(
    picture: Picture, rng: Rng, centre: tuple[float, float], radius: float, colour: Colour
) -> None:
    """A shaded, slightly uneven ball: fruit, a nut, a puff of cereal."""
    size = max(6, int(2.3 * radius))
    y, x = (np.mgrid[:size, :size] - (size - 1) / 2) / radius
    bent = 1 + 0.06 * np.sin(rng.integers(2, 6) * np.arctan2(y, x) + 6 * rng.random())
    r = np.hypot(x, y * rng.uniform(0.9, 1.2)) / bent
    light = 1.15 - 0.55 * r**2 - 0.25 * (x + y) * 0.7
    skin = 1 + rng.uniform(0.02, 0.1) * noise(size, size, seed(rng), (1.2, 1.2))
    body = np.clip(np.array(colour) * (light * skin)[..., None], 0, 255)
    shine = np.exp(-((x + 0.35) ** 2 + (y + 0.4) ** 2) * 14)[..., None]
    body = np.round(body + (255 - body) * 0.7 * shine).astype(np.uint8)
    mask = np.clip((1 - r) * radius + 0.5, 0, 1) * 255
    stamp(picture, mask.astype(np.uint8), centre, body)


def fruit(picture: Picture, rng: Rng, centre: tuple[float, float], radius: float) -> None:
    """A fruit: a ball with a leaf, a bunch of berries, or a slice."""
    kind = rng.integers(4)
    hue = rng.choice([0.0, 0.97, 0.06, 0.1, 0.15, 0.28, 0.75, 0.65, 0.92])
    colour = hsv(hue, rng.uniform(0.75, 1), rng.uniform(0.6, 1))
    x, y = centre
    if kind == 0:
        for _ in range(rng.integers(4, 9)):
            at = (x + radius * rng.uniform(-0.6, 0.6), y + radius * rng.uniform(-0.6, 0.6))
            ball(picture, rng, at, radius * 0.42, colour)
    elif kind == 1:
        disc(picture, centre, radius, colour)
        disc(picture, centre, radius * 0.9, (255, 246, 220))
        disc(picture, centre, radius * 0.84, mixed(colour, (255, 230, 120), 0.4))
        for angle in np.arange(9) * 2 * np.pi / 9 + rng.random():
            end = (x + 0.84 * radius * np.cos(angle), y + 0.84 * radius * np.sin(angle))
            _line(picture, centre, end, (255, 246, 220), max(1, radius / 14))
    else:
        ball(picture, rng, centre, radius, colour)
    if kind:
        leaf = np.array([[0, 0], [0.5, -0.45], [1.1, -0.4], [0.6, 0.05]]) * radius * 0.8
        polygon(
            picture, leaf + np.array([x, y - 0.85 * radius]), hsv(0.32, 0.8, rng.uniform(0.35, 0.7))
        )


def _line(picture: Picture, a: Point, b: Point, colour: Colour, width: float) -> None:
    """A line."""
    cv2.line(picture, _px(a), _px(b), colour, max(1, round(width)), _AA)


def _px(point: Point) -> tuple[int, int]:
    """The nearest pixel."""
    return round(point[0]), round(point[1])


def burst(
    picture: Picture, rng: Rng, centre: tuple[float, float], radius: float, colour: Colour
) -> None:
    """A star with many points, as offers are printed on."""
    n = int(rng.integers(5, 18))
    angle = np.arange(2 * n) * np.pi / n + rng.random()
    reach = radius * np.where(np.arange(2 * n) % 2, rng.uniform(0.45, 0.85), 1)
    polygon(picture, np.stack([np.cos(angle), np.sin(angle)], 1) * reach[:, None] + centre, colour)


def mascot(picture: Picture, rng: Rng, centre: tuple[float, float], radius: float) -> None:
    """A cartoon animal's head: ears, eyes, a snout."""
    x, y = centre
    skin = hsv(rng.choice([0.07, 0.1, 0.13, 0.0, 0.33, 0.55, 0.8]), rng.uniform(0.3, 0.9), 0.85)
    pale, black = mixed(skin, (255, 250, 235), 0.7), (24, 20, 24)
    apart, up = rng.uniform(0.5, 0.95), rng.uniform(0.6, 1.2)
    body = np.array([[-1, 2.6], [-0.9, 1], [0.9, 1], [1, 2.6]]) * radius
    polygon(picture, body + np.array([x, y]), vivid(rng))
    for side in (-1, 1):
        at = (x + side * apart * radius, y - up * radius)
        disc(picture, at, radius * 0.42, skin)
        disc(picture, at, radius * 0.24, pale)
    ball(picture, rng, centre, radius, skin)
    disc(picture, (x, y + 0.45 * radius), radius * rng.uniform(0.4, 0.55), pale)
    disc(picture, (x, y + 0.3 * radius), radius * 0.15, black)
    for side in (-1, 1):
        at = (x + side * 0.36 * radius, y - 0.25 * radius)
        disc(picture, at, radius * 0.26, (255, 255, 255))
        disc(picture, (at[0] + 0.05 * radius, at[1] + 0.05 * radius), radius * 0.13, black)
    mouth = _px((x, y + 0.5 * radius))
    cv2.ellipse(
        picture, mouth, (round(radius * 0.3), round(radius * 0.2)), 0, 0, 180, black, 2, _AA
    )


def cereal_bowl(picture: Picture, rng: Rng, centre: tuple[float, float], radius: float) -> None:
    """A bowl of flakes, rings or puffs in milk, seen from half above."""
    x, y = centre
    china = hsv(rng.random(), rng.choice([0.02, 0.7]), rng.uniform(0.75, 1))
    for depth in np.linspace(1, 0, 10):
        tone = mixed(china, (0, 0, 0), 0.35 * depth)
        half = (round(radius * (1 - 0.45 * depth**1.5)), round(radius * 0.42 * (1 - 0.4 * depth)))
        cv2.ellipse(picture, _px((x, y + radius * 0.75 * depth)), half, 0, 0, 360, tone, -1, _AA)
    cv2.ellipse(picture, _px(centre), (round(radius * 0.93), round(radius * 0.37)), 0, 0, 360,
                (252, 250, 240), -1, _AA)  # fmt: skip
    hue, kind, coloured = rng.uniform(0.07, 0.12), rng.integers(3), rng.random() < 0.25
    for _ in range(60):
        angle, reach = rng.uniform(0, 2 * np.pi), np.sqrt(rng.random()) * 0.82
        at = (
            x + radius * reach * np.cos(angle),
            y - 0.05 * radius + 0.33 * radius * reach * np.sin(angle),
        )
        colour = hsv(
            rng.random() if coloured else hue, rng.uniform(0.5, 0.85), rng.uniform(0.5, 0.95)
        )
        grain = radius * rng.uniform(0.08, 0.12)
        if kind == 0:
            half = (round(grain * 1.3), round(grain * 0.8))
            cv2.ellipse(picture, _px(at), half, rng.uniform(0, 180), 0, 360, colour, -1, _AA)
        elif kind == 1:
            cv2.circle(picture, _px(at), round(grain), colour, max(2, round(grain * 0.7)), _AA)
        else:
            ball(picture, rng, at, grain, colour)
    for _ in range(rng.integers(0, 4)):
        at = (x + radius * rng.uniform(-0.6, 0.6), y - radius * rng.uniform(0.05, 0.25))
        fruit(picture, rng, at, radius * rng.uniform(0.14, 0.22))


def photograph(rng: Rng, height: int, width: int) -> Picture:
    """Something like a photograph: soft uneven light, a horizon, shaded round things."""
    sky, earth = any_colour(rng), any_colour(rng)
    y, _ = np.mgrid[:height, :width] / np.array([height, width])[:, None, None]
    wave = noise(height, width, seed(rng), (width / 6, height / 8))
    picture = blend(sky, earth, (y - rng.uniform(0.2, 0.9) + 0.08 * wave) * rng.choice([2, 12]))
    picture = shaded(picture, 1 + 0.12 * noise(height, width, seed(rng), (3, 3)))
    for _ in range(rng.integers(1, 8)):
        at = (rng.random() * width, rng.random() * height)
        ball(picture, rng, at, rng.uniform(0.06, 0.3) * height, any_colour(rng))
    return picture
