"""Light as it may be in some room: a bright direction, perhaps a second, light from all around."""

import numpy as np

from imodbatch.lab.render.raycast import RenderSettings, Sky, SunLight

Rgb = tuple[float, float, float]


def random_lights(rng: np.random.Generator) -> tuple[tuple[SunLight, ...], Sky, float]:
    """Lights, sky and the exposure that makes a grey card come out dim to bright."""
    strengths = [rng.uniform(0.2, 1.0)]
    if rng.random() < 0.5:
        strengths.append(rng.uniform(0.1, 0.5))
    lights = tuple(
        SunLight(_direction(rng), _tinted(strength, rng), float(rng.uniform(0.03, 0.3)))
        for strength in strengths
    )
    above = float(rng.uniform(0.3, 0.7))
    below = above * float(rng.uniform(0.35, 0.85))
    sky = Sky(_tinted(above, rng), _tinted(below, rng))
    brightness = 0.5 * (above + below) + 0.5 * sum(strengths)
    wanted = np.exp(rng.uniform(np.log(0.45), np.log(1.0)))
    return lights, sky, float(wanted / brightness)


def random_settings(exposure: float, rng: np.random.Generator) -> RenderSettings:
    """Few rays: noise of the light is lost in the noise of the picture."""
    return RenderSettings(
        exposure=exposure, shadow_rays=2, ambient_rays=2, seed=int(rng.integers(1 << 31))
    )


def _direction(rng: np.random.Generator) -> Rgb:
    """Towards a lamp or window: from anywhere around, 20° to 85° above the horizon."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(20, 85))
    return (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )


def _tinted(strength: float, rng: np.random.Generator) -> Rgb:
    """From warm to cold, a little to green or magenta."""
    warm, green = rng.normal(0, 0.07), rng.normal(0, 0.02)
    return (strength * (1 + warm), strength * (1 + green), strength * (1 - warm))
