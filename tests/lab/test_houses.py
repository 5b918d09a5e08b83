"""Simulated houses: what stands where, how the robot drives, and what lies on disk."""

import hashlib
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.core.frames import apply, invert, is_rigid
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.datasets import index
from imodbatch.datasets.images import read_color
from imodbatch.datasets.registry import camera_model
from imodbatch.lab.houses import (
    backgrounds,
    write_backgrounds,
    write_house_dataset,
)
from imodbatch.lab.houses.dataset import catalogue, sequence_id
from imodbatch.lab.houses.drive import HIGHEST_M, KINDS, LOWEST_M, kind_of, make_drive
from imodbatch.lab.houses.floorplan import LAYOUTS
from imodbatch.lab.houses.manifests import WHAT_IT_DOES, manifest_texts
from imodbatch.lab.houses.odometry import odometry
from imodbatch.lab.houses.planner import ROBOT_RADIUS_M
from imodbatch.lab.houses.sensor import ColorCamera, DepthFaults, measure_depth
from imodbatch.lab.houses.sequence import CAMERA, LEAST_SIDE_PX, LEAST_VISIBLE, frames
from imodbatch.lab.houses.styles import STREAM_OF_SPLIT, STYLES
from imodbatch.lab.houses.world import make_house, random_of
from imodbatch.lab.objects.catalogue import OBJECTS
from imodbatch.lab.render.raycast import Frame
from imodbatch.settings.manifest import load_manifest

SMALL = PinholeCamera(160, 120, 131.25, 131.25, 80.0, 60.0)
HALF = PinholeCamera(320, 240, 262.5, 262.5, 160.0, 120.0)
SPLITS = ("train", "val", "test")


@pytest.fixture(scope="module")
def houses():
    models = catalogue()
    return [make_house(split, k, 0, models) for split in SPLITS for k in (0, 3)]


@pytest.fixture(scope="module")
def drives(houses):
    return [make_drive(house, 40) for house in houses]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("houses") / "house_test"
    write_house_dataset(folder, "test", seed=5, n_worlds=2, n_frames=4, camera=SMALL)
    return folder


@pytest.fixture(scope="module")
def shots(houses, drives):
    """A few frames of a test house, with their poses."""
    house, drive = houses[4], drives[4]
    chosen = np.linspace(8, 39, 6).astype(int)
    part = type(drive)(drive.kind, drive.base_xy_yaw[chosen], drive.world_from_cam[chosen])
    return house, part, list(frames(house, part.world_from_cam, HALF))


def annotations(folder, sequence="house_1"):
    return json.loads((folder / sequence / "annotations.json").read_text())


def digests(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize("n_processes", [1, 2])
def test_the_same_seed_gives_the_same_bytes(dataset, n_processes, tmp_path):
    again = tmp_path / dataset.name
    settings = {"seed": 5, "n_worlds": 2, "n_frames": 4, "camera": SMALL}
    write_house_dataset(again, "test", **settings, n_processes=n_processes)
    assert digests(again) == digests(dataset)


def test_what_is_complete_is_kept_and_what_is_damaged_made_again(dataset):
    before = {path: path.stat().st_mtime_ns for path in dataset.rglob("*.jpg")}
    lost = dataset / "house_2/color/000002.jpg"
    content = lost.read_bytes()
    lost.unlink()
    seen = []
    settings = {"seed": 5, "n_worlds": 2, "n_frames": 4, "camera": SMALL}
    write_house_dataset(dataset, "test", **settings, progress=lambda *n: seen.append(n))
    assert lost.read_bytes() == content
    assert seen[0] == (4, 8)
    assert seen[-1] == (8, 8)
    for path, stamp in before.items():
        if "house_1" in path.parts:
            assert path.stat().st_mtime_ns == stamp
    seen.clear()
    write_house_dataset(dataset, "test", **settings, progress=lambda *n: seen.append(n))
    assert not seen


def test_foreign_files_and_wrong_splits_are_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(DataError, match=r"thesis\.tex"):
        write_house_dataset(tmp_path, "test")
    with pytest.raises(DataError, match="train, val, test"):
        write_house_dataset(tmp_path / "new", "tests")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("file", "poses"),
    [("manifest.toml", "odometry.txt"), ("manifest_true.toml", "trajectory_true.txt")],
)
def test_the_manifest_beside_it_lets_the_stages_read_it(dataset, file, poses):
    manifest = load_manifest(dataset / file)
    assert manifest.name == ("house_test_true" if "true" in file else "house_test")
    assert [sequence.id for sequence in manifest.sequences] == ["house_1", "house_2"]
    assert camera_model(manifest).color == SMALL
    sequence = manifest.sequences[0]
    assert manifest.path_in(sequence, manifest.odometry.path) == dataset / "house_1" / poses
    tables = index.run(manifest, sequence).tables
    frames_table, annotations_table = tables["frames"], tables["annotations"]
    assert frames_table.num_rows == 4
    listed = annotations(dataset)["annotations"]
    assert annotations_table.num_rows == len(listed)
    rows = annotations_table.to_pylist()
    assert sum(row["is_ignored"] for row in rows) == sum(entry["ignore"] for entry in listed)
    assert {row["instance_id"] for row in rows} == {entry["instance"] for entry in listed}


