"""The analytic scene against distances and projections worked out by hand."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scene import CAMERA, GRID, VOXEL_SIZE_M, make_scene

from imodbatch.core import frames
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.core.fusion import Sightings, fuse
from imodbatch.core.viewpoint import yaw_from_pose_bin
from imodbatch.datasets.images import read_color, read_depth
from imodbatch.datasets.registry import camera_model
from imodbatch.lab.analytic import dataset, sequence, write_dataset
from imodbatch.lab.analytic.catalogue import BALL, CLASSES, COMPONENTS, MUG, resemblance
from imodbatch.lab.analytic.habits import ViewErrors
from imodbatch.lab.analytic.path import look_at
from imodbatch.lab.analytic.render import trace
from imodbatch.lab.analytic.sensor import DepthNoise, disturb
from imodbatch.lab.analytic.sequence import make_walk
from imodbatch.lab.analytic.shapes import Box, Capsule, Cylinder, Room, Sphere
from imodbatch.lab.analytic.truth import true_objects
from imodbatch.lab.analytic.world import PlacedObject, build_world
from imodbatch.lab.disk.images import to_millimetres
from imodbatch.lab.masks import bounds_of
from imodbatch.settings.manifest import load_manifest

MANIFEST = Path(__file__).parents[2] / "manifests" / "analytic.toml"
ODD_CAMERA = PinholeCamera(41, 31, 40.0, 40.0, 20.5, 15.5)  # a pixel centre on the optical axis
AXIS = (15, 20)  # row and column of that pixel
SIZE = {"n_sequences": 2, "n_frames": 3}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("analytic") / "data"
    write_dataset(folder, seed=4, **SIZE)
    return folder


def contents(folder):
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.mark.parametrize(
    ("shape", "origin", "direction", "distance"),
    [
        (Sphere(0.5), (3, 0, 0), (-1, 0, 0), 2.5),
        (Sphere(0.5), (3, 0.3, 0), (-1, 0, 0), 2.6),  # 3 - sqrt(.5² - .3²)
        (Sphere(0.5), (3, 0.6, 0), (-1, 0, 0), np.inf),
        (Sphere(0.5), (3, 0, 0), (1, 0, 0), np.inf),  # behind
        (Sphere(0.5), (3, 0, 0), (-2, 0, 0), 1.25),  # t counts in lengths of the direction
        (Box((0.1, 0.2, 0.3)), (1, 0, 0), (-1, 0, 0), 0.9),
        (Box((0.1, 0.2, 0.3)), (0, 0.05, 2), (0, 0, -1), 1.7),
        (Box((0.1, 0.2, 0.3)), (1, 0.21, 0), (-1, 0, 0), np.inf),
        (Cylinder(0.5, 1.0), (3, 0.3, 0.9), (-1, 0, 0), 2.6),
        (Cylinder(0.5, 1.0), (3, 0.3, 1.1), (-1, 0, 0), np.inf),
        (Cylinder(0.5, 1.0), (0.2, 0.1, 4), (0, 0, -1), 3.0),
        (Cylinder(0.5, 1.0), (0.6, 0.0, 4), (0, 0, -1), np.inf),
        (Capsule(0.5, 1.0), (3, 0.3, 0.9), (-1, 0, 0), 2.6),
        (Capsule(0.5, 1.0), (0.3, 0.0, 4), (0, 0, -1), 2.6),  # 4 - 1 - sqrt(.5² - .3²)
        (Room((2, 3, 1)), (0.5, 0, 0), (1, 0, 0), 1.5),
        (Room((2, 3, 1)), (0.5, 0, 0), (0, 1, -1), 1.0),  # the floor before the wall
    ],
)
def test_a_ray_meets_a_solid_at_the_distance_worked_out_by_hand(shape, origin, direction, distance):
    found = shape.hit(np.array(origin, dtype=float), np.array([direction], dtype=float))
    np.testing.assert_allclose(found, [distance], atol=1e-9)


@pytest.mark.parametrize(
    ("shape", "point", "normal"),
    [
        (Sphere(0.5), (0.3, 0.0, 0.4), (0.6, 0.0, 0.8)),
        (Box((0.1, 0.2, 0.3)), (0.05, -0.2, 0.1), (0, -1, 0)),
        (Room((2, 3, 1)), (0.5, 0.5, -1), (0, 0, 1)),
        (Cylinder(0.5, 1.0), (0.3, 0.4, 0.2), (0.6, 0.8, 0)),
        (Cylinder(0.5, 1.0), (0.1, 0.1, -1.0), (0, 0, -1)),
        (Capsule(0.5, 1.0), (0.3, 0.0, 1.4), (0.6, 0.0, 0.8)),
        (Capsule(0.5, 1.0), (0.0, -0.5, 0.9), (0, -1, 0)),
    ],
)
def test_normals_point_out_of_solids_and_into_the_room(shape, point, normal):
    np.testing.assert_allclose(shape.normal(np.array([point], dtype=float)), [normal], atol=1e-12)


def test_depth_is_z_depth_of_a_ball_before_a_wall():
    world = build_world([PlacedObject(BALL, "ball", (0.0, 0.0, 1.0), 0.0)], [])
    traced = trace(world, ODD_CAMERA, look_at([2.0, 0.0, 1.0], [0.0, 0.0, 1.0]))
    assert traced.depth_m[AXIS] == pytest.approx(2.0 - 0.06)
    assert traced.owner[AXIS] == 0
    # Ten columns to the side a ray passes the ball and meets the wall x = -4: its z-depth is 6,
    # whatever its slant, while the distance along the ray is longer.
    assert traced.depth_m[15, 30] == pytest.approx(6.0)
    assert traced.owner[15, 30] == -1


def test_depth_of_the_floor_follows_from_camera_height_and_slope():
    world = build_world([], [])
    traced = trace(world, ODD_CAMERA, look_at([0.0, -2.0, 1.2], [0.0, 0.0, 1.2]))
    row = 30  # 15 pixels under the axis of a level camera: slope 15/40
    np.testing.assert_allclose(traced.depth_m[row], 1.2 / (15 / 40))


def test_yaw_turns_the_handle_of_a_mug_to_where_azimuth_zero_looks_at_it():
    yaw = np.deg2rad(90)
    world = build_world([PlacedObject(MUG, "mug", (0.0, 0.0, 1.0), yaw)], [])
    pose = look_at([0.0, 2.0, 1.0], [0.0, 0.0, 1.0])  # from +y, where a yaw of 90° turns the front
    (true,) = true_objects(world, pose, traced := trace(world, ODD_CAMERA, pose))
    assert true.azimuth_rad == pytest.approx(0.0, abs=1e-9)
    handle = COMPONENTS[MUG][1]
    nearest = 2.0 - handle.offset_m[0] - handle.shape.half_extents_m[0]
    assert traced.depth_m[AXIS] == pytest.approx(nearest)


def test_the_windows_of_the_tracer_lose_no_pixel(monkeypatch):
    walk = make_walk(seed=1, index=0, n_frames=4)
    fast = trace(walk.world, ODD_CAMERA, walk.world_from_cam[2])
    everything = (slice(0, ODD_CAMERA.height_px), slice(0, ODD_CAMERA.width_px))
    monkeypatch.setattr("imodbatch.lab.analytic.render._window", lambda *_: everything)
    slow = trace(walk.world, ODD_CAMERA, walk.world_from_cam[2])
    np.testing.assert_array_equal(fast.depth_m, slow.depth_m)
    np.testing.assert_array_equal(fast.alone, slow.alone)
    assert (slow.owner >= 0).any()


def test_boxes_enclose_exactly_the_pixels_that_show_and_lie_in_the_projected_bounding_box():
    scene = make_scene()
    for frame in range(len(scene.boxes_px)):
        cam_from_world = frames.invert(scene.world_from_cam[frame])
        for index in range(len(scene.class_id)):
            mask = scene.owner[frame] == index
            x0, y0, x1, y1 = scene.boxes_px[frame, index].astype(int)
            assert mask.sum() == mask[y0:y1, x0:x1].sum() > 0
            assert mask[y0].any()
            assert mask[y1 - 1].any()
            assert mask[:, x0].any()
            assert mask[:, x1 - 1].any()
            corners = np.concatenate(
                [
                    frames.apply(part.world_from_part, _corners(part.shape.half_extents_m))
                    for part in scene.world.parts
                    if part.owner == index
                ]
            )
            pixels = CAMERA.project(frames.apply(cam_from_world, corners))
            assert (pixels.min(axis=0) <= [x0 + 0.5, y0 + 0.5]).all()
            assert (pixels.max(axis=0) >= [x1 - 0.5, y1 - 0.5]).all()


def _corners(half_extents):
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    return signs * np.array(half_extents)


def test_bounds_are_the_outer_edges_of_the_outermost_pixels():
    mask = np.zeros((6, 8), dtype=bool)
    mask[2, 3] = mask[4, 6] = True
    assert bounds_of(mask) == (3, 2, 7, 5)


def test_a_point_seen_in_two_frames_has_the_same_place_in_both():
    scene = make_scene()
    points_cam = CAMERA.unproject(CAMERA.pixel_centers(), scene.depth_m[0])
    points_world = frames.apply(scene.world_from_cam[0], points_cam)
    points_there = frames.apply(frames.invert(scene.world_from_cam[1]), points_world)
    on_objects = np.argwhere(scene.owner[0] >= 0)[::10]
    anywhere = np.argwhere(np.isfinite(scene.depth_m[0]))[::400]
    errors = {
        kind: np.array(
            [_depth_at(points_there[tuple(at)]) - points_there[tuple(at)][2] for at in ats]
        )
        for kind, ats in {"objects": on_objects, "anywhere": anywhere}.items()
    }
    for error in errors.values():
        assert error.max() < 1e-9  # something may stand before a point, but never nothing at it
        assert len(error) > 40
        assert np.mean(np.abs(error) < 1e-9) > 0.6


def _depth_at(point_cam):
    """Depth in frame 1 along the ray to a point, by a camera of one pixel centred on it."""
    u, v = CAMERA.project(point_cam)
    pixel = PinholeCamera(
        1, 1, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px - u + 0.5, CAMERA.cy_px - v + 0.5
    )
    return trace(make_scene().world, pixel, make_scene().world_from_cam[1]).depth_m[0, 0]


def test_objects_lie_where_depth_at_their_box_says():
    scene = make_scene()
    voxels = np.floor(scene.xyz_world / VOXEL_SIZE_M)
    for frame, pose in enumerate(scene.world_from_cam):
        centers = (scene.boxes_px[frame, :, :2] + scene.boxes_px[frame, :, 2:]) / 2
        column, row = np.floor(centers).astype(int).T
        points_cam = CAMERA.unproject(centers, scene.depth_m[frame, row, column])
        points = frames.apply(pose, points_cam)
        np.testing.assert_array_equal(np.floor(points / VOXEL_SIZE_M), voxels)


def test_ideal_scores_fuse_to_the_true_class_and_yaw():
    scene = make_scene()
    n_frames, n_objects = scene.azimuth_bin.shape
    assert len(np.unique(scene.elevation_bin)) == GRID.n_elevations
    fused = fuse(
        Sightings(
            frame=np.repeat(np.arange(n_frames), n_objects),
            voxel=np.tile(np.arange(n_objects), n_frames),
            azimuth_bin=scene.azimuth_bin.ravel(),
            elevation_bin=scene.elevation_bin.ravel(),
            view_scores=scene.view_scores.reshape(-1, *scene.view_scores.shape[2:]),
        ),
        "imod",
    )["online"]
    last = fused.score[-n_objects:]
    np.testing.assert_array_equal(last.argmax(axis=1), scene.class_id)
    pose_bin = fused.pose_bin[-n_objects:][np.arange(n_objects), scene.class_id]
    yaw = yaw_from_pose_bin(pose_bin, GRID.n_azimuths)
    np.testing.assert_allclose(yaw, scene.yaw_rad)
    total = scene.view_scores.sum(axis=(2, 3, 4)) + scene.background_score
    np.testing.assert_allclose(total, 1.0)


def test_the_scene_of_the_tests_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        make_scene().depth_m[0, 0, 0] = 1.0


def test_an_object_behind_another_or_across_the_border_is_ignored():
    near, far = (0.5, 0.0, 1.0), (0.0, 0.0, 1.0)
    world = build_world(
        [PlacedObject(BALL, "near", near, 0.0), PlacedObject(MUG, "far", far, 0.0)], []
    )
    behind = look_at([2.0, 0.18, 1.0], [0.0, 0.18, 1.0])
    seen = {t.instance_id: t for t in true_objects(world, behind, trace(world, CAMERA, behind))}
    assert seen["near"].visible_fraction == 1.0
    assert not seen["near"].is_ignored
    assert seen["far"].visible_fraction < 0.4
    assert seen["far"].is_ignored
    aside = look_at([1.0, 0.0, 1.0], [0.5, 0.29, 1.0])
    (cut,) = [t for t in true_objects(world, aside, trace(world, CAMERA, aside)) if t.is_cut]
    assert cut.is_ignored
    assert cut.instance_id == "near"


def test_depth_noise_grows_with_the_square_of_depth_and_holes_gather_at_silhouettes():
    noise = DepthNoise()
    rng = np.random.default_rng(0)
    for depth, sigma in ((1.0, 0.00125), (2.0, 0.005), (4.0, 0.02)):
        measured = disturb(np.full((200, 200), depth), rng, noise)
        assert np.nanstd(measured) == pytest.approx(sigma, rel=0.05)
        assert np.isnan(measured).mean() == pytest.approx(0.01, abs=0.003)
    step = np.full((400, 10), 1.0)
    step[:, 5:] = 2.0
    holes = np.isnan(disturb(step, rng, noise)).mean(axis=0)
    assert (holes[[4, 5]] > 0.4).all()
    assert (np.delete(holes, [4, 5]) < 0.05).all()


def test_depth_is_stored_in_millimetres_with_zero_for_none():
    stored = to_millimetres(np.array([[1.2344, np.nan, 0.5006, 70.0]]))
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[1234, 0, 501, 0]]


def test_a_mug_hides_its_handle_from_behind_only_and_a_ball_never_cares():
    assert resemblance(MUG, np.pi)[1] == 1.0
    assert resemblance(MUG, 0.0)[1] == 0.0
    np.testing.assert_array_equal(resemblance(BALL, 0.3), resemblance(BALL, 2.0))


def test_view_errors_come_as_often_as_stated():
    errors = ViewErrors().draw(np.random.default_rng(0), 16, (20_000,)) % 16
    share = {error: n / errors.size for error, n in Counter(errors.tolist()).items()}
    assert share[0] == pytest.approx(0.57 + 0.05 / 16, abs=0.015)
    assert share[1] + share[15] == pytest.approx(0.30 + 2 * 0.05 / 16, abs=0.015)
    assert share[8] == pytest.approx(0.08 + 0.05 / 16, abs=0.01)


def test_images_on_disk_are_the_frames(written):
    walk = make_walk(seed=4, index=1, n_frames=SIZE["n_frames"])
    for index, frame in enumerate(walk.frames()):
        name = f"{index:06d}.png"
        color = read_color(written / "walk_2" / "color" / name)
        depth_m = read_depth(written / "walk_2" / "depth" / name, 0.001, (0,))
        np.testing.assert_array_equal(color, frame.color)
        np.testing.assert_allclose(depth_m, frame.measured_depth_m, atol=0.0005001)


def test_the_trajectory_reads_back_as_the_camera_poses(written):
    walk = make_walk(seed=4, index=0, n_frames=SIZE["n_frames"])
    stamp, tx, ty, tz, qx, qy, qz, qw = np.loadtxt(written / "walk_1" / "trajectory.txt").T
    rotation = frames.matrix_from_quaternion(np.stack([qw, qx, qy, qz], axis=-1))
    poses = frames.make_transform(rotation, np.stack([tx, ty, tz], axis=-1))
    np.testing.assert_allclose(poses, walk.world_from_cam, atol=1e-9)
    np.testing.assert_allclose(stamp, [0.0, 0.1, 0.2])


def test_cameras_stay_in_the_room_at_a_robots_height_outside_the_furniture():
    for index in range(4):
        x, y, z = make_walk(seed=0, index=index, n_frames=40).world_from_cam[:, :3, 3].T
        assert (np.hypot(x, y) > 0.9).all()
        assert (np.abs([x, y]) < 4).all()
        assert z.min() >= 1.0
        assert z.max() <= 1.5
        if index % 2:
            distance = np.hypot(x, y)
            assert distance[0] > 3
            assert distance[-1] < 1.3


def test_annotations_are_the_visible_boxes(written):
    walk = make_walk(seed=4, index=0, n_frames=SIZE["n_frames"])
    content = json.loads((written / "walk_1" / "annotations.json").read_text())
    assert tuple(c["name"] for c in content["categories"]) == CLASSES
    file_of = {image["id"]: image["file_name"] for image in content["images"]}
    assert all((written / "walk_1" / name).exists() for name in file_of.values())
    rows = iter(content["annotations"])
    for index, pose in enumerate(walk.world_from_cam):
        traced = trace(walk.world, sequence.CAMERA, pose)
        for true in true_objects(walk.world, pose, traced):
            row = next(rows)
            x, y, width, height = row["bbox"]
            assert file_of[row["image_id"]] == f"color/{index:06d}.png"
            assert (x, y, x + width, y + height) == true.box_px
            assert row["category_id"] == true.class_id + 1
            assert row["instance"] == true.instance_id
            assert row["ignore"] == true.is_ignored
    assert next(rows, None) is None


def test_detections_are_whole_softmaxes_in_the_image(written):
    table = pq.read_table(written / "detections.parquet").to_pydict()
    scores = np.array(table["view_scores"])
    assert scores.shape == (len(scores), len(CLASSES) * 3 * 16)
    total = scores.sum(axis=1) + np.array(table["background_score"])
    np.testing.assert_allclose(total, 1.0, atol=1e-6)
    assert scores.min() > 0
    assert min(table["background_score"]) > 0
    x0, y0, x1, y1 = (np.array(table[f"{name}_px"]) for name in ("x0", "y0", "x1", "y1"))
    assert x0.min() >= 0
    assert y0.min() >= 0
    assert x1.max() <= 320
    assert y1.max() <= 240
    assert ((x1 - x0 >= 2) & (y1 - y0 >= 2)).all()
    assert set(table["sequence_id"]) == {"walk_1", "walk_2"}
    assert set(table["frame_index"]) == {0, 1, 2}


def test_a_box_made_from_an_object_mostly_scores_that_object_highest():
    walk = make_walk(seed=0, index=0, n_frames=12)
    class_of = [placed.class_id for placed in walk.world.objects]
    right = [
        found.view_scores.sum(axis=(1, 2)).argmax() == class_of[found.object_index]
        for frame in walk.frames()
        for found in frame.detections
        if found.object_index >= 0
    ]
    assert 0.5 < np.mean(right) < 1.0


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(written, tmp_path):
    write_dataset(tmp_path / "same", seed=4, **SIZE)
    write_dataset(tmp_path / "other", seed=5, **SIZE)
    first, same, other = (contents(f) for f in (written, tmp_path / "same", tmp_path / "other"))
    assert first == same
    assert first.keys() == other.keys()
    assert all(first[name] != other[name] for name in first)


def test_a_sequence_stays_the_same_when_another_is_added(written, tmp_path):
    write_dataset(tmp_path / "one", seed=4, n_sequences=1, n_frames=SIZE["n_frames"])
    one, two = contents(tmp_path / "one"), contents(written)
    shared = [name for name in one if name.startswith("walk_1/")]
    assert len(shared) == 2 * SIZE["n_frames"] + 2
    assert all(one[name] == two[name] for name in shared)


def test_a_complete_dataset_is_left_alone_and_progress_counts_frames(tmp_path):
    calls = []
    arguments = {"n_sequences": 1, "n_frames": 2, "progress": lambda *call: calls.append(call)}
    write_dataset(tmp_path / "data", **arguments)
    assert calls == [(1, 2), (2, 2)]
    write_dataset(tmp_path / "data", **arguments)
    assert len(calls) == 2
    write_dataset(tmp_path / "data", **{**arguments, "n_frames": 1})
    assert len(calls) == 3
    assert not (tmp_path / "data" / "walk_1" / "color" / "000001.png").exists()


def test_an_interrupted_write_shows_no_dataset_and_is_redone(tmp_path):
    folder = tmp_path / "data"

    def stop_at_the_second(done, _total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_dataset(folder, n_sequences=1, n_frames=3, progress=stop_at_the_second)
    assert not folder.exists()
    write_dataset(folder, n_sequences=1, n_frames=3)
    write_dataset(tmp_path / "at_once", n_sequences=1, n_frames=3)
    assert contents(folder) == contents(tmp_path / "at_once")
    assert {path.name for path in tmp_path.iterdir()} == {"data", "at_once"}


@pytest.mark.parametrize("name", ["DONE", "detections.parquet", "walk_1/depth/000000.png"])
@pytest.mark.parametrize("harm", ["lost", "cut short"])
def test_a_damaged_dataset_is_made_again(tmp_path, name, harm):
    folder = tmp_path / "data"
    write_dataset(folder, n_sequences=1, n_frames=1)
    whole = contents(folder)
    if harm == "lost":
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(whole[name][:-5])
    write_dataset(folder, n_sequences=1, n_frames=1)
    assert contents(folder) == whole


def test_a_folder_with_other_files_is_not_replaced(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(DataError, match=r"thesis\.tex"):
        write_dataset(tmp_path, n_sequences=1, n_frames=1)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_the_manifest_says_what_the_writer_does():
    manifest = load_manifest(MANIFEST)
    model = camera_model(manifest)
    assert manifest.classes == CLASSES
    assert model.color == model.depth == sequence.CAMERA
    assert (model.depth_scale_m, model.depth_invalid) == (0.001, (0,))
    assert [s.id for s in manifest.sequences] == [s.path for s in manifest.sequences]
    assert [s.id for s in manifest.sequences] == [make_walk(0, i, 1).sequence_id for i in range(3)]
    assert manifest.detections.path == dataset.DETECTIONS
    assert manifest.detections.n_azimuths == sequence.GRID.n_azimuths
    np.testing.assert_allclose(
        np.deg2rad(manifest.detections.elevations_deg), sequence.GRID.elevations_rad
    )
    assert "SIMULATED" in manifest.description
