"""sRGB to linear light and back, and the exposure and tone curve between them.

The curve is straight up to half of white and then bends over, so bright spots keep their hue a
little longer than a hard clip would let them.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.render.raycast.interface import Floats

SHOULDER = 0.5
BRIGHTEST = 16.0
"""Light beyond this times white is white whatever the hue."""
N_STEPS = 1 << 14
MIDDLE_GREY = 0.2
"""What automatic exposure makes of the mean of the logarithm of the light."""


@cache
def linear_of_srgb() -> Floats:
    """Linear light (256,) of the 256 values of sRGB."""
    encoded = np.arange(256) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


@cache
def _encoded() -> NDArray[np.uint8]:
    """What is shown of light, (N_STEPS,) at equal steps of its square root."""
    light = BRIGHTEST * (np.arange(N_STEPS) / (N_STEPS - 1)) ** 2
    bent = SHOULDER + (1 - SHOULDER) * (1 - np.exp(-(light - SHOULDER) / (1 - SHOULDER)))
    toned = np.where(light < SHOULDER, light, bent)
    srgb = np.where(toned <= 0.0031308, 12.92 * toned, 1.055 * toned ** (1 / 2.4) - 0.055)
    return np.rint(255 * np.clip(srgb, 0, 1)).astype(np.uint8)


def expose(light: Floats, exposure: float | None) -> NDArray[np.uint8]:
    """What a camera shows of linear light (..., 3).

    Args:
        light: (..., 3) ≥ 0.
        exposure: factor; None chooses it so that the mean of the logarithm becomes middle grey.
    """
    if exposure is None:
        green = light[..., 1][::4, ::4] if light.ndim == 3 else light[..., 1]
        exposure = MIDDLE_GREY / float(np.exp(np.mean(np.log(green + 1e-3)))) if green.size else 1.0
    root = np.sqrt(light * np.float32(exposure / BRIGHTEST))
    steps = np.minimum(root * np.float32(N_STEPS - 1) + np.float32(0.5), N_STEPS - 1)
    return _encoded()[steps.astype(np.uint16)]


def reveal(color: NDArray[np.uint8]) -> Floats:
    """Light that exposure 1 shows as the given sRGB (..., 3): the inverse of the tone curve."""
    toned = linear_of_srgb()[color]
    bent = SHOULDER - (1 - SHOULDER) * np.log(
        np.maximum(1 - (toned - SHOULDER) / (1 - SHOULDER), np.float32(1e-3))
    )
    return np.where(toned < SHOULDER, toned, bent).astype(np.float32)