def test_a_manifest_that_is_gone_or_changed_is_written_again_and_nothing_else(dataset):
    seen = []
    (dataset / "manifest_true.toml").unlink()
    (dataset / "manifest.toml").write_text("name = 7")
    settings = {"seed": 5, "n_worlds": 2, "n_frames": 4, "camera": SMALL}
    write_house_dataset(dataset, "test", **settings, progress=lambda *n: seen.append(n))
    assert seen == [(8, 8)]
    assert load_manifest(dataset / "manifest.toml").name == "house_test"
    assert load_manifest(dataset / "manifest_true.toml").name == "house_test_true"


@pytest.mark.parametrize(("split", "n_worlds"), [("test", 4), ("val", 3)])
@pytest.mark.parametrize("suffix", ["", "_true"])
def test_shipped_manifests_say_what_a_dataset_says_of_itself(split, n_worlds, suffix, tmp_path):
    ids = [sequence_id(k) for k in range(n_worlds)]
    name = f"house_{split}"
    texts = manifest_texts(name, split, list(OBJECTS), CAMERA, ids)
    text = texts[f"manifest{suffix}.toml"]
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    shipped = Path(__file__).parents[2] / f"manifests/{name}{suffix}.toml"
    told = [load_manifest(path) for path in (tmp_path / "m.toml", shipped)]
    assert told[0].name == told[1].name
    others = {"name", "root", "description", "pipeline", "simulate"}
    assert told[0].model_dump(exclude=others) == told[1].model_dump(exclude=others)
    # Comments too: which way the robot drives, and what depth means.
    assert text.split("[camera]")[1] == shipped.read_text(encoding="utf-8").split("[camera]")[1]


def test_every_kind_of_drive_is_put_in_words():
    assert set(WHAT_IT_DOES) == set(KINDS)
    assert [kind_of(k) for k in range(5)] == [*KINDS, KINDS[0]]


@pytest.mark.parametrize(
    ("folder", "name"),
    [("mine", "mine"), ("my houses (2)", "my_houses_2_"), (".hidden", "hidden"), ("家", "houses")],
)
def test_odd_names_make_a_manifest_that_loads(folder, name, tmp_path):
    classes = ['a "quoted" \\ name', "Tasse, große", "{braces}"]
    for file, text in manifest_texts(folder, "test", classes, SMALL, ["house_1"]).items():
        (tmp_path / file).write_text(text, encoding="utf-8")
        manifest = load_manifest(tmp_path / file)
        assert manifest.classes == tuple(classes)
        assert manifest.name == name + ("_true" if "true" in file else "")


