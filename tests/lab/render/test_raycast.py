"""The renderer against closed forms: depth, outlines, shadows, texture, exposure."""

from dataclasses import replace

import numpy as np
import pytest

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
    Sky,
    SunLight,
    render_view,
    viewpoint_transform,
)

CAMERA = PinholeCamera(160, 120, 150.0, 150.0, 80.0, 60.0)
DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 3], [0, 0, 0, 1]])
"""A camera 3 m up that looks straight down, its right along +x, its top along +y."""
FAST = RenderSettings(shadow_rays=2, ambient_rays=0)


def grid_mesh(corners, texture=None, normals=None):
    """A quadrilateral: corners at uv (0, 0), (1, 0), (1, 1), (0, 1)."""
    texture = np.full((2, 2, 3), 255, np.uint8) if texture is None else texture
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)[faces]
    shine = np.zeros(2, np.float32), np.full(2, 20, np.float32)
    return Mesh(np.asarray(corners, np.float32), faces, uvs, texture, *shine, normals)


def floor(half_m, z=0.0, texture=None):
    """A square; uv (0, 0) lies at (−x, +y), which is top-left for the camera that looks down."""
    h = half_m
    return grid_mesh([[-h, h, z], [h, h, z], [h, -h, z], [-h, -h, z]], texture)


def sphere(radius_m, n=80, color=(255, 255, 255)):
    polar, around = np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, 2 * n + 1)
    p, a = np.meshgrid(polar, around, indexing="ij")
    unit = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)
    index = np.arange(p.size).reshape(p.shape)
    i, j, k, m = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([i, j, k], -1).reshape(-1, 3), np.stack([i, k, m], -1).reshape(-1, 3)]
    ).astype(np.int32)
    vertices = unit.reshape(-1, 3).astype(np.float32)
    return Mesh(
        vertices * np.float32(radius_m),
        faces,
        np.full((len(faces), 3, 2), 0.5, np.float32),
        np.full((2, 2, 3), color, np.uint8),
        np.full(len(faces), 0.05, np.float32),
        np.full(len(faces), 20, np.float32),
        vertices[faces],
    )


def at(x, y, z):
    return make_transform(np.eye(3), [x, y, z])


def shot(instances, lights=(), sky=None, settings=FAST, camera=CAMERA, world_from_cam=DOWN):
    return Renderer(Scene(tuple(instances), tuple(lights), sky or Sky()), settings).render(
        camera, world_from_cam
    )


def test_depth_of_a_plane_and_a_sphere_is_exact():
    frame = shot([Instance(floor(10), np.eye(4)), Instance(sphere(0.5), at(0.2, 0.1, 1.0), 0)])
    x, y = np.moveaxis(CAMERA.unproject(CAMERA.pixel_centers(), 1.0)[..., :2], -1, 0)
    direction = np.stack([x, -y, -np.ones_like(x)], -1)
    start = np.array([0, 0, 3.0]) - [0.2, 0.1, 1.0]
    a, b, c = (direction**2).sum(-1), direction @ start, start @ start - 0.25
    hit = b * b - a * c > 0
    t = (-b - np.sqrt(np.where(hit, b * b - a * c, 0))) / a
    expected = np.where(hit, t, 3.0)
    inner = b * b - a * c > 0.02
    outside = b * b - a * c < 0
    assert np.abs(frame.depth_m - expected)[outside].max() < 1e-5
    assert np.abs(frame.depth_m - expected)[inner].max() < 2e-3  # facets of the sphere
    assert (frame.instance_ids[inner] == 0).all()
    assert (frame.instance_ids[outside] == -1).all()
    assert frame.depth_m.dtype == np.float32
    assert frame.instance_ids.dtype == np.int32


def test_misses_are_nan_with_id_minus_one_and_show_the_background():
    frame = shot([Instance(sphere(0.4), np.eye(4), 5)], sky=Sky(background=(10, 120, 200)))
    missed = np.isnan(frame.depth_m)
    assert 0 < missed.sum() < missed.size
    assert (frame.instance_ids[missed] == -1).all()
    assert (frame.instance_ids[~missed] == 5).all()
    assert np.abs(frame.color[0, 0].astype(int) - [10, 120, 200]).max() <= 1
    assert frame.color.dtype == np.uint8


def test_gradient_and_panorama_backgrounds():
    level = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # looks along +x
    gradient = np.array([[255, 0, 0], [0, 0, 255]], np.uint8)
    color = shot([], sky=Sky(background=gradient), world_from_cam=level).color
    assert color[0, 80, 0] > color[-1, 80, 0]
    assert color[0, 80, 2] < color[-1, 80, 2]
    panorama = np.zeros((90, 180, 3), np.uint8)
    panorama[:, :90, 0] = 200  # left of +x: towards +y
    color = shot([], sky=Sky(background=panorama), world_from_cam=level).color
    assert color[60, 20, 0] > 150
    assert color[60, 140, 0] < 50


