"""UW RGB-D Scenes v2: the layout, and boxes derived from a labelled cloud of an analytic room."""

import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.frames import apply, invert, make_transform, quaternion_from_matrix
from imodbatch.datasets import index
from imodbatch.datasets.annotations import annotation_files, read_annotations
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.settings.manifest import Manifest, load_manifest

MANIFESTS = Path(__file__).parents[2] / "manifests"
CAMERA = PinholeCamera(320, 240, 285.15, 285.15, 160.0, 120.0)
CLASSES = ["bowl", "cap", "cereal_box", "coffee_mug", "soda_can"]
CEREAL_BOX, COFFEE_MUG, SODA_CAN, SOFA, BACKGROUND = 3, 4, 7, 8, 10


@dataclass(frozen=True)
class Ball:
    """A ball in the world, metres."""

    label: int
    center: tuple
    radius: float

    def depth(self, world_from_cam, rays):
        """z-depth along rays (H, W, 3) of z = 1, inf where they miss."""
        center = apply(invert(world_from_cam), self.center)
        a, b = (rays**2).sum(-1), rays @ center
        root = b**2 - a * (center @ center - self.radius**2)
        z = (b - np.sqrt(np.maximum(root, 0))) / a
        return np.where((root > 0) & (z > 0), z, np.inf)

    def surface(self):
        golden = np.pi * (3 - np.sqrt(5)) * np.arange(12000)
        height = np.linspace(-1, 1, 12000)
        ring = np.sqrt(1 - height**2)
        unit = np.stack([ring * np.cos(golden), ring * np.sin(golden), height], axis=-1)
        return np.asarray(self.center) + self.radius * unit

    def exact_box(self, world_from_cam):
        """Planes through the camera's y (x) axis that touch the ball bound its columns (rows)."""
        x, y, z = apply(invert(world_from_cam), self.center)

        def bounds(across):
            middle, half = np.arctan2(across, z), np.arcsin(self.radius / np.hypot(across, z))
            return np.tan(middle - half), np.tan(middle + half)

        (left, right), (top, bottom) = bounds(x), bounds(y)
        f = CAMERA.fx_px
        return [f * left + 160, f * top + 120, f * right + 160, f * bottom + 120]


@dataclass(frozen=True)
class Block:
    """A box with sides along the world's axes, metres."""

    label: int
    low: tuple
    high: tuple

    def depth(self, world_from_cam, rays):
        eye, directions = world_from_cam[:3, 3], rays @ world_from_cam[:3, :3].T
        with np.errstate(divide="ignore"):
            ends = np.stack([(np.asarray(e) - eye) / directions for e in (self.low, self.high)])
        near, far = ends.min(0).max(-1), ends.max(0).min(-1)
        return np.where((near < far) & (near > 0), near, np.inf)

    def surface(self):
        low, high = np.asarray(self.low), np.asarray(self.high)
        faces, step = [], 0.05 if self.label in (SOFA, BACKGROUND) else 0.003
        for axis in range(3):
            others = [i for i in range(3) if i != axis]
            lines = [
                np.linspace(low[i], high[i], int((high[i] - low[i]) / step) + 2) for i in others
            ]
            grid = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
            for side in (low[axis], high[axis]):
                face = np.full((len(grid), 3), side)
                face[:, others] = grid
                faces.append(face)
        return np.concatenate(faces)

    def exact_box(self, world_from_cam):
        corners = np.array(np.meshgrid(*zip(self.low, self.high, strict=True))).reshape(3, -1).T
        pixels = CAMERA.project(apply(invert(world_from_cam), corners))
        return [*pixels.min(0), *pixels.max(0)]


FLOOR = Block(BACKGROUND, (-2, 0.5, -1), (2, 0.6, 4))
MUG = Ball(COFFEE_MUG, (-0.25, 0.1, 1.2), 0.06)
NEIGHBOR = Ball(COFFEE_MUG, (-0.09, 0.1, 1.2), 0.06)  # 4 cm beside it
BOX = Block(CEREAL_BOX, (0.1, -0.1, 1.4), (0.3, 0.2, 1.5))
CAN = Ball(SODA_CAN, (0.2, 0.05, 1.8), 0.05)  # behind the box
COUCH = Block(SOFA, (-1.5, 0.1, 2.5), (-0.5, 0.5, 3.0))
ROOM = (FLOOR, MUG, NEIGHBOR, BOX, CAN, COUCH)


