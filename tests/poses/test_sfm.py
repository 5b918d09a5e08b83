"""Structure from motion: paths, metres and gaps on rendered rooms whose truth is known."""

import json
import shutil
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pycolmap
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError, ImodError
from imodbatch.core.frames import (
    apply,
    invert,
    make_transform,
    matrix_from_quaternion,
    twist_between,
)
from imodbatch.poses import sfm
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.sfm import estimation, localization
from imodbatch.poses.sfm import workspace as workspace_module
from imodbatch.poses.sfm.depth_adjustment import adjust_to_depth, settle_on, target
from imodbatch.poses.sfm.features import feature_scales
from imodbatch.poses.sfm.gaps import fill_gaps, n_covered
from imodbatch.poses.sfm.mapping import Model
from imodbatch.poses.sfm.retrieval import choose_pairs
from imodbatch.poses.sfm.scale import scale_from_depths
from imodbatch.poses.sfm.workspace import provide_database
from imodbatch.settings.config import SfmConfig

CAMERA = PinholeCamera(320, 240, 270.0, 270.0, 158.0, 122.0)
CONFIG = SfmConfig(max_features=600, next_keyframes=4, alike_keyframes=2)
N_FRAMES = 14
PLANES = [
    (np.array([0.0, 0.8, 0.0]), np.array([0.0, -1.0, 0.0])),
    (np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, -1.0])),
    (np.array([1.4, 0.0, 2.0]), np.array([-1.0, 0.0, -0.3])),
]
"""Floor, back and side wall of a room: a point and the normal of each, y down, metres."""


def no_bar(items):
    return items


def texture(seed):
    """Grey noise of several grain sizes (1024, 1024), 1 m = 256 texels, in [0, 255]."""
    rng = np.random.default_rng(seed)
    total = np.zeros((1024, 1024))
    for size in (32, 64, 128, 256):
        grains = rng.normal(size=(size, size))
        total += cv2.resize(grains, (1024, 1024), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 40 * total, 0, 255)


def render(world_from_cam, textures):
    """Colour (H, W, 3) and depth (H, W) of the room."""
    rays = CAMERA.unproject(CAMERA.pixel_centers(), 1.0) @ world_from_cam[:3, :3].T
    center = world_from_cam[:3, 3]
    depth = np.full(rays.shape[:2], np.inf)
    gray = np.zeros(rays.shape[:2])
    for (point, normal), image in zip(PLANES, textures, strict=True):
        with np.errstate(divide="ignore"):
            z = ((point - center) @ normal) / (rays @ normal)
        hit = (z > 0.1) & (z < depth)
        across = np.cross(normal, [0.3, 0.5, 0.8])
        across /= np.linalg.norm(across)
        along = np.cross(normal, across) / np.linalg.norm(normal)
        where = center + z[..., None] * rays - point
        u, v = (((where @ axis) * 256 % 1023).astype(np.float32) for axis in (across, along))
        shade = cv2.remap(image.astype(np.float32), u, v, cv2.INTER_LINEAR)
        depth[hit], gray[hit] = z[hit], shade[hit]
    color = np.repeat(np.rint(gray).astype(np.uint8)[..., None], 3, axis=2)
    return color, np.where(np.isfinite(depth), depth, np.nan).astype(np.float32)


def walk(n_frames, step_m=0.06):
    """world_from_cam (F, 4, 4) of a camera that steps aside and turns back towards the room."""
    poses = []
    for i in range(n_frames):
        turn = 0.5 * -0.005 * i
        rotation = matrix_from_quaternion([np.cos(turn), 0.2 * np.sin(turn), np.sin(turn), 0])
        center = [-0.4 + step_m * i, 0.03 * np.sin(0.7 * i), 0.02 * i]
        poses.append(make_transform(rotation, center))
    return np.array(poses)


@dataclass(frozen=True)
class Scene:
    """Frames and the poses they were rendered from."""

    frames: RgbdFrames
    truth: np.ndarray


def scene_of(folder, colors, depths, truth):
    folder.mkdir(parents=True, exist_ok=True)
    files = tuple(folder / f"{i:03d}.png" for i in range(len(colors)))
    for path, color in zip(files, colors, strict=True):
        cv2.imwrite(str(path), color)
    frames = RgbdFrames(
        "seq-07",
        np.arange(len(colors)) * 5,
        None,
        CAMERA,
        files,
        lambda i: colors[i],
        lambda i: depths[i],
    )
    return Scene(frames, truth)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    textures = [texture(seed) for seed in range(3)]
    truth = walk(N_FRAMES)
    colors, depths = zip(*(render(pose, textures) for pose in truth), strict=True)
    return scene_of(tmp_path_factory.mktemp("room"), colors, depths, truth)