def test_visibility_of_a_half_hidden_and_of_a_cut_instance():
    target = Instance(floor(0.2), np.eye(4), 3)
    cover = Instance(
        grid_mesh([[0, 1, 1e-3], [2, 1, 1e-3], [2, -1, 1e-3], [0, -1, 1e-3]]), np.eye(4)
    )
    view = shot([target, cover]).views[0]
    assert view.instance_id == 3
    assert view.visible_fraction == pytest.approx(0.5, abs=0.03)
    assert view.outline_box_px == (70, 50, 90, 70)
    assert not view.is_cut
    assert view.inside_fraction == 1
    # The image's right border lies at x = 1.6 m.
    cut = shot([Instance(floor(0.2), at(1.6, 0, 0), 0)]).views[0]
    assert cut.is_cut
    assert cut.visible_fraction == 1
    assert cut.inside_fraction == pytest.approx(0.5, abs=0.05)
    behind, aside = shot(
        [Instance(floor(0.2), at(0, 0, 5), 0), Instance(floor(0.2), at(9, 0, 0), 1)]
    ).views
    for view in (behind, aside):
        assert (view.n_visible_px, view.visible_fraction, view.is_cut) == (0, 0, False)
        assert view.outline_box_px is None


def test_a_hidden_instance_keeps_its_outline():
    frame = shot([Instance(floor(0.2), np.eye(4), 0), Instance(floor(1, z=0.5), np.eye(4))])
    assert frame.views[0].n_visible_px == 0
    assert frame.views[0].outline_box_px == (70, 50, 90, 70)


DARK = Sky((0, 0, 0), (0, 0, 0))


@pytest.mark.parametrize(
    ("light", "shadow_x"),
    [
        (BulbLight((-2.0, 0.0, 2.0), (8.0, 8.0, 8.0), 0.01), 2 / 3),
        (PanelLight((-2.0, 0, 2), (0.0, 0.02, 0), (0.014, 0, 0.014), (9.0, 9.0, 9.0)), 2 / 3),
        (SunLight((-1.0, 0.0, 1.0)), 0.5),
    ],
)
def test_shadow_falls_where_geometry_says(light, shadow_x):
    """A ball half a metre up throws its shadow away from the light, as far as rays say."""
    ball = Instance(sphere(0.1), at(0, 0, 0.5), 0)
    frame = shot([Instance(floor(5), np.eye(4)), ball], [light], DARK)
    on_floor = frame.instance_ids < 0
    brightness = frame.color.astype(int).sum(axis=-1)
    dark = on_floor & (brightness < 60)
    row, column = (np.flatnonzero(dark.any(axis=axis)).mean() for axis in (1, 0))
    assert row == pytest.approx(60, abs=1.5)
    assert column == pytest.approx(80 + 150 * shadow_x / 3 - 0.5, abs=2)
    assert dark.sum() < 200
    lit = shot(
        [Instance(floor(5), np.eye(4)), ball], [light], DARK, replace(FAST, shadow_rays=0)
    ).color.astype(int)
    assert (lit.sum(axis=-1)[on_floor] > 60).all()


def test_larger_lights_make_softer_shadows():
    def penumbra(radius_m):
        light = BulbLight((-1.0, 0.0, 2.0), (4.0, 4.0, 4.0), radius_m)
        scene = [Instance(floor(5), np.eye(4)), Instance(floor(0.15, z=0.6), np.eye(4), 0)]
        color = shot(scene, [light], DARK, RenderSettings(shadow_rays=8, ambient_rays=0)).color
        row = color[60, 100:120, 0].astype(int)
        return ((row > 25) & (row < row.max() - 25)).sum()

    assert penumbra(0.3) > penumbra(0.01)


def test_light_falls_off_with_the_square_of_the_distance():
    def light_under(height_m):
        camera = PinholeCamera(3, 3, 300.0, 300.0, 1.5, 1.5)
        lamp = BulbLight((0.0, 0.0, height_m), (0.4,) * 3)
        color = shot([Instance(floor(1), np.eye(4))], [lamp], DARK, FAST, camera).color[1, 1, 0]
        return ((color / 255 + 0.055) / 1.055) ** 2.4

    assert light_under(1.0) == pytest.approx(0.4, rel=0.02)
    assert light_under(2.0) == pytest.approx(0.1, rel=0.03)