def test_boxes_enclose_what_shows(shots):
    _, _, taken = shots
    n_counted = 0
    for frame in taken:
        for number in np.unique(frame.instance_ids[frame.instance_ids >= 0]):
            target = shots[0].targets[number]
            seen = next(s for s in frame.seen if s.target is target)
            rows, columns = np.nonzero(frame.instance_ids == number)
            x0, y0, x1, y1 = seen.box_px
            shown = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
            # A ray that grazes may hit in one casting only: a pixel of slack.
            assert (shown[:2] >= np.array([x0, y0]) - 1).all()
            assert (shown[2:] <= np.array([x1, y1]) + 1).all()
            assert seen.n_pixels == len(rows)
            if seen.visibility == 1:
                assert np.abs(shown - [x0, y0, x1, y1]).max() <= 1
            n_counted += not seen.is_ignored
    assert n_counted > 3


def test_ignored_are_the_hidden_the_cut_and_the_tiny(shots):
    for seen in itertools.chain.from_iterable(frame.seen for frame in shots[2]):
        x0, y0, x1, y1 = seen.box_px
        touches = x0 <= 0 or y0 <= 0 or x1 >= HALF.width_px or y1 >= HALF.height_px
        tiny = min(x1 - x0, y1 - y0) < LEAST_SIDE_PX
        if seen.visibility < LEAST_VISIBLE or tiny:
            assert seen.is_ignored
        elif not touches:
            assert not seen.is_ignored


def test_depth_is_exact_within_the_noise_model(shots):
    faults = DepthFaults()
    for frame in shots[2]:
        known = np.isfinite(frame.measured_depth_m)
        assert 0.5 < known.mean() < 0.999
        exact = frame.exact_depth_m[known].astype(np.float64)
        error = (frame.measured_depth_m[known] - exact) / faults.sigma_m(exact)
        assert abs(np.median(error)) < 0.15
        assert 0.8 < np.sqrt(np.mean(np.clip(error, -4, 4) ** 2)) < 1.2
        assert exact.max() < 6.6
        assert exact.min() > 0.38


def test_a_slanted_wall_has_noise_that_grows_with_distance():
    camera = PinholeCamera(200, 200, 300, 300, 100, 100)
    rng = np.random.default_rng(0)
    spread = {}
    for distance in (1.0, 2.0, 4.0):
        depth = np.full((200, 200), distance, np.float32)
        frame = Frame(
            np.zeros((200, 200, 3), np.uint8), depth, np.full((200, 200), -1, np.int32), ()
        )
        measured = measure_depth(frame, camera, {}, rng)
        assert np.isfinite(measured).mean() > 0.98
        spread[distance] = np.nanstd(measured - depth)
    assert 2.5 < spread[2.0] / spread[1.0] < 6
    assert 2.5 < spread[4.0] / spread[2.0] < 6
    assert 0.003 < spread[2.0] < 0.012


def test_depth_has_holes_where_a_sensor_has_them():
    camera = PinholeCamera(200, 200, 300, 300, 100, 100)
    depth = np.full((200, 200), 2.0, np.float32)
    depth[60:140, 60:140] = 1.0
    ids = np.full((200, 200), -1, np.int32)
    ids[60:140, 60:140] = 0
    frame = Frame(np.zeros((200, 200, 3), np.uint8), depth, ids, ())
    measured = measure_depth(frame, camera, {0: 0.7}, np.random.default_rng(0))
    holes = ~np.isfinite(measured)
    assert holes[70:130, 70:130].mean() > 0.2  # it shines
    left, right = holes[70:130, 36:58].mean(), holes[70:130, 142:164].mean()
    assert max(left, right) > 0.8  # the projector's shadow, on one side
    assert min(left, right) < 0.1
    far = Frame(frame.color, np.full((200, 200), 7.0, np.float32), ids, ())
    assert not np.isfinite(measure_depth(far, camera, {}, np.random.default_rng(0))).any()


def test_colour_drifts_blurs_and_is_noisy():
    grey = np.full((60, 80, 3), 120, np.uint8)
    grey[:, 40:] = 20
    camera = ColorCamera(np.random.default_rng(3))
    still = [camera.photograph(grey, (0.0, 0.0)) for _ in range(10)]
    means = np.array([image.mean(axis=(0, 1)) for image in still])
    assert 0.2 < means.std(axis=0).max() < 15
    assert 0.5 < still[0][:, :30].std(axis=(0, 1)).mean() < 6
    smeared = camera.photograph(grey, (8.0, 0.0))
    assert (
        np.abs(np.diff(smeared.mean(axis=(0, 2)))).max()
        < 0.6 * np.abs(np.diff(still[-1].mean(axis=(0, 2)))).max()
    )