@pytest.fixture(scope="module")
def estimated(room, tmp_path_factory):
    workspace = tmp_path_factory.mktemp("sfm") / "seq-07"
    return sfm.estimate(room.frames, workspace, CONFIG, no_bar), workspace


def errors_m(trajectory, truth, first=0):
    """Distance of every pose with one from the truth, both seen from one frame."""
    poses = trajectory.poses.world_from_cam
    expected = invert(truth[first]) @ truth
    known = np.isfinite(poses[:, 0, 0])
    return np.linalg.norm((poses - expected)[known, :3, 3], axis=-1)


def test_the_path_is_found_in_metres(room, estimated):
    trajectory, _ = estimated
    assert (trajectory.poses.status == "tracked").all()
    assert np.allclose(trajectory.poses.world_from_cam[0], np.eye(4), atol=1e-9)
    assert errors_m(trajectory, room.truth).max() < 0.01
    assert trajectory.warnings == ()


def test_figures_say_how_it_went(estimated):
    trajectory, _ = estimated
    figures = trajectory.figures
    assert figures["sfm_registered"] == N_FRAMES
    assert 3 <= figures["sfm_keyframes_reconstructed"] <= figures["sfm_keyframes"] <= N_FRAMES
    assert figures["sfm_points"] > 100
    assert 0 < figures["sfm_reprojection_error_px"] < 1
    assert 0 < figures["metric_scale_spread_percent"] < 3
    assert all(np.isfinite(value) for value in figures.values())
    assert trajectory.summary.startswith(f"sfm: {N_FRAMES} of {N_FRAMES} registered")
    assert "± 0." in trajectory.summary


def test_the_model_is_kept_in_metres(room, estimated):
    trajectory, workspace = estimated
    model = pycolmap.Reconstruction(workspace / "sparse")
    image = model.images[min(model.reg_image_ids())]
    pose = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
    position = [path.name for path in room.frames.color_files].index(image.name)
    assert np.allclose(invert(pose), trajectory.poses.world_from_cam[position], atol=1e-6)
    assert sorted(path.name for path in workspace.iterdir()) == [
        "database.db",
        "database.json",
        "sparse",
    ]


def test_known_intrinsics_are_kept(estimated):
    camera = pycolmap.Reconstruction(estimated[1] / "sparse").cameras[1]
    assert camera.model_name == "PINHOLE"
    assert camera.params.tolist() == [270.0, 270.0, 158.0, 122.0]


def test_the_same_input_gives_the_same_path_and_nothing_is_printed(
    room, estimated, tmp_path, capfd
):
    again = sfm.estimate(room.frames, tmp_path / "again", CONFIG, no_bar)
    difference = again.poses.world_from_cam - estimated[0].poses.world_from_cam
    assert np.abs(difference).max() < 1e-4
    assert capfd.readouterr() == ("", "")


def test_the_database_is_used_again(room, estimated, tmp_path, monkeypatch):
    workspace = shutil.copytree(estimated[1], tmp_path / "seq-07")
    shutil.rmtree(workspace / "sparse")
    monkeypatch.setattr(workspace_module, "write_features", forbidden)
    again = sfm.estimate(room.frames, workspace, changed(max_gap_frames=1), no_bar)
    first = estimated[0].poses.world_from_cam
    assert np.abs(again.poses.world_from_cam - first).max() < 1e-4
    assert (workspace / "sparse" / "images.bin").is_file()
    with pytest.raises(AssertionError, match="made anew"):
        sfm.estimate(room.frames, workspace, changed(max_features=700), no_bar)
    assert not (workspace / "database.json").exists()


def test_an_interrupted_database_is_made_anew(room, tmp_path):
    (tmp_path / "database.db").write_bytes(b"half of it")
    left = tmp_path / ".database.db.01234567.partial"
    left.mkdir()
    (left / "database.db").write_bytes(b"half of it")
    made = provide_database(room.frames, tmp_path, CONFIG, no_bar)
    assert not made.is_reused
    assert not left.exists()
    assert provide_database(room.frames, tmp_path, CONFIG, no_bar) == replace(made, is_reused=True)