def test_ambient_rays_darken_corners():
    wall = grid_mesh([[0.5, 2, 0], [0.5, -2, 0], [0.5, -2, 2], [0.5, 2, 2]])
    scene = [
        Instance(floor(3, texture=np.full((2, 2, 3), 150, np.uint8)), np.eye(4)),
        Instance(wall, np.eye(4)),
    ]
    color = (
        shot(scene, (), Sky((0.5,) * 3, (0.5,) * 3), RenderSettings()).color[60, :, 0].astype(int)
    )
    assert color[20] > color[100] + 10


def quarters():
    """Top-left red, top-right green, bottom-left blue, bottom-right white."""
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:32, :32], texture[:32, 32:] = (255, 0, 0), (0, 255, 0)
    texture[32:, :32], texture[32:, 32:] = (0, 0, 255), (255, 255, 255)
    return texture


def test_texture_appears_where_uv_says_and_is_not_mirrored():
    frame = shot(
        [Instance(floor(1, texture=quarters()), np.eye(4))], (), Sky((0.5,) * 3, (0.5,) * 3)
    )
    hue = (frame.color > 90).astype(int)
    assert hue[40, 60].tolist() == [1, 0, 0]
    assert hue[40, 100].tolist() == [0, 1, 0]
    assert hue[80, 60].tolist() == [0, 0, 1]
    assert hue[80, 100].tolist() == [1, 1, 1]


def test_texture_border_does_not_wrap_but_repeats_beyond():
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:, 0] = 255
    sky = Sky((0.8,) * 3, (0.8,) * 3)
    color = shot([Instance(floor(1, texture=texture), np.eye(4))], (), sky).color
    assert color[60, 32, 0] > 150
    assert color[60, 127, 0] < 30
    mesh = floor(1, texture=texture)
    twice = replace(mesh, corner_uvs=mesh.corner_uvs * np.float32(2))
    color = shot([Instance(twice, np.eye(4))], (), sky).color
    assert color[60, 83, 0] > 100


def test_fine_print_far_away_turns_grey():
    check = (np.indices((512, 512)).sum(0) % 2 * 255).astype(np.uint8)
    mesh = floor(1, texture=np.repeat(check[..., None], 3, -1))
    color = shot([Instance(mesh, np.eye(4))], (), Sky((0.8,) * 3, (0.8,) * 3)).color
    middle = color[40:80, 60:100].astype(int)
    assert np.ptp(middle) < 12
    assert 100 < middle.mean() < 220


def test_unused_parts_of_a_texture_do_not_bleed_in():
    """A scan's charts lie on black; seen from afar the object must not turn dark."""
    texture = np.zeros((256, 256, 3), np.uint8)
    texture[100:140, 100:140] = 255
    mesh = floor(0.1, texture=texture)
    uvs = (mesh.corner_uvs * np.float32(39) + np.float32(100.5)) / np.float32(256)
    far = at(0, 0, -9)
    sky = Sky((0.5,) * 3, (0.5,) * 3)
    color = shot([Instance(replace(mesh, corner_uvs=uvs), far)], (), sky).color
    plain = shot([Instance(floor(0.1), far)], (), sky).color
    assert np.abs(color[60, 80].astype(int) - plain[60, 80]).max() <= 3


def example():
    lights = [BulbLight((0.5, 0.5, 2.0), (2.0, 2.0, 2.0), 0.1)]
    return [Instance(floor(2), np.eye(4)), Instance(sphere(0.3, 20), at(0, 0, 0.3), 0)], lights


def test_same_seed_same_bytes_other_seed_other_noise():
    first, again = (shot(*example(), settings=RenderSettings(seed=3)) for _ in range(2))
    assert np.array_equal(first.color, again.color)
    assert np.array_equal(first.depth_m, again.depth_m, equal_nan=True)
    other = shot(*example(), settings=RenderSettings(seed=4))
    assert not np.array_equal(first.color, other.color)
    assert np.abs(first.color.astype(int) - other.color).mean() < 2


def test_exposure_is_monotone_and_automatic_exposure_follows_the_light():
    previous = np.zeros((120, 160, 3), np.uint8)
    for exposure in (0.1, 0.5, 1.0, 3.0):
        color = shot(*example(), settings=RenderSettings(exposure=exposure)).color
        assert (color >= previous).all()
        assert color.mean() > previous.mean()
        previous = color
    instances, lights = example()
    dim = [replace(lights[0], intensity=(0.2, 0.2, 0.2))]
    dark = Sky((0.03,) * 3, (0.03,) * 3, (0, 0, 0))
    bright = Sky((0.3,) * 3, (0.3,) * 3, (0, 0, 0))
    auto = RenderSettings(exposure=None)
    means = [
        shot(instances, dim, dark, auto).color.mean(),
        shot(instances, lights, bright, auto).color.mean(),
    ]
    assert means[0] == pytest.approx(means[1], rel=0.05)


