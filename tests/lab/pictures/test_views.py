"""Viewpoint renders: the angles they claim are the angles they show; made once, kept by digest."""

from dataclasses import replace

import numpy as np
import pytest

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.viewpoint import ViewGrid, view_angles
from imodbatch.lab.commands.options import grid_of, parse_symmetries
from imodbatch.lab.mesh import ObjectModel, TexturedMesh
from imodbatch.lab.pictures.cutouts import crop_to_object, load_cutouts
from imodbatch.lab.pictures.views import ViewSettings, plan_view, prepare_views, view_digest
from imodbatch.lab.render.raycast import viewpoint_transform
from imodbatch.lab.scene import render_views

SIDES = {"red": (220, 20, 20), "green": (20, 220, 20), "blue": (20, 20, 220), "grey": (90, 90, 90)}
SMALL = ViewSettings(grid=ViewGrid(4, (0.2, 0.9)), n_variants=3, size_px=48)


def painted_box(name="box"):
    """A box whose sides facing +x, +y, −x, −y are red, green, blue and grey, its top white."""
    colors = [*SIDES.values(), (255, 255, 255)]
    texture = np.repeat(np.array([colors], np.uint8), 4, axis=0).repeat(4, axis=1)
    x, y, z = 0.03, 0.05, 0.08
    ring = np.array([(x, -y), (x, y), (-x, y), (-x, -y)])
    vertices, faces, uvs = [], [], []
    for side in range(4):
        (ax, ay), (bx, by) = ring[side], ring[(side + 1) % 4]
        vertices += [(ax, ay, 0), (bx, by, 0), (bx, by, z), (ax, ay, z)]
    vertices += [(*point, z) for point in ring]
    for side in range(5):
        a = 4 * side
        faces += [(a, a + 1, a + 2), (a, a + 2, a + 3)]
        uvs += [[((side + 0.5) / 5, 0.5)] * 3] * 2
    mesh = TexturedMesh(
        np.array(vertices, np.float32),
        np.array(faces, np.int32),
        np.array(uvs, np.float32),
        texture,
        np.zeros(len(faces), np.int16),
    )
    return ObjectModel(name, mesh)


def picture_of(model, settings, *view):
    """RGBA of an elevation bin, an azimuth bin and a variant."""
    return next(render_views(model, [plan_view(model, settings, *view)]))


def mean_color(rgba):
    rgba = rgba.reshape(-1, 4)
    return rgba[rgba[:, 3] > 200][:, :3].mean(axis=0)


@pytest.mark.parametrize("azimuth_bin", range(4))
def test_bin_b_shows_the_side_at_azimuth_b(azimuth_bin):
    """Bin 0 looks at the front (+x), bin 1 at +y, and so on, in every variant."""
    expected = list(SIDES)[azimuth_bin]
    grid = ViewGrid(4, (0.05,))
    for variant in range(3):
        settings = replace(SMALL, grid=replace(grid, n_azimuths=16))
        color = mean_color(picture_of(painted_box(), settings, 0, 4 * azimuth_bin, variant))
        found = "grey" if np.ptp(color) < 40 else ["red", "green", "blue"][int(color.argmax())]
        assert found == expected


def test_azimuth_grows_counter_clockwise_as_in_core():
    """A little beyond the front, towards +y, the green side comes in from the right."""
    settings = replace(SMALL, grid=ViewGrid(16, (0.05,)), size_px=96)
    rgba = picture_of(painted_box(), settings, 0, 2, 0).astype(int)
    solid = rgba[..., 3] > 200
    columns = np.nonzero(solid & (rgba[..., 1] > rgba[..., 0] + 30))[1]
    reds = np.nonzero(solid & (rgba[..., 0] > rgba[..., 1] + 30))[1]
    assert columns.mean() > reds.mean() + 15
    camera = viewpoint_transform(np.zeros(3), np.pi / 4, 0.3, 2.0)[:3, 3]
    azimuth, elevation = view_angles(np.zeros(3), camera)
    assert (float(azimuth), float(elevation)) == pytest.approx((np.pi / 4, 0.3))


