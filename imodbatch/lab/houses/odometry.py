"""Wheel odometry: the true motion of the base, a little wrong at every step, added up.

Of a step of length d that turns by a, distance is off by a factor that stays the same in a
sequence (sigma 1 %) and by fresh noise (sigma 1 cm per root metre); heading by fresh noise of sigma
1.2 degrees per root metre driven and 0.8 degrees per root radian turned. So after d metres heading
is off by about 1.2 degrees times root d and place by 1 to 3 % of the way, more where a wrong
heading is followed far. The head's joints and the mast are exact, so the camera's pose is the
base's odometry with the true base-to-camera transform. The first pose is true. A robot that stands
still measures that it stands still.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import invert
from imodbatch.lab.houses.drive import Drive
from imodbatch.lab.houses.floorplan import standing

Array = NDArray[np.float64]
SCALE_SIGMA = 0.01
STEP_SIGMA_M = 0.01
DRIVEN_SIGMA_RAD = float(np.deg2rad(1.2))
TURNED_SIGMA_RAD = float(np.deg2rad(0.8))


def odometry(drive: Drive, rng: np.random.Generator) -> Array:
    """``world_from_cam`` (F, 4, 4) as the wheels have it."""
    base = drive.base_xy_yaw
    measured = np.empty_like(base)
    measured[0] = base[0]
    scale = 1 + rng.normal(0, SCALE_SIGMA)
    for k, (here, there) in enumerate(pairwise(base)):
        step, turn = there[:2] - here[:2], there[2] - here[2]
        way = float(np.linalg.norm(step))
        noise = rng.normal(size=3)
        factor = scale + noise[0] * STEP_SIGMA_M * np.sqrt(way) / max(way, 1e-9)
        heading = measured[k, 2] - here[2]
        c, s = np.cos(heading), np.sin(heading)
        moved = np.array([c * step[0] - s * step[1], s * step[0] + c * step[1]])
        measured[k + 1, :2] = measured[k, :2] + (factor if way > 1e-9 else 1.0) * moved
        off = noise[1] * DRIVEN_SIGMA_RAD * np.sqrt(way)
        off += noise[2] * TURNED_SIGMA_RAD * np.sqrt(abs(turn))
        measured[k + 1, 2] = measured[k, 2] + turn + off
    return np.stack(
        [
            standing(mx, my, 0.0, ma) @ invert(standing(x, y, 0.0, a)) @ true
            for (mx, my, ma), (x, y, a), true in zip(
                measured, base, drive.world_from_cam, strict=True
            )
        ]
    )