def test_smoothed_edges_lie_between_and_leave_depth_alone():
    instances, lights = example()
    sharp, smooth, finest = (
        shot(instances, lights, settings=RenderSettings(smooth_edges=how))
        for how in ("none", "edges", "all")
    )
    assert np.array_equal(sharp.depth_m, smooth.depth_m, equal_nan=True)
    assert np.array_equal(sharp.instance_ids, finest.instance_ids)
    assert not np.array_equal(sharp.color, smooth.color)
    differs = np.abs(smooth.color.astype(int) - finest.color).max(axis=-1) > 20
    assert differs.mean() < 0.01


def test_no_warning_and_no_nan_with_degenerate_faces_and_empty_scenes():
    mesh = floor(1)
    broken = replace(mesh, faces=np.array([[0, 1, 2], [0, 0, 2]], np.int32))
    with np.errstate(all="raise", under="ignore"):
        frame = shot([Instance(broken, np.eye(4), 0)], [BulbLight((0.0, 0.0, 0.0))])
    assert np.isfinite(frame.depth_m[frame.instance_ids == 0]).all()
    empty = shot([])
    assert np.isnan(empty.depth_m).all()
    assert empty.views == ()


def test_view_is_cut_out_centred_and_turns_the_right_way():
    """A cube with a coloured face per side: azimuth 0 sees +x, azimuth 90° sees +y."""
    colors = {"+x": (255, 0, 0), "+y": (0, 255, 0)}
    h = 0.05
    sides = {
        "+x": [[h, -h, h], [h, h, h], [h, h, -h], [h, -h, -h]],
        "+y": [[h, h, h], [-h, h, h], [-h, h, -h], [h, h, -h]],
    }
    vertices = np.array(sides["+x"] + sides["+y"], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    uvs = np.zeros((4, 3, 2), np.float32)
    uvs[:2, :, 0], uvs[2:, :, 0] = 0.25, 0.75
    texture = np.array([[colors["+x"], colors["+y"]]], np.uint8)
    shine = np.zeros(4, np.float32), np.full(4, 20, np.float32)
    cube = Mesh(vertices, faces, uvs, texture, *shine)
    front, left = (render_view(cube, azimuth, 0.2, 96) for azimuth in (0.0, np.pi / 2))
    assert front.shape == (96, 96, 4)
    assert front[48, 48].argmax() != 1
    assert front[48, 48, 0] > 3 * front[48, 48, 1]
    assert left[48, 48, 1] > 3 * left[48, 48, 0]
    corner = render_view(cube, np.pi / 4, 0.0, 96)
    # Seen from between, +y lies to the right of +x.
    assert corner[48, 36, 0] > corner[48, 36, 1]
    assert corner[48, 60, 1] > corner[48, 60, 0]
    rows, columns = (np.flatnonzero((corner[..., 3] > 127).any(axis=a)) for a in (1, 0))
    assert rows.mean() == pytest.approx(47.5, abs=1)
    assert columns.mean() == pytest.approx(47.5, abs=1)
    assert corner[0, 0].tolist() == [0, 0, 0, 0]


def test_view_distance_and_roll():
    ball = sphere(0.1, 30)
    near = render_view(ball, 0.3, 0.4, 100, distance_m=1.0, focal_px=200.0)
    far = render_view(ball, 0.3, 0.4, 100, distance_m=2.0, focal_px=200.0)
    assert (near[..., 3] > 127).sum() == pytest.approx(
        np.pi * (200 * 0.1) ** 2 / (1 - 0.01), rel=0.02
    )
    assert (far[..., 3] > 127).sum() == pytest.approx((near[..., 3] > 127).sum() / 4, rel=0.05)
    bar = grid_mesh([[0, -0.1, 0.01], [0, 0.1, 0.01], [0, 0.1, -0.01], [0, -0.1, -0.01]])
    level = render_view(bar, 0.0, 0.0, 64)[..., 3] > 127
    turned = render_view(bar, 0.0, 0.0, 64, roll_rad=np.pi / 2)[..., 3] > 127
    assert np.array_equal(turned, np.rot90(level))


def test_viewpoint_transform_is_rigid_and_looks_at_the_target():
    target = np.array([1.0, 2, 3])
    transform = viewpoint_transform(target, 0.7, 0.4, 2.0, roll_rad=0.3)
    rotation = transform[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.allclose(transform[:3, 3] + 2 * rotation[:, 2], target)
    away = transform[:3, 3] - target
    assert np.arctan2(away[1], away[0]) == pytest.approx(0.7)
    assert np.arcsin(away[2] / 2) == pytest.approx(0.4)