def test_targets_stand_on_surfaces_and_do_not_overlap(houses):
    for house in houses:
        assert 8 <= len(house.targets) <= 10
        for target in house.targets:
            z = target.world_from_object[2, 3]
            np.testing.assert_array_equal(target.world_from_object[:3, 2], [0, 0, 1])
            if target.place < 0:
                assert z == 0
                continue
            placed = house.furniture[target.place]
            heights = [support.height_m for support in placed.piece.supports]
            assert np.abs(np.array(heights) - z).min() < 1e-6
            at = target.world_from_object[:2, 3]
            local = placed.world_from_piece[:2, :2].T @ (at - [placed.x_m, placed.y_m])
            half = np.array([placed.piece.half_x_m, placed.piece.half_y_m])
            assert (np.abs(local) + target.radius_m <= half + 1e-9).all()
        for one, other in itertools.combinations(house.targets, 2):
            gap = np.abs(one.world_from_object[:3, 3] - other.world_from_object[:3, 3])
            if gap[2] < 0.05:
                assert np.hypot(*gap[:2]) > one.radius_m + other.radius_m


def test_furniture_stays_in_the_room_and_apart(houses):
    for house in houses:
        half = [house.shell.half_x_m, house.shell.half_y_m]
        for placed in house.furniture:
            assert (np.abs(placed.corners()) <= half).all()
        for one, other in itertools.combinations(house.furniture, 2):
            assert other.distance_m(one.corners()).min() > 0.01


def test_targets_are_dealt_evenly():
    models = catalogue()
    dealt = [t.class_id for k in range(4) for t in make_house("test", k, 0, models).targets]
    assert set(dealt) == set(range(17))
    assert np.bincount(dealt).max() <= 3


def test_the_robot_drives_smoothly_and_hits_nothing(houses, drives):
    for house, drive in zip(houses, drives, strict=True):
        xy = drive.base_xy_yaw[:, :2]
        for placed in house.furniture:
            assert placed.distance_m(xy).min() > ROBOT_RADIUS_M
        assert (np.abs(xy) < [house.shell.half_x_m - 0.2, house.shell.half_y_m - 0.2]).all()
        poses = drive.world_from_cam
        assert is_rigid(poses).all()
        assert ((poses[:, 2, 3] >= LOWEST_M) & (poses[:, 2, 3] <= HIGHEST_M)).all()
        np.testing.assert_allclose(poses[:, :2, 3], xy)
        assert np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < 0.6
        turn = np.einsum("fi,fi->f", poses[:-1, :3, 2], poses[1:, :3, 2])
        assert turn.min() > np.cos(np.deg2rad(45))


def test_a_robot_that_waits_stands_still():
    house = make_house("test", KINDS.index("wait"), 0, catalogue())
    steps = np.linalg.norm(np.diff(make_drive(house, 40).base_xy_yaw[:, :2], axis=0), axis=1)
    assert 6 <= (steps < 1e-9).sum() <= 9


def test_poses_reproject_across_frames(shots):
    _, drive, taken = shots
    checked = 0
    for (one, a), (other, b) in itertools.pairwise(zip(taken, drive.world_from_cam, strict=True)):
        pixels = HALF.pixel_centers()[::6, ::6].reshape(-1, 2)
        depth = one.exact_depth_m[::6, ::6].reshape(-1)
        known = np.isfinite(depth)
        world = apply(a, HALF.unproject(pixels[known], depth[known]))
        there = apply(invert(b), world)
        at = HALF.project(there)
        inside = (
            (at > 1).all(axis=1) & (at[:, 0] < HALF.width_px - 1) & (at[:, 1] < HALF.height_px - 1)
        )
        if inside.sum() < 30:
            continue
        seen = other.exact_depth_m[at[inside, 1].astype(int), at[inside, 0].astype(int)]
        error = (there[inside, 2] - seen) / there[inside, 2]
        # A surface is seen from there too, or something nearer hides it; it cannot be missing.
        assert (error < -0.03).mean() < 0.04
        assert (np.abs(error) < 0.03).mean() > 0.3
        checked += 1
    assert checked > 1