def changed(**settings):
    return CONFIG.model_copy(update=settings)


def forbidden(*_):
    raise AssertionError("made anew")


def test_a_changed_image_makes_the_database_anew(room, estimated, tmp_path, monkeypatch):
    workspace = shutil.copytree(estimated[1], tmp_path / "seq-07")
    monkeypatch.setattr(workspace_module, "_make", forbidden)
    other = tmp_path / "other.png"
    frames = replace(room.frames, color_files=(*room.frames.color_files[:-1], other))
    assert provide_database(room.frames, workspace, CONFIG, no_bar).is_reused
    with pytest.raises(AssertionError, match="made anew"):
        provide_database(frames, workspace, CONFIG, no_bar)


def test_a_damaged_image_is_left_out(room, tmp_path):
    damaged = {5, N_FRAMES - 2, N_FRAMES - 1}
    frames = replace(
        room.frames, read_color=lambda i: None if i in damaged else room.frames.read_color(i)
    )
    trajectory = sfm.estimate(frames, tmp_path, CONFIG, no_bar)
    status = trajectory.poses.status
    assert status[5] == "interpolated"
    assert status[-2:].tolist() == ["lost", "lost"]
    assert (np.delete(status, sorted(damaged)) == "tracked").all()
    assert np.isnan(trajectory.poses.world_from_cam[-2:]).all()
    assert errors_m(trajectory, room.truth).max() < 0.02
    assert "3 of 14 colour images" in trajectory.warnings[0]


def test_spaces_in_file_names_do_no_harm(room, tmp_path):
    folder = shutil.copytree(room.frames.color_files[0].parent, tmp_path / "my images")
    files = tuple(folder / f"frame {i}.png" for i in range(N_FRAMES))
    for old, new in zip(sorted(folder.iterdir()), files, strict=True):
        old.rename(new)
    trajectory = sfm.estimate(replace(room.frames, color_files=files), tmp_path, CONFIG, no_bar)
    assert errors_m(trajectory, room.truth).max() < 0.01


def test_of_two_rooms_the_one_with_more_frames_counts(room, tmp_path):
    other = [texture(seed) for seed in (7, 8, 9)]
    truth = walk(10)
    colors, depths = zip(*(render(pose, other) for pose in truth), strict=True)
    n_first = 6
    colors = [*(room.frames.read_color(i) for i in range(n_first)), *colors]
    depths = [*(room.frames.read_depth(i) for i in range(n_first)), *depths]
    both = scene_of(tmp_path / "images", colors, depths, np.concatenate([walk(n_first), truth]))
    trajectory = sfm.estimate(both.frames, tmp_path / "sfm", CONFIG, no_bar)
    assert (trajectory.poses.status[:n_first] == "lost").all()
    assert (trajectory.poses.status[n_first:] == "tracked").all()
    assert errors_m(trajectory, both.truth, first=n_first).max() < 0.01
    assert f"{n_first} of 16 frames lie in models" in trajectory.warnings[0]


def model_of(estimated):
    keyframes = recorded_keyframes(estimated[1])
    reconstruction = pycolmap.Reconstruction(estimated[1] / "sparse")
    return Model(reconstruction, feature_scales(estimated[1] / "database.db", keyframes))


def recorded_keyframes(workspace):
    return json.loads((workspace / "database.json").read_text())["keyframes"]


def keyframe_errors_m(model, truth):
    """Distance of the keyframes from the truth, seen from the first one."""
    keyframes = model.keyframes()
    poses = invert(np.stack([model.cam_from_world(k) for k in keyframes]))
    moved = invert(poses[0]) @ poses
    expected = invert(truth[keyframes[0]]) @ truth[keyframes]
    return np.linalg.norm((moved - expected)[:, :3, 3], axis=-1)


def test_depth_mends_a_model_of_wrong_size(room, estimated):
    model = model_of(estimated)
    model.reconstruction.transform(pycolmap.Sim3d(1.04 * np.eye(4)[:3]))
    assert keyframe_errors_m(model, room.truth).max() > 0.015
    adjust_to_depth(room.frames, model, no_bar)
    assert keyframe_errors_m(model, room.truth).max() < 0.005


