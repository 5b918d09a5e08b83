"""Placed models become a renderer's scene, each mesh converted once."""

import numpy as np
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import make_transform
from imodbatch.lab.mesh import ObjectModel, Surface, TexturedMesh
from imodbatch.lab.render.raycast import BulbLight, RenderSettings, Sky, viewpoint_transform
from imodbatch.lab.scene import PlacedModel, make_renderer, make_scene, render_view

CAMERA = PinholeCamera(120, 90, 110.0, 110.0, 60.0, 45.0)


def block(size_m=0.2, color=(200, 40, 40)) -> ObjectModel:
    """A box that stands on z = 0; its lid shines."""
    h = size_m / 2
    x, y, z = np.meshgrid([-h, h], [-h, h], [0.0, size_m], indexing="ij")
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    mesh = TexturedMesh(
        vertices,
        faces,
        np.full((12, 3, 2), 0.5, np.float32),
        np.full((2, 2, 3), color, np.uint8),
        np.array([0] * 10 + [1] * 2, np.int16),
        (Surface(), Surface(0.5, 80.0)),
    )
    return ObjectModel("block", mesh)


def test_placed_models_stand_where_they_are_put():
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    placed = [
        PlacedModel(block(), make_transform(np.eye(3), [-0.3, 0, 0]), 7),
        PlacedModel(block(0.3), make_transform(turn, [0.3, 0, 0]), 2),
        PlacedModel(block(4.0), make_transform(np.eye(3), [0, 0, -4.0])),
    ]
    renderer = make_renderer(placed, [BulbLight((0.0, -1.0, 2.0))], Sky())
    look = viewpoint_transform(np.array([0, 0, 0.1]), -np.pi / 2, 0.5, 2.0)
    frame = renderer.render(CAMERA, look)
    assert [view.instance_id for view in frame.views] == [7, 2]
    assert set(np.unique(frame.instance_ids)) == {-1, 2, 7}
    assert np.isfinite(frame.depth_m).any()
    columns = [np.nonzero(frame.instance_ids == number)[1].mean() for number in (7, 2)]
    assert columns[0] < 55
    assert columns[1] > 65
    rows, columns = np.nonzero(np.isfinite(frame.depth_m))
    points = CAMERA.unproject(np.stack([columns, rows], -1) + 0.5, frame.depth_m[rows, columns])
    world = points @ look[:3, :3].T + look[:3, 3]
    mine = frame.instance_ids[rows, columns] == 2
    assert world[mine].min(axis=0) == pytest.approx([0.15, -0.15, 0], abs=0.02)  # a pixel
    assert world[mine][:, [0, 2]].max(axis=0) == pytest.approx([0.45, 0.3], abs=0.01)


def test_a_mesh_is_converted_once_and_parts_keep_their_shine():
    model = block()
    placed = [PlacedModel(model, np.eye(4), k) for k in range(3)]
    scene = make_scene(placed, [])
    assert len({id(instance.mesh) for instance in scene.instances}) == 1
    assert scene.instances[0].mesh.face_specular[-1] == np.float32(0.5)
    assert scene.instances[0].mesh.face_shininess[0] == 20


def test_renderer_is_reused_and_reports_its_times():
    renderer = make_renderer([PlacedModel(block(), np.eye(4), 0)], [], None, RenderSettings())
    look = viewpoint_transform(np.zeros(3), 0.3, 0.5, 1.5)
    first, again = renderer.render(CAMERA, look), renderer.render(CAMERA, look)
    assert np.array_equal(first.color, again.color)
    assert {"cast", "shade", "visibility"} <= set(renderer.seconds)


def test_view_of_a_model():
    picture = render_view(block(), 0.5, 0.4, 80)
    assert picture.shape == (80, 80, 4)
    assert picture.dtype == np.uint8
    inside = picture[..., 3] == 255
    assert 0.2 < inside.mean() < 0.8
    red, green = picture[inside][:, 0].mean(), picture[inside][:, 1].mean()
    assert red > 2 * green