def test_odometry_drifts_as_much_as_stated(drives):
    ways, shares, angles = [], [], []
    for number, drive in enumerate(drives):
        for seed in range(20):
            poses = odometry(drive, np.random.default_rng([number, seed]))
            np.testing.assert_allclose(poses[0], drive.world_from_cam[0], atol=1e-12)
            assert is_rigid(poses).all()
            np.testing.assert_allclose(poses[:, 2], drive.world_from_cam[:, 2], atol=1e-12)
            way = np.linalg.norm(np.diff(drive.base_xy_yaw[:, :2], axis=0), axis=1).sum()
            off = np.linalg.norm((poses - drive.world_from_cam)[:, :3, 3], axis=1)
            relative = drive.world_from_cam[-1, :3, :3].T @ poses[-1, :3, :3]
            ways.append(way)
            shares.append(off.max() / way)
            angles.append(np.arccos(np.clip((np.trace(relative) - 1) / 2, -1, 1)))
    assert 0.01 < np.median(shares) < 0.04
    assert max(shares) < 0.12
    per_root_metre = np.rad2deg(np.sqrt(np.mean(np.square(angles) / np.array(ways))))
    assert 0.8 < per_root_metre < 2.2


def test_labels_agree_with_the_core(dataset):
    elevations = (np.deg2rad(10.0), np.deg2rad(30.0), np.deg2rad(50.0))
    entries = annotations(dataset)["annotations"] + annotations(dataset, "house_2")["annotations"]
    truth = {
        sequence: json.loads((dataset / sequence / "objects.json").read_text())["objects"]
        for sequence in ("house_1", "house_2")
    }
    assert entries
    for entry in entries:
        azimuth, elevation = np.deg2rad(entry["azimuth_deg"]), np.deg2rad(entry["elevation_deg"])
        assert entry["azimuth_bin16"] == ViewGrid(16, elevations).azimuth_bins(azimuth)
        assert entry["azimuth_bin8"] == ViewGrid(8, elevations).azimuth_bins(azimuth)
        assert entry["elevation_bin"] == ViewGrid(8, elevations).elevation_bins(elevation)
    # From the files alone: the camera's place in the object's frame gives the same azimuth.
    for sequence, objects in truth.items():
        lines = (dataset / sequence / "trajectory_true.txt").read_text().splitlines()[1:]
        cameras = np.array([[float(v) for v in line.split()[1:4]] for line in lines])
        of = {item["instance"]: item for item in objects}
        for entry in annotations(dataset, sequence)["annotations"]:
            item = of[entry["instance"]]
            view = cameras[entry["image_id"]] - item["xyz_world_m"]
            azimuth = np.rad2deg(np.arctan2(view[1], view[0])) - item["yaw_deg"]
            assert abs((azimuth - entry["azimuth_deg"] + 180) % 360 - 180) < 1e-3


def test_depth_files_are_millimetres(dataset):
    depth = np.asarray(Image.open(dataset / "house_1/depth/000003.png"))
    assert depth.dtype == np.uint16
    assert depth.shape == (120, 160)
    known = depth[depth > 0]
    assert known.min() >= 400
    assert known.max() <= 6000