def test_the_adjusted_model_holds_together(room, estimated):
    model = model_of(estimated)
    first, _, third, *_ = model.keyframes()
    before, n_points = model.cam_from_world(first), model.reconstruction.num_points3D()
    astray = make_transform(np.eye(3), [0.02, 0.0, 0.0]) @ model.cam_from_world(third)
    model.move({third: astray}, {})
    assert np.allclose(model.cam_from_world(third), astray)
    adjust_to_depth(room.frames, model, no_bar)
    assert np.allclose(model.cam_from_world(first), before)
    assert keyframe_errors_m(model, room.truth).max() < 0.005
    assert model.reconstruction.num_points3D() == n_points
    sights = model.sights(third)
    seen = CAMERA.project(apply(model.cam_from_world(third), sights.points))
    assert np.median(np.linalg.norm(seen - sights.pixels, axis=1)) < 0.7


def test_a_keyframe_without_depth_is_adjusted_by_its_pixels(room, estimated):
    model = model_of(estimated)
    blind = model.keyframes()[1]
    depth_of = room.frames.read_depth
    frames = replace(room.frames, read_depth=lambda i: None if i == blind else depth_of(i))
    adjust_to_depth(frames, model, no_bar)
    assert keyframe_errors_m(model, room.truth).max() < 0.005


def test_surfaces_hold_a_frame_whose_pixels_are_shifted(room, estimated):
    model = model_of(estimated)
    keyframe, other, *_ = model.keyframes()
    expected, sights = model.cam_from_world(other), model.sights(other)
    shifted = replace(sights, pixels=sights.pixels + np.array([0.0, 1.5]))
    by_pixels = settle_on([], room.frames, other, expected, shifted)
    near = target(room.frames, model, keyframe)
    settled = settle_on([near], room.frames, other, expected, shifted)

    def turn(pose):
        return np.linalg.norm(twist_between(pose, expected)[3:])

    assert turn(settled) < 0.8 * turn(by_pixels)


def test_without_depth_only_the_scale_is_set(room, estimated, tmp_path, monkeypatch):
    workspace = shutil.copytree(estimated[1], tmp_path / "seq-07")
    monkeypatch.setattr(estimation, "adjust_to_depth", forbidden)
    monkeypatch.setattr(localization, "settle_on", forbidden)
    config = changed(adjust_to_depth=False)
    trajectory = sfm.estimate(room.frames, workspace, config, no_bar)
    assert errors_m(trajectory, room.truth).max() < 0.03


@pytest.mark.skipif(not hasattr(pycolmap, "global_mapping"), reason="not in this pycolmap")
def test_the_global_mapper_finds_the_path_too(room, tmp_path):
    config = changed(mapper="global")
    trajectory = sfm.estimate(room.frames, tmp_path, config, no_bar)
    assert errors_m(trajectory, room.truth).max() < 0.02


def test_a_build_without_the_global_mapper_says_so(room, estimated, monkeypatch):
    monkeypatch.delattr(pycolmap, "global_mapping", raising=False)
    config = changed(mapper="global")
    fault(ImodError, room.frames, estimated[1], "sfm.mapper = 'incremental'", config=config)


def fault(kind, frames, workspace, *mentions, config=CONFIG):
    with pytest.raises(kind) as caught:
        sfm.estimate(frames, workspace, config, no_bar)
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in ("seq-07: ", *mentions):
        assert mention in text


def first_frames(frames, n):
    return replace(frames, frame_index=frames.frame_index[:n], color_files=frames.color_files[:n])


def test_a_single_frame_is_an_error(room, tmp_path):
    fault(DataError, first_frames(room.frames, 1), tmp_path, "1 frame", "several views")


def test_a_camera_that_stands_still_is_an_error(room, tmp_path):
    color, depth = room.frames.read_color(0), room.frames.read_depth(0)
    frames = replace(room.frames, read_color=lambda _: color, read_depth=lambda _: depth)
    fault(DataError, frames, tmp_path, "1 of 14 frames", "keyframe_motion_percent")


def test_no_texture_is_an_error(room, tmp_path):
    flat = np.full((240, 320, 3), 90, dtype=np.uint8)
    frames = replace(room.frames, read_color=lambda _: flat)
    fault(DataError, frames, tmp_path, "nothing could be reconstructed", "texture")


