"""Depth registration against open3d's projection of the same cloud; `make bench`."""

import time

import numpy as np

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import register
from imodbatch.libraries.open3d_library import open3d

DEPTH = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
COLOR = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)


def with_open3d(depth_m: np.ndarray) -> np.ndarray:
    """The same by open3d's tensor API, which puts pixel centres at integers."""
    o3d = open3d()

    def matrix(camera: PinholeCamera) -> object:
        k = [
            [camera.fx_px, 0, camera.cx_px - 0.5],
            [0, camera.fy_px, camera.cy_px - 0.5],
            [0, 0, 1],
        ]
        return o3d.core.Tensor(np.array(k))

    image = o3d.t.geometry.Image(o3d.core.Tensor(np.nan_to_num(depth_m)))
    cloud = o3d.t.geometry.PointCloud.create_from_depth_image(image, matrix(DEPTH), depth_scale=1.0)
    size = (COLOR.width_px, COLOR.height_px)
    projected = cloud.project_to_depth_image(*size, matrix(COLOR), depth_scale=1.0, depth_max=10.0)
    return np.asarray(projected)[..., 0]


def seconds(function: object) -> float:
    """Median of seven runs."""
    times = []
    for _ in range(7):
        start = time.perf_counter()
        function()  # type: ignore[operator]
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def main() -> None:
    """Print the figures."""
    rng = np.random.default_rng(0)
    row = np.linspace(1.0, 3.0, DEPTH.height_px)[:, None]
    depth_m = (row + 0.5 * (rng.random((1, DEPTH.width_px)) < 0.1)).astype(np.float32)
    ours, theirs = register(depth_m, DEPTH, COLOR), with_open3d(depth_m)
    both = np.isfinite(ours) & (theirs > 0)
    agreement = float((np.abs(ours[both] - theirs[both]) < 0.01).mean())
    a, b = seconds(lambda: register(depth_m, DEPTH, COLOR)), seconds(lambda: with_open3d(depth_m))
    apart = seconds(lambda: register(depth_m, DEPTH, COLOR, np.eye(4)))
    print(
        f"registration of 640×480: own {1000 * a:.1f} ms ({1000 * apart:.0f} ms with a z-buffer, "
        f"as for cameras that stand apart), open3d {1000 * b:.0f} ms, "
        f"ratio {a / b:.2f}; within 1 cm on {100 * agreement:.1f} % of the pixels both have"
    )


if __name__ == "__main__":
    main()