def test_splits_share_nothing():
    for one, other in itertools.combinations(SPLITS, 2):
        a, b = STYLES[one], STYLES[other]
        assert not a.recipes & b.recipes
        assert not set(a.tables) & set(b.tables)
        assert a.kelvin[1] < b.kelvin[0] or b.kelvin[1] < a.kelvin[0]
        assert a.room_x_m[1] <= b.room_x_m[0] or b.room_x_m[1] <= a.room_x_m[0]
        for use in a.looks:
            assert not set(a.looks[use].palette) & set(b.looks[use].palette)
        layouts = [{layout.names for layout in LAYOUTS[split]} for split in (one, other)]
        assert not layouts[0] & layouts[1]
        drawn = [random_of(split, 0, 0, 0).integers(2**62) for split in (one, other)]
        assert drawn[0] != drawn[1]
    assert len(set(STREAM_OF_SPLIT.values())) == 3


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """Seven small backgrounds: six of one house and one of the next."""
    folder = tmp_path_factory.mktemp("rooms")
    paths = write_backgrounds(folder, "train", 7, camera=SMALL)
    assert [path.name for path in paths] == [f"background_{k:05d}.jpg" for k in range(7)]
    return folder


def test_backgrounds_hold_no_targets_and_differ(rooms, tmp_path):
    house = make_house("train", 1000, 0, [])
    assert not house.targets
    pictures = [read_color(path) for path in sorted(rooms.glob("*.jpg"))[:3]]
    assert [picture.shape for picture in pictures] == [(120, 160, 3)] * 3
    assert all(picture.std() > 10 for picture in pictures)
    assert not np.array_equal(pictures[0], pictures[1])
    (alone,) = write_backgrounds(tmp_path, "train", 1, camera=SMALL)
    assert alone.read_bytes() == (rooms / alone.name).read_bytes()


def test_backgrounds_are_the_same_by_two_processes(rooms, tmp_path):
    seen = []
    write_backgrounds(
        tmp_path, "train", 7, camera=SMALL, n_processes=2, progress=lambda *n: seen.append(n)
    )
    assert digests(tmp_path) == digests(rooms)
    assert seen[0] == (0, 7)
    assert seen[-1] == (7, 7)


def test_backgrounds_that_are_there_are_kept(rooms, tmp_path):
    """An interrupted run goes on; a damaged picture is made again; fewer or more are the same."""
    folder = tmp_path / "rooms"
    straight = digests(rooms)

    def interrupt(n_done, _total):
        if n_done == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_backgrounds(folder, "train", 7, progress=interrupt, camera=SMALL)
    assert sorted(digests(folder)) == sorted(
        [*(f"background_{k:05d}.jpg" for k in range(6)), "rooms.json"]
    )
    seen = []

    def again(n):
        seen.clear()
        write_backgrounds(
            folder, "train", n, progress=lambda *shares: seen.append(shares), camera=SMALL
        )

    again(7)
    assert seen == [(6, 7), (7, 7)]
    assert digests(folder) == straight
    again(7)
    assert seen == [(7, 7)]
    (folder / "background_00006.jpg").write_bytes(b"half")
    again(7)
    assert seen == [(6, 7), (7, 7)]
    assert digests(folder) == straight
    again(6)
    assert seen == [(6, 6)]
    assert len(list(folder.glob("*.jpg"))) == 6
    again(7)
    assert digests(folder) == straight


def test_backgrounds_of_other_settings_are_replaced(tmp_path, monkeypatch):
    monkeypatch.setattr(backgrounds, "FRAMES_PER_HOUSE", 1)
    first = write_backgrounds(tmp_path, "train", 2, camera=SMALL)[0].read_bytes()
    (path,) = write_backgrounds(tmp_path, "train", 1, seed=1, camera=SMALL)
    assert path.read_bytes() != first
    assert [picture.name for picture in tmp_path.glob("*.jpg")] == [path.name]
    assert len({backgrounds.backgrounds_digest(n=n, seed=s) for n in (1, 2) for s in (0, 1)}) == 4


def test_backgrounds_replace_no_foreign_pictures(tmp_path):
    mine = tmp_path / "background_00000.jpg"
    mine.write_bytes(b"of a holiday")
    with pytest.raises(DataError, match=r"background_00000\.jpg and no rooms\.json"):
        write_backgrounds(tmp_path, "train", 1)
    assert mine.read_bytes() == b"of a holiday"
    with pytest.raises(DataError, match="is a file"):
        write_backgrounds(mine, "train", 1)
    with pytest.raises(DataError, match="train, val, test"):
        write_backgrounds(tmp_path / "new", "trains", 1)
    assert not (tmp_path / "new").exists()