def test_labels_lie_in_their_bins_and_fill_them(tmp_path):
    table = prepare_views([painted_box()], tmp_path, SMALL)[0]
    cutouts = load_cutouts(table)
    assert len(cutouts) == SMALL.n_views == 2 * 4 * 3
    e, a, v = (i.ravel() for i in np.indices((2, 4, 3)))
    assert np.array_equal(SMALL.grid.azimuth_bins(cutouts.azimuth_rad), a)
    assert np.array_equal(SMALL.grid.elevation_bins(cutouts.elevation_rad), e)
    centre = v == 0
    assert cutouts.azimuth_rad[centre] == pytest.approx(a[centre] * np.pi / 2)
    assert cutouts.elevation_rad[centre] == pytest.approx(np.array([0.2, 0.9])[e[centre]])
    off = np.abs((cutouts.azimuth_rad - a * np.pi / 2 + np.pi) % (2 * np.pi) - np.pi)
    assert 0.5 < off.max() < np.pi / 4
    assert cutouts.elevation_rad.min() >= SMALL.lowest_elevation_rad
    for i in range(len(cutouts)):
        rgba = cutouts.rgba(i)
        assert 40 <= max(rgba.shape[:2]) <= 48
        assert crop_to_object(rgba).shape == rgba.shape


def test_cache_is_by_model_and_settings(tmp_path):
    calls = []
    model = painted_box()
    first = prepare_views([model], tmp_path, SMALL, progress=lambda *n: calls.append(n))
    assert calls == [(0, 24), (24, 24)]
    before = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in tmp_path.iterdir()}
    calls.clear()
    assert prepare_views([model], tmp_path, SMALL, progress=lambda *n: calls.append(n)) == first
    assert calls == [(24, 24)]
    assert before == {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in tmp_path.iterdir()}
    keys = {view_digest(model, SMALL), view_digest(model, replace(SMALL, seed=1))}
    keys.add(view_digest(replace(model, symmetry=2), SMALL))
    keys.add(
        view_digest(
            replace(model, mesh=replace(model.mesh, texture=model.mesh.texture // 2)), SMALL
        )
    )
    assert len(keys) == 4


def test_another_renderer_has_another_key_and_the_first_one_keeps_its_own():
    """The literal was made before there was a choice; caches of that time must stay good."""
    key = view_digest(painted_box(), SMALL)
    assert key == "8a238b6c039b5497"
    assert view_digest(painted_box(), replace(SMALL, renderer="blender")) != key


def test_killed_while_rendering_the_next_run_makes_the_same(tmp_path, monkeypatch):
    models = [painted_box("a"), painted_box("b")]
    whole = prepare_views(models, tmp_path / "whole", SMALL)
    from imodbatch.lab.pictures import views

    real, made = views.render_views, []

    def killed(*arguments):
        for picture in real(*arguments):
            made.append(1)
            if len(made) > 30:
                raise KeyboardInterrupt
            yield picture

    monkeypatch.setattr(views, "render_views", killed)
    with pytest.raises(KeyboardInterrupt):
        prepare_views(models, tmp_path / "cut", SMALL)
    monkeypatch.setattr(views, "render_views", real)
    calls = []
    resumed = prepare_views(models, tmp_path / "cut", SMALL, progress=lambda *n: calls.append(n))
    assert calls == [(24, 48), (48, 48)]
    for a, b in zip(whole, resumed, strict=True):
        assert a.read_bytes() == b.read_bytes()
        assert a.with_suffix(".bin").read_bytes() == b.with_suffix(".bin").read_bytes()


def test_damaged_cache_is_said_in_one_line(tmp_path):
    table = prepare_views([painted_box()], tmp_path, SMALL)[0]
    table.with_suffix(".bin").write_bytes(b"short")
    with pytest.raises(DataError, match="does not fit") as error:
        load_cutouts(table)
    assert "\n" not in str(error.value)
    table.write_text("{}")
    with pytest.raises(DataError, match="damaged"):
        load_cutouts(table)


def test_what_stands_on_the_command_line():
    assert grid_of(8, "10,30,50").elevations_rad == pytest.approx(np.deg2rad([10, 30, 50]))
    for text in ("", "ten", "30,10", "10,100"):
        with pytest.raises(ConfigError, match="--elevations"):
            grid_of(8, text)
    assert parse_symmetries(["bowl=full", "box=2", "mug=none"]) == {
        "bowl": "full", "box": 2, "mug": "none",
    }  # fmt: skip
    for text in ("bowl", "bowl=0", "=full", "bowl=round"):
        with pytest.raises(ConfigError, match="--symmetry"):
            parse_symmetries([text])