def turned(angle_deg, place):
    """Camera at a place, turned about its y axis."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return make_transform([[c, 0, s], [0, 1, 0], [-s, 0, c]], place)


POSES = (turned(0, (0, 0, 0)), turned(-10, (0.2, -0.05, 0.1)), turned(-40, (0.9, 0, 1.0)))


def render(things, world_from_cam):
    rays = CAMERA.unproject(CAMERA.pixel_centers(), np.ones((240, 320)))
    depth = np.min([thing.depth(world_from_cam, rays) for thing in things], axis=0)
    return np.where(np.isfinite(depth), np.round(depth * 1000), 0).astype(np.uint16)


def write_ply(path, points, form="binary_little_endian"):
    names = ("x", "y", "z", "diffuse_red", "diffuse_green", "diffuse_blue")
    kinds = ("float",) * 3 + ("uchar",) * 3
    order = ">" if form == "binary_big_endian" else "<"
    head = [f"property {kind} {name}" for kind, name in zip(kinds, names, strict=True)]
    head = [
        "ply",
        f"format {form} 1.0",
        "comment made here",
        f"element vertex {len(points)}",
        *head,
    ]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = np.zeros(
        len(points),
        [(n, order + ("f4" if k == "float" else "u1")) for n, k in zip(names, kinds, strict=True)],
    )
    for axis, name in enumerate("xyz"):
        rows[name] = points[:, axis]
    text = "\n".join(" ".join(map(str, row)) for row in rows.tolist())
    body = (
        (text + "\n3 0 1 2\n").encode() if form == "ascii" else rows.tobytes() + b"\x03" + bytes(12)
    )
    path.write_bytes("\n".join(head).encode() + b"\n" + body)


def write_labels(path, labels):
    path.write_text("\n".join(map(str, [len(labels), *labels])) + "\n")


def write_poses(path, poses):
    rows = [[*quaternion_from_matrix(p[:3, :3]), *p[:3, 3]] for p in poses]
    np.savetxt(path, rows, fmt="%.9f")


def write_cloud(root, things=ROOM, strays=(), form="binary_little_endian"):
    surfaces = [thing.surface() for thing in things]
    labels = np.repeat([thing.label for thing in things], [len(s) for s in surfaces])
    points = np.concatenate([*surfaces, *(np.asarray(place) for _, place in strays)])
    labels = np.concatenate([labels, *(np.full(len(p), label) for label, p in strays)])
    order = np.random.default_rng(0).permutation(len(points))
    write_ply(root / "pc" / "01.ply", points[order], form)
    write_labels(root / "pc" / "01.label", labels[order].astype(int).tolist())


@pytest.fixture(scope="module")
def pristine_room(tmp_path_factory):
    root = tmp_path_factory.mktemp("rgbd-scenes-v2")
    images = root / "imgs" / "scene_01"
    images.mkdir(parents=True)
    (root / "pc").mkdir()
    for number, pose in enumerate(POSES):
        Image.new("RGB", (320, 240)).save(images / f"{number:05d}-color.png")
        Image.fromarray(render(ROOM, pose)).save(images / f"{number:05d}-depth.png")
    write_poses(root / "pc" / "01.pose", POSES)
    write_cloud(root)
    return root


@pytest.fixture
def room(pristine_room, tmp_path):
    """Three frames of the room, all files of the layout; they may be spoilt."""
    return shutil.copytree(pristine_room, tmp_path / "rgbd-scenes-v2")


def split(root, frames=None, path="scene_01", camera=None, **annotations):
    return Manifest(
        name="uw2",
        adapter="rgbd_scenes_v2",
        root=str(root),
        classes=CLASSES,
        camera={"color": vars(CAMERA), **(camera or {})},
        annotations={"format": "uw_labelled_cloud", "path": "pc/{number}.ply", **annotations},
        sequences=[{"id": "scene_01", "path": path, "frames": frames}],
    )


def read(manifest):
    section = manifest.sequences[0]
    frames = layout_of(manifest).frames(manifest, section)
    return read_annotations(manifest, section, frames, 320, 240)


def by_instance(reading, frame=0):
    return {row["instance_id"]: row for row in reading.rows if row["frame_index"] == frame}


def box_of(row):
    return [row[name] for name in ("x0_px", "y0_px", "x1_px", "y1_px")]


def fault(action, *mentions, kind=DataError):
    with pytest.raises(kind) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_frames_and_poses(room):
    (room / "imgs" / "scene_01" / "00001-depth.png").unlink()
    manifest = split(room)
    section, adapter = manifest.sequences[0], layout_of(manifest)
    frames = adapter.frames(manifest, section)
    assert [(f.frame_index, f.color_path, f.depth_path) for f in frames[:2]] == [
        (0, "imgs/scene_01/00000-color.png", "imgs/scene_01/00000-depth.png"),
        (1, "imgs/scene_01/00001-color.png", None),
    ]
    for poses in (
        adapter.odometry(manifest, section),
        adapter.reference(manifest, section),
    ):
        assert poses.frame_index.tolist() == [0, 1, 2]
        assert np.allclose(poses.world_from_color, POSES, atol=1e-6)
    assert adapter.odometry_files(manifest, section) == [room / "pc" / "01.pose"]
    assert adapter.reference_files(manifest, section) == [room / "pc" / "01.pose"]
    (room / "pc" / "01.pose").unlink()
    assert adapter.reference(manifest, section) is None
    fault(lambda: adapter.odometry(manifest, section), "01.pose", "no such file")


def test_the_camera_is_that_of_the_first_release():
    plain = split(".").model_copy(update={"camera": load_default_camera()})
    model = camera_model(plain)
    assert model.color == model.depth == PinholeCamera(640, 480, 570.3, 570.3, 319.5, 239.5)
    assert camera_model(split(".", camera={"depth": {"scale_m": 0.0001}})).depth_scale_m == 0.0001


def load_default_camera():
    return Manifest(
        name="x", adapter="rgbd_scenes_v2", classes=["cap"], sequences=[{"id": "s"}]
    ).camera


def test_boxes_of_what_is_seen_are_exact(room):
    found = by_instance(read(split(room)))
    mugs = sorted((found["coffee_mug_1"], found["coffee_mug_2"]), key=box_of)
    for row, thing in ((mugs[0], MUG), (mugs[1], NEIGHBOR), (found["cereal_box_1"], BOX)):
        assert not row["is_ignored"]
        assert np.abs(np.subtract(box_of(row), thing.exact_box(POSES[0]))).max() < 0.7
    assert [found[i]["class_id"] for i in ("cereal_box_1", "coffee_mug_1")] == [2, 3]


def test_boxes_follow_the_camera(room):
    found = by_instance(read(split(room)), frame=1)
    row = found["cereal_box_1"]
    assert not row["is_ignored"]
    assert np.abs(np.subtract(box_of(row), BOX.exact_box(POSES[1]))).max() < 0.7
    assert np.abs(np.subtract(box_of(row), BOX.exact_box(POSES[0]))).max() > 10


def test_what_is_hidden_keeps_its_whole_box_and_is_ignored(room):
    manifest = split(room)
    hidden = by_instance(read(manifest))["soda_can_1"]
    assert hidden["is_ignored"]
    assert np.abs(np.subtract(box_of(hidden), CAN.exact_box(POSES[0]))).max() < 0.7
    beside_the_box = by_instance(read(manifest), frame=2)["soda_can_1"]
    assert not beside_the_box["is_ignored"]
    assert np.abs(np.subtract(box_of(beside_the_box), CAN.exact_box(POSES[2]))).max() < 0.7


@pytest.mark.parametrize(("covered", "is_ignored"), [(0.35, False), (0.8, True)])
def test_the_visible_share_decides(room, covered, is_ignored):
    path = room / "imgs" / "scene_01" / "00000-depth.png"
    depth = np.array(Image.open(path))
    x0, y0, x1, y1 = BOX.exact_box(POSES[0])
    cover = int(x0 + covered * (x1 - x0))
    depth[int(y0) - 1 : int(y1) + 2, int(x0) - 1 : cover] = 900
    Image.fromarray(depth).save(path)
    row = by_instance(read(split(room)))["cereal_box_1"]
    assert row["is_ignored"] == is_ignored
    assert np.abs(np.subtract(box_of(row), [x0, y0, x1, y1])).max() < 0.7


def test_without_depth_nobody_knows_what_is_seen(room):
    images = room / "imgs" / "scene_01"
    (images / "00000-depth.png").unlink()
    whole = (images / "00001-depth.png").read_bytes()
    (images / "00001-depth.png").write_bytes(whole[: len(whole) // 2])
    reading = read(split(room))
    for frame in (0, 1):
        rows = by_instance(reading, frame).values()
        assert len(rows) >= 3
        assert all(row["is_ignored"] for row in rows)


def test_every_object_and_frame_is_accounted_for(room):
    manifest = split(room)
    reading = read(manifest)
    outside = reading.left_out["outside image"]
    assert len(reading.rows) + outside == 4 * len(POSES)  # four objects of our classes
    assert outside > 0
    assert reading.left_out["unknown class"] == 1  # the sofa
    assert set(reading.left_out) == {"outside image", "unknown class"}
    fault(lambda: read(split(room, unknown_classes="error")), "label 8", "'sofa'")
    whole = index.run(manifest, manifest.sequences[0])
    assert f"{len(reading.rows) + sum(reading.left_out.values())} annotations" in whole.summary
    sliced = read(split(room, frames="1:2"))
    assert {row["frame_index"] for row in sliced.rows} == {1}
    assert [box_of(r) for r in sliced.rows] == [
        box_of(r) for r in reading.rows if r["frame_index"] == 1
    ]


def test_cut_boxes_are_ignored_and_end_at_the_border(room):
    """Most of the right-hand mug is in view and seen."""
    pose = turned(0, (0.4, 0, 0.3))
    write_poses(room / "pc" / "01.pose", [*POSES[:2], pose])
    Image.fromarray(render(ROOM, pose)).save(room / "imgs" / "scene_01" / "00002-depth.png")
    found = by_instance(read(split(room)), frame=2)
    (mug,) = (row for name, row in found.items() if name.startswith("coffee_mug"))
    x0, *others = NEIGHBOR.exact_box(pose)
    assert -20 < x0 < -5
    assert mug["is_ignored"]
    assert mug["x0_px"] == 0
    assert np.abs(np.subtract(box_of(mug)[1:], others)).max() < 0.7
    assert not found["cereal_box_1"]["is_ignored"]


def test_stray_points_make_no_object_and_widen_no_box(room):
    """A clump of 1 cm and a single point in the air; single points near the box are noise."""
    rng = np.random.default_rng(1)
    clump = np.array([-0.5, -0.2, 1.5]) + 0.005 * rng.uniform(-1, 1, (400, 3))
    near_the_box = [[0.32, 0.0, 1.45], [0.08, 0.05, 1.45], [0.2, -0.12, 1.45]]
    write_cloud(room, strays=[(CEREAL_BOX, clump), (CEREAL_BOX, near_the_box), (2, [[0, 0, 1.0]])])
    reading = read(split(room))
    assert reading.left_out["cluster too small"] == 2
    row = by_instance(reading)["cereal_box_1"]
    assert np.abs(np.subtract(box_of(row), BOX.exact_box(POSES[0]))).max() < 0.7
    assert "cap_1" not in by_instance(reading)


def test_the_gap_is_a_setting(room):
    """The mugs stand 4 cm apart."""
    merged = by_instance(read(split(room, cluster_gap_m=0.06)))
    assert "coffee_mug_2" not in merged
    left, right = MUG.exact_box(POSES[0]), NEIGHBOR.exact_box(POSES[0])
    assert np.allclose(box_of(merged["coffee_mug_1"])[::2], [left[0], right[2]], atol=0.7)


@pytest.mark.parametrize("form", ["ascii", "binary_big_endian"])
def test_other_forms_of_ply(room, form):
    expected = [box_of(row) for row in read(split(room)).rows]
    write_cloud(room, form=form)
    assert np.allclose([box_of(row) for row in read(split(room)).rows], expected, atol=0.01)


def test_another_unit_of_depth_is_noticed(room):
    """Images in 0.1 mm, read as millimetres, would hide every object without a word."""
    for number in range(3):
        path = room / "imgs" / "scene_01" / f"{number:05d}-depth.png"
        Image.fromarray(
            (np.array(Image.open(path)).astype(np.uint32) * 10).clip(0, 65535).astype(np.uint16)
        ).save(path)
    fault(lambda: read(split(room)), "10 times as far", "camera.depth.scale_m = 0.0001")
    found = by_instance(read(split(room, camera={"depth": {"scale_m": 0.0001}})))
    assert not found["cereal_box_1"]["is_ignored"]


def test_frames_whose_pose_is_lost(room):
    lines = (room / "pc" / "01.pose").read_text().splitlines()
    lines[1] = "nan nan nan nan nan nan nan"
    (room / "pc" / "01.pose").write_text("\n".join(lines))
    reading = read(split(room))
    assert reading.left_out["no pose"] == 4
    assert {row["frame_index"] for row in reading.rows} == {0, 2}


def test_poses_for_other_frames(room):
    write_poses(room / "pc" / "01.pose", POSES[:2])
    fault(lambda: read(split(room)), "01.pose", "2 lines for 3 frames")


def test_files_for_provenance_and_missing_ones(room):
    manifest = split(room)
    paths = annotation_files(manifest, manifest.sequences[0])
    assert paths == [room / "pc" / name for name in ("01.label", "01.ply", "01.pose")]
    for path in paths:
        path.rename(f"{path}.away")
        fault(lambda: read(manifest), path, "no such file", "annotations.path")
        Path(f"{path}.away").rename(path)


def test_labels_that_do_not_fit(room):
    path = room / "pc" / "01.label"
    numbers = path.read_text().split()
    cases = {
        "labels for": [str(len(numbers) - 2), *numbers[1:-1]],
        "follow": numbers[:-1],
        "more than numbers": [*numbers[:-1], "mug"],
        "no whole numbers": [*numbers[:-1], "1.5"],
        "label 11 is not one of": [*numbers[:-1], "11"],
    }
    for mention, content in cases.items():
        path.write_text("\n".join(content))
        fault(lambda: read(split(room)), path, mention)
    path.write_text("")
    fault(lambda: read(split(room)), path)


def test_clouds_that_cannot_be_read(room):
    path = room / "pc" / "01.ply"
    whole = path.read_bytes()
    body = whole.index(b"end_header")
    cases = {
        "is no PLY file": b"obj" + whole[3:],
        "cut short": whole[: body + 2000],
        "the end of the file": whole[: body - 5],
        "format zip 1.0": whole.replace(b"binary_little_endian", b"zip"),
        "no 'z'": whole.replace(b"float z", b"float w"),
        "property quad": whole.replace(b"property float x", b"property quad x"),
        "not begin with the vertices": whole.replace(b"element vertex", b"element camera"),
    }
    for mention, content in cases.items():
        path.write_bytes(content)
        fault(lambda: read(split(room)), path, mention)
    path.write_bytes(whole.replace(b"binary_little_endian", b"ascii"))
    fault(lambda: read(split(room)), path)


def test_paths_that_cannot_be_meant(room):
    fault(lambda: read(split(room, path="scene_02")), "scene_02: no such folder", "sequences.path")
    (room / "imgs" / "first").mkdir()
    fault(
        lambda: read(split(room, path="first")),
        "no number at its end",
        "{number}",
        kind=ConfigError,
    )


def test_the_shipped_manifest(monkeypatch, tmp_path):
    monkeypatch.setenv("IMODBATCH_DATA", str(tmp_path))
    manifest = load_manifest(MANIFESTS / "rgbd_scenes_v2.toml")
    assert [s.path for s in manifest.sequences] == [f"scene_{n:02d}" for n in range(1, 15)]
    assert list(manifest.classes) == CLASSES
    files = layout_of(manifest).odometry_files(manifest, manifest.sequences[11])
    assert files == [tmp_path / "rgbd-scenes-v2" / "pc" / "12.pose"]


def test_nothing_left_out_twice(room):
    """The same scene without strays or furniture: only what lies outside images is left out."""
    write_cloud(room, things=(FLOOR, MUG))
    reading = read(split(room))
    assert set(reading.left_out) <= {"outside image"}
    assert Counter(row["instance_id"] for row in reading.rows)["coffee_mug_1"] >= 2
