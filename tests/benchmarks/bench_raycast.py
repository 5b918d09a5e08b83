"""The renderer, part by part, against a plain cast of the same rays by open3d; `make bench`.

A room of about 130 000 triangles: walls, furniture, two lights and eight objects.
"""

import time

import numpy as np

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import make_transform
from imodbatch.lab.render.raycast import (
    BulbLight,
    Instance,
    Mesh,
    PanelLight,
    Renderer,
    RenderSettings,
    Scene,
    render_view,
    viewpoint_transform,
)
from imodbatch.libraries.open3d_library import open3d

CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)
N_RUNS = 7


def mesh(vertices: np.ndarray, faces: np.ndarray, texture: np.ndarray) -> Mesh:
    """A mesh whose texture lies flat over x and y + z."""
    flat = vertices[faces]
    low, size = flat.min(axis=(0, 1)), np.ptp(flat, axis=(0, 1)) + 1e-6
    share = (flat - low) / size
    uvs = np.stack([share[..., 0], 0.5 * (share[..., 1] + share[..., 2])], axis=-1)
    n = len(faces)
    shine = np.full(n, 0.05, np.float32), np.full(n, 30, np.float32)
    return Mesh(
        vertices.astype(np.float32), faces.astype(np.int32), uvs.astype(np.float32), texture, *shine
    )


def room() -> Scene:
    """Boxes and balls."""
    shapes = open3d().geometry.TriangleMesh
    rng = np.random.default_rng(0)

    def box(low: tuple[float, ...], high: tuple[float, ...]) -> Instance:
        shape = shapes.create_box(*(np.subtract(high, low)))
        texture = rng.integers(90, 230, (256, 256, 3), dtype=np.uint8)
        vertices = np.asarray(shape.vertices) + low
        return Instance(mesh(vertices, np.asarray(shape.triangles), texture), np.eye(4))

    def ball(number: int) -> Instance:
        shape = shapes.create_sphere(0.08, resolution=64)
        texture = rng.integers(0, 255, (512, 512, 3), dtype=np.uint8)
        place = [-0.5 + 0.33 * (number % 4), -0.2 + 0.4 * (number // 4), 0.82]
        item = mesh(np.asarray(shape.vertices), np.asarray(shape.triangles), texture)
        return Instance(item, make_transform(np.eye(3), place), number)

    scenery = [
        box((-3, -2.5, -0.1), (3, 2.5, 0)),
        box((-3.1, -2.5, 0), (-3, 2.5, 2.5)),
        box((3, -2.5, 0), (3.1, 2.5, 2.5)),
        box((-3, 2.5, 0), (3, 2.6, 2.5)),
        box((-3, -2.6, 0), (3, -2.5, 2.5)),
        box((-3, -2.5, 2.5), (3, 2.5, 2.6)),
        box((-0.7, -0.5, 0.70), (0.7, 0.5, 0.74)),
        box((1.2, 1.8, 0), (2.9, 2.45, 0.45)),
        box((-2.9, 1.9, 0), (-1.9, 2.45, 1.9)),
    ]
    lights = (
        BulbLight((0.6, 0.3, 2.2), (1.5, 1.35, 1.1), 0.1),
        PanelLight((-2.9, -0.5, 1.5), (0, 0.6, 0), (0, 0, 0.6), (2.2, 2.4, 2.7)),
    )
    return Scene((*scenery, *(ball(k) for k in range(8))), lights)


def plain_cast(scene: Scene, world_from_cam: np.ndarray) -> float:
    """Milliseconds of open3d's own cast of a frame's rays."""
    o3d = open3d()
    caster = o3d.t.geometry.RaycastingScene()
    for item in scene.instances:
        vertices = item.mesh.vertices @ item.world_from_mesh[:3, :3].T + item.world_from_mesh[:3, 3]
        caster.add_triangles(
            o3d.core.Tensor(vertices.astype(np.float32)),
            o3d.core.Tensor(item.mesh.faces.astype(np.uint32)),
        )
    ahead = CAMERA.unproject(CAMERA.pixel_centers(), 1.0) @ world_from_cam[:3, :3].T
    rays = np.concatenate([np.broadcast_to(world_from_cam[:3, 3], ahead.shape), ahead], -1)
    tensor = o3d.core.Tensor(rays.astype(np.float32))
    times = []
    for _ in range(N_RUNS + 1):
        start = time.perf_counter()
        caster.cast_rays(tensor)
        times.append(time.perf_counter() - start)
    return 1000 * float(np.median(times[1:]))


def main() -> None:
    """Print the figures."""
    scene = room()
    n_faces = sum(len(item.mesh.faces) for item in scene.instances)
    start = time.perf_counter()
    renderer = Renderer(scene)
    built = 1000 * (time.perf_counter() - start)
    look = viewpoint_transform(np.array([0, 0, 0.75]), -1.9, 0.35, 2.3)
    whole, parts = [], []
    for _ in range(N_RUNS + 1):
        start = time.perf_counter()
        renderer.render(CAMERA, look)
        whole.append(1000 * (time.perf_counter() - start))
        parts.append(renderer.seconds)
    frame = float(np.median(whole[1:]))
    peer = plain_cast(scene, look)
    print(f"{n_faces:,} triangles, 640×480: scene built in {built:.0f} ms, frame {frame:.0f} ms")
    for part in parts[0]:
        print(f"  {part:12s} {1000 * np.median([p[part] for p in parts[1:]]):5.0f} ms")
    for name, settings in (
        ("shadow", RenderSettings(ambient_rays=0)),
        ("AO", RenderSettings(shadow_rays=0)),
        ("neither", RenderSettings(shadow_rays=0, ambient_rays=0)),
    ):
        only = Renderer(scene, settings)
        seconds = []
        for _ in range(N_RUNS):
            only.render(CAMERA, look)
            seconds.append(only.seconds["openness"])
        print(f"  openness with {name} alone {1000 * np.median(seconds):.0f} ms")
    print(f"open3d cast_rays alone {peer:.0f} ms; a frame is {frame / peer:.1f} times that")
    times = []
    for azimuth in np.linspace(0, 6, N_RUNS + 1):
        start = time.perf_counter()
        render_view(scene.instances[-1].mesh, float(azimuth), 0.5, 160)
        times.append(1000 * (time.perf_counter() - start))
    print(f"render_view at 160 px: {np.median(times[1:]):.0f} ms")


if __name__ == "__main__":
    main()