def test_no_depth_is_an_error_before_any_work(room, tmp_path):
    fault(DataError, replace(room.frames, read_depth=lambda _: None), tmp_path, "no depth")
    empty = np.full((240, 320), np.nan, dtype=np.float32)
    fault(DataError, replace(room.frames, read_depth=lambda _: empty), tmp_path, "no depth")
    assert list(tmp_path.iterdir()) == []


def test_no_readable_image_is_an_error(room, tmp_path):
    fault(DataError, replace(room.frames, read_color=lambda _: None), tmp_path, "0 of 14 frames")


def test_depth_of_other_images_is_an_error(room, estimated):
    rng = np.random.default_rng(0)
    blocks = rng.uniform(0.3, 8.0, (12, 16)).astype(np.float32)
    depth = np.kron(blocks, np.ones((20, 20), dtype=np.float32))
    frames = replace(room.frames, read_depth=lambda _: depth)
    fault(DataError, frames, estimated[1], "do not agree on a scale", "camera.depth")


def test_an_image_of_another_size_is_an_error(room, tmp_path):
    small = np.zeros((120, 160, 3), dtype=np.uint8)
    frames = replace(room.frames, read_color=lambda _: small)
    fault(DataError, frames, tmp_path, "frame 0 is 160 × 120", "expected 320 × 240")


def test_the_scale_is_robust_and_tells_its_spread():
    rng = np.random.default_rng(1)
    depths = []
    for _ in range(20):
        reconstructed = rng.uniform(2, 8, 100)
        measured = 0.4 * reconstructed * (1 + rng.normal(0, 0.02, 100))
        measured[:15] *= 2  # depth of what lies behind
        depths.append(np.stack([measured, reconstructed], axis=1))
    scale = scale_from_depths(depths, "seq-07")
    assert scale.metres == pytest.approx(0.4, rel=0.01)
    assert 1.5 < scale.spread_percent < 4
    assert 0 < scale.standard_error_percent < 0.5
    assert (scale.n_ratios, scale.n_frames) == (2000, 20)


def test_too_few_ratios_give_no_scale():
    few = [np.ones((20, 2)), np.ones((9, 2))]
    with pytest.raises(DataError, match="depth at only 20 reconstructed points, 50 needed"):
        scale_from_depths(few, "seq-07")


def test_short_gaps_are_interpolated_and_long_ones_lost():
    known = {i: make_transform(np.eye(3), [i, 0, 0]) for i in (1, 2, 5, 9, 10)}
    poses = fill_gaps(known, 12, max_gap_frames=2)
    kinds = {"t": "tracked", "i": "interpolated", "l": "lost"}
    assert poses.status.tolist() == [kinds[letter] for letter in "lttiitllltt"] + ["lost"]
    assert poses.world_from_cam[3, 0, 3] == pytest.approx(3)


def test_nothing_is_interpolated_across_a_large_turn():
    half = np.radians(30.0)
    turned = matrix_from_quaternion([np.cos(half), 0, np.sin(half), 0])
    known = {0: np.eye(4), 2: np.eye(4), 4: make_transform(turned, [0, 0, 0])}
    poses = fill_gaps(known, 5, max_gap_frames=2)
    assert poses.status.tolist() == ["tracked", "interpolated", "tracked", "lost", "tracked"]


def test_frames_belong_to_the_keyframe_before_them():
    assert n_covered([0, 10], [0, 4, 10], 30) == 24
    assert n_covered([], [0, 4, 10], 30) == 0


def test_pairs_are_neighbours_and_look_alikes():
    rng = np.random.default_rng(0)
    places = [rng.integers(0, 255, (60, 128)) for _ in range(8)]
    images = [places[i] for i in (0, 1, 2, 3, 4, 5, 6, 7, 0)]
    images = [np.clip(d + rng.integers(-8, 8, d.shape), 0, 255).astype(np.uint8) for d in images]
    pairs = choose_pairs(images, n_next=2, n_alike=1)
    assert (0, 8) in pairs
    assert {(0, 1), (0, 2), (6, 8), (7, 8)} <= set(pairs)
    assert all(i < j for i, j in pairs)
    assert choose_pairs(images, n_next=2, n_alike=1) == pairs


def test_images_without_features_can_be_paired():
    empty = [np.zeros((0, 128), dtype=np.uint8)] * 3
    assert choose_pairs(empty, n_next=1, n_alike=1) == [(0, 1), (0, 2), (1, 2)]
