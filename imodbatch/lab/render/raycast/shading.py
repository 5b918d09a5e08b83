"""Light that points send to the viewer (Blinn–Phong, normalised, with Schlick's Fresnel term)."""

import numpy as np

from imodbatch.lab.render.raycast.interface import Floats, Scene, Sky
from imodbatch.lab.render.raycast.lights import FAINT, arriving
from imodbatch.lab.render.raycast.surfaces import Paint, Places, dot, length
from imodbatch.lab.render.raycast.tone import reveal


def shade(scene: Scene, places: Places, paint: Paint, openness: Floats) -> Floats:
    """Linear RGB (3, N).

    Args:
        scene: its lights and sky.
        places: N points.
        paint: what they are made of.
        openness: (C, N) share in view of each light, the sky last.
    """
    light, gloss = _from_sky(scene.sky, places, paint, openness[-1])
    for source, in_view in zip(scene.lights, openness, strict=False):
        direction, strength, half_angle = arriving(source, places.position)
        received = np.maximum(dot(places.normal, direction), 0) * strength * in_view
        if received.max(initial=0) * max(source.intensity) < FAINT:
            continue
        highlight = received * _highlight(places, paint, direction, half_angle)
        for channel, strength_of_color in enumerate(source.intensity):
            light[channel] += np.float32(strength_of_color) * received
            gloss[channel] += np.float32(strength_of_color) * highlight
    light *= paint.albedo
    light += gloss
    return light


def _from_sky(sky: Sky, places: Places, paint: Paint, openness: Floats) -> tuple[Floats, Floats]:
    """Diffuse light and gloss of the sky (3, N) each.

    A corner is not black: it is lit by what its own walls throw back, the more the lighter they
    are (Jimenez et al. 2016 fitted this polynomial to path-traced pictures).
    """
    below = np.asarray(sky.from_below, np.float32)[:, None]
    more = np.asarray(sky.from_above, np.float32)[:, None] - below
    albedo = paint.albedo.mean(axis=0)
    a, b, c = 2.0404 * albedo - 0.3324, -4.7951 * albedo + 0.6417, 2.7552 * albedo + 0.6903
    opened = np.maximum(openness, ((openness * a + b) * openness + c) * openness)
    up = places.normal[2]
    diffuse = opened * below + (opened * (0.5 + 0.5 * up)) * more
    cosine = dot(places.normal, places.to_viewer)
    mirrored_up = 2 * cosine * up - places.to_viewer[2]
    reflected = _fresnel(paint.specular, cosine) * _smoothness(paint.shininess) * openness
    gloss = reflected * below + (reflected * (0.5 + 0.5 * mirrored_up)) * more
    return diffuse, gloss


def _highlight(places: Places, paint: Paint, direction: Floats, half_angle: Floats) -> Floats:
    """The lobe (N,) about the mirrored light; a wide light makes it wider and lower."""
    halfway = direction + places.to_viewer
    aligned = dot(places.normal, halfway) / np.maximum(length(halfway), np.float32(1e-6))
    shininess = 1 / (1 / paint.shininess + np.float32(0.5) * half_angle * half_angle)
    lobe = np.exp(shininess * np.log(np.clip(aligned, np.float32(1e-6), 1)))
    return paint.specular * (shininess + 8) * np.float32(0.125) * lobe


def _fresnel(specular: Floats, cosine: Floats) -> Floats:
    """Reflectance (N,): more at grazing angles, but only of what shines at all."""
    away = np.clip(1 - cosine, 0, 1)
    grazing = np.minimum(np.float32(8) * specular, np.float32(1)) - specular
    square = away * away
    return specular + np.maximum(grazing, 0) * square * square * away


def _smoothness(shininess: Floats) -> Floats:
    """Rough surfaces (N,) scatter at grazing angles what smooth ones would mirror."""
    return shininess / (shininess + np.float32(50))


def backdrop(sky: Sky, directions: Floats) -> Floats:
    """Linear RGB (3, N) that exposure 1 shows as the background in directions (3, N)."""
    image = np.asarray(sky.background, dtype=np.uint8)
    if image.ndim == 1:
        return np.broadcast_to(reveal(image)[:, None], directions.shape)
    if image.ndim == 2:
        image = image[:, None]
    height, width = image.shape[:2]
    ahead = directions / length(directions)
    polar = np.arccos(np.clip(ahead[2], -1, 1)) / np.float32(np.pi)
    azimuth = np.arctan2(ahead[1], ahead[0])
    across = np.float32(0.5) - azimuth / np.float32(2 * np.pi)
    if sky.background.shape[0] > 1 and image.shape[1] == 1:  # type: ignore[union-attr]
        y = polar * (height - 1)
    else:
        y = np.clip(polar * height - np.float32(0.5), 0, height - 1)
    x = across * width - np.float32(0.5)
    left, top = np.floor(x).astype(np.int64), np.minimum(y.astype(np.int64), height - 1)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    bottom, x0, x1 = np.minimum(top + 1, height - 1), left % width, (left + 1) % width
    light = reveal(image)
    upper = light[top, x0] * (1 - fx) + light[top, x1] * fx
    lower = light[bottom, x0] * (1 - fx) + light[bottom, x1] * fx
    return (upper * (1 - fy) + lower * fy).T
