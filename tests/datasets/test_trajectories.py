"""Trajectory files of five formats, in every variant a manifest can name, and every fault."""

import numpy as np
import pytest

from imodbatch.core.errors import DataError
from imodbatch.core.frames import (
    invert,
    make_transform,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from imodbatch.datasets.base import FrameFile, nanoseconds
from imodbatch.datasets.trajectories import NO_STAMP, read_odometry, trajectory_files
from imodbatch.poses.association import from_odometry
from imodbatch.settings.config import PosesConfig
from imodbatch.settings.manifest import Manifest
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import FRAMES

Q_WXYZ = np.array([0.9, 0.1, -0.3, 0.2]) / np.linalg.norm([0.9, 0.1, -0.3, 0.2])
POSE = make_transform(matrix_from_quaternion(Q_WXYZ), [0.5, -1.0, 2.0])
OTHER = make_transform(matrix_from_quaternion([0.5, 0.5, 0.5, 0.5]), [1.0, 2.0, 3.0])
W, X, Y, Z = (repr(float(value)) for value in Q_WXYZ)
TUM_LINE = f"0.5 -1.0 2.0 {X} {Y} {Z} {W}"
CSV_HEADER = "tx,ty,tz,qw,qx,qy,qz"
CSV_LINE = f"0.5,-1.0,2.0,{W},{X},{Y},{Z}"
COLOR_FROM_DEPTH = make_transform(matrix_from_quaternion([1, 0.02, 0.01, 0]), [-0.03, 0.0, 0.01])
S = 1_000_000_000
CAMERA = {"width_px": 4, "height_px": 3, "fx_px": 5, "fy_px": 5, "cx_px": 2, "cy_px": 1.5}


def split(root, odometry, frames=None, **camera):
    return Manifest(
        name="tiny",
        adapter="folder",
        root=str(root),
        classes=["mug"],
        camera=camera,
        odometry=odometry,
        sequences=[{"id": "s", "path": "walk", "frames": frames}],
    )


def read(root, odometry, numbers=(), frames=None, **camera):
    manifest = split(root, odometry, frames, **camera)
    files = [FrameFile(number, None, f"{number}.png", None) for number in numbers]
    return read_odometry(manifest.odometry, manifest, manifest.sequences[0], files)


def put(root, text, name="t.txt"):
    path = root / "walk" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def tum(root, text, **more):
    put(root, text)
    camera = {key: more.pop(key) for key in ("color_from_depth",) if key in more}
    return read(root, {"format": "tum", "path": "t.txt", **more}, **camera)


def table(root, header, *lines, **more):
    put(root, "\n".join([header, *lines]), "t.csv")
    return read(root, {"format": "csv", "path": "t.csv", **more})


def matrices(root, poses, **more):
    for number, pose in poses.items():
        path = root / "walk" / "pose" / f"{number:04d}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, pose)
    keys = ("color_from_depth", "frames")
    camera = {key: more.pop(key) for key in keys if key in more}
    return read(root, {"format": "matrix", "path": "pose/{frame}.txt", **more}, **camera)


def kitti_line(pose):
    return " ".join(repr(float(value)) for value in pose[:3].ravel())


def fault(action, *mentions):
    with pytest.raises(DataError) as caught:
        action()
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


# --- TUM


def test_tum(tmp_path):
    text = f"# stamp tx ty tz qx qy qz qw\n\n  \n1305031102.175304 {TUM_LINE} # first\n7 {TUM_LINE}"
    odometry = tum(tmp_path, text)
    assert np.allclose(odometry.world_from_color, POSE, atol=1e-12)
    assert odometry.timestamp_ns.tolist() == [1305031102175304000, 7 * S]
    assert odometry.frame_index is None


def test_tum_with_the_scalar_first(tmp_path):
    line = f"1 0.5 -1.0 2.0 {W} {X} {Y} {Z}"
    right = tum(tmp_path, line, quaternion_order="wxyz")
    assert np.allclose(right.world_from_color, POSE, atol=1e-12)
    wrong = tum(tmp_path, line)
    assert not np.allclose(wrong.world_from_color, POSE, atol=0.1)


def test_separators_and_a_byte_order_mark(tmp_path):
    odometry = tum(tmp_path, f"\ufeff1, {TUM_LINE.replace(' ', ', ')}\r\n2\t{TUM_LINE}\r\n")
    assert odometry.timestamp_ns.tolist() == [S, 2 * S]
    assert np.allclose(odometry.world_from_color, POSE, atol=1e-12)


def test_duplicate_and_unsorted_stamps_are_kept_as_they_stand(tmp_path):
    odometry = tum(tmp_path, "\n".join(f"{stamp} {TUM_LINE}" for stamp in (3, 1, 3, 2)))
    assert odometry.timestamp_ns.tolist() == [3 * S, S, 3 * S, 2 * S]


def test_the_clock_offset_is_added_to_the_stamps(tmp_path):
    text = f"10 {TUM_LINE}\nnan {TUM_LINE}"
    for offset_ms, expected in ((2.5, 10_002_500_000), (-1000, 9 * S)):
        odometry = tum(tmp_path, text, clock_offset_ms=offset_ms)
        assert odometry.timestamp_ns[0] == expected
        assert odometry.timestamp_ns[1] == NO_STAMP
        assert np.isnan(odometry.world_from_color[1]).all()


def test_quaternions_that_are_none_lose_their_pose_alone(tmp_path):
    bad = ["0 0 0 0", "nan 0 0 1", "0 0 0 2", "0 0 0 inf"]
    text = "\n".join([f"1 {TUM_LINE}", *(f"{i} 1 2 3 {q}" for i, q in enumerate(bad))])
    odometry = tum(tmp_path, text)
    assert np.isfinite(odometry.world_from_color).all(axis=(1, 2)).tolist() == [True] + 4 * [False]


def test_printed_quaternions_are_normalised(tmp_path):
    odometry = tum(tmp_path, "1 0 0 0 0.0 0.7071 0.0 0.7071")
    rotation = odometry.world_from_color[0, :3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.allclose(rotation @ [0, 0, 1], [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("n", [7, 9, 12])
def test_tum_with_another_number_of_columns(tmp_path, n):
    put(tmp_path, f"# head\n1 {TUM_LINE}\n" + " ".join(["0"] * n))
    fault(
        lambda: read(tmp_path, {"format": "tum", "path": "t.txt"}),
        tmp_path / "walk" / "t.txt",
        f"line 3: expected 8 numbers, found {n}",
        "odometry.format",
    )


def test_what_is_no_number(tmp_path):
    line = TUM_LINE.replace("2.0", "2.0m")
    fault(lambda: tum(tmp_path, f"\n1 {line}"), "t.txt, line 2: '2.0m' is no number")
    fault(lambda: tum(tmp_path, f"12:30 {TUM_LINE}"), "t.txt, line 1: '12:30' is no number")


def test_stamps_in_nanoseconds_are_refused(tmp_path):
    text = f"1 {TUM_LINE}\n1403636579763555584 {TUM_LINE}"
    fault(lambda: tum(tmp_path, text), "line 2", "no moment in seconds", "unit")


def test_empty_files(tmp_path):
    odometry = tum(tmp_path, "# nothing yet\n")
    assert odometry.world_from_color.shape == (0, 4, 4)
    assert odometry.timestamp_ns.shape == (0,)
    fault(lambda: table(tmp_path, ""), "t.csv: no column 'tx'")
    assert table(tmp_path, f"timestamp_s,{CSV_HEADER}").world_from_color.shape == (0, 4, 4)
    put(tmp_path, "")
    kitti = {"format": "kitti", "path": "t.txt"}
    fault(lambda: read(tmp_path, kitti, numbers=(0,)), "0 lines for 1 frames")


@pytest.mark.parametrize("form", ["tum", "kitti", "csv"])
def test_missing_files(tmp_path, form):
    section = {"format": form, "path": "nowhere.txt"}
    fault(lambda: read(tmp_path, section), "nowhere.txt: no such file", "odometry.path")


def test_files_that_are_no_text(tmp_path):
    path = put(tmp_path, "")
    path.write_bytes(b"\xff\xfe\x00\x01")
    fault(lambda: read(tmp_path, {"format": "tum", "path": "t.txt"}), path, "as text")
    (tmp_path / "walk" / "folder").mkdir()
    fault(lambda: read(tmp_path, {"format": "tum", "path": "folder"}), "folder", "cannot be read")


def test_one_file_for_all_sequences_or_one_each(tmp_path):
    (tmp_path / "all.txt").write_text("1 1 1 1 0 0 0 1")
    manifest = split(tmp_path, {"format": "tum", "path": "{sequence}_poses.txt"})
    files = trajectory_files(manifest.odometry, manifest, manifest.sequences[0])
    assert files == [tmp_path / "walk_poses.txt"]
    assert len(read(tmp_path, {"format": "tum", "path": "all.txt"}).timestamp_ns) == 1


# --- what the numbers mean: the right setting gives the true poses, a wrong one others


def walk_files(root, poses, **more):
    """A TUM file of poses at 0, 0.1, … s, and its reading."""
    lines = []
    for i, pose in enumerate(poses):
        w, x, y, z = quaternion_from_matrix(pose[:3, :3])
        numbers = [i / 10, *pose[:3, 3], x, y, z, w]
        lines.append(" ".join(repr(float(number)) for number in numbers))
    return tum(root, "\n".join(lines), **more).world_from_color


@pytest.mark.parametrize("wrong", [{"convention": "cam_from_world"}, {"quaternion_order": "wxyz"}])
def test_a_wrong_meaning_gives_other_poses(tmp_path, wrong):
    truth = np.stack([POSE, OTHER @ POSE, POSE @ OTHER])
    assert np.allclose(walk_files(tmp_path, truth), truth, atol=1e-9)
    found = walk_files(tmp_path, truth, **wrong)
    assert np.abs(found - truth).max(axis=(1, 2)).min() > 0.1


def test_an_inverted_file_needs_its_convention(tmp_path):
    truth = np.stack([POSE, OTHER @ POSE, POSE @ OTHER])
    found = walk_files(tmp_path, invert(truth), convention="cam_from_world")
    assert np.allclose(found, truth, atol=1e-9)


def test_a_clock_that_runs_ahead_is_set_right_by_its_offset(tmp_path):
    """The trajectory's clock shows 250 ms more than the cameras'; the camera moves at 1 m/s."""
    seconds = np.arange(30) / 20
    frames = from_rows(
        FRAMES,
        [
            {
                "sequence_id": "s",
                "frame_index": i,
                "timestamp_ns": round(t * S),
                "color_path": f"{i}.png",
                "depth_scale_m": 0.001,
                **CAMERA,
                **{f"depth_{name}": value for name, value in CAMERA.items()},
            }
            for i, t in enumerate(seconds)
        ],
    )
    text = "\n".join(f"{t + 0.25:.3f} {t:.3f} 0 0 0 0 0 1" for t in seconds)

    def places(**more):
        trajectory = from_odometry(frames, tum(tmp_path, text, **more), PosesConfig())
        return trajectory.poses.world_from_cam[:, 0, 3]

    assert np.allclose(places(clock_offset_ms=-250), seconds, atol=1e-6)
    off = np.abs(places() - seconds)
    assert np.isnan(off[:5]).all()  # before the trajectory's first stamp
    assert np.allclose(off[5:], 0.25, atol=1e-6)


def test_settings_that_mean_nothing_are_refused(tmp_path):
    for form, setting in (
        ("kitti", {"quaternion_order": "wxyz"}),
        ("csv", {"quaternion_order": "xyzw"}),
        ("matrix", {"clock_offset_ms": 5.0}),
        ("uw", {"clock_offset_ms": 5.0}),
        ("tum", {"columns": {"tx": "x"}}),
    ):
        with pytest.raises(ValueError, match=f"{next(iter(setting))} means nothing .*{form!r}"):
            split(tmp_path, {"format": form, "path": "t.txt", **setting})


def test_cam_from_world_is_inverted(tmp_path):
    inverse = invert(POSE)
    odometry = matrices(tmp_path, {0: inverse, 1: OTHER}, convention="cam_from_world")
    assert np.allclose(odometry.world_from_color[0], POSE, atol=1e-9)
    assert np.allclose(odometry.world_from_color[1] @ OTHER, np.eye(4), atol=1e-9)


def test_the_unit_scales_places_before_the_inversion(tmp_path):
    millimetres = invert(POSE)
    millimetres[:3, 3] *= 1000
    odometry = matrices(tmp_path, {0: millimetres}, convention="cam_from_world", unit_m=0.001)
    assert np.allclose(odometry.world_from_color[0], POSE, atol=1e-9)


def test_poses_of_the_depth_camera(tmp_path):
    rows = COLOR_FROM_DEPTH.tolist()
    own = tum(tmp_path, f"1 {TUM_LINE}", color_from_depth=rows)
    assert np.allclose(own.world_from_color[0], POSE, atol=1e-12)
    depth = tum(tmp_path, f"1 {TUM_LINE}", camera="depth", color_from_depth=rows)
    assert np.allclose(depth.world_from_color[0], POSE @ np.linalg.inv(COLOR_FROM_DEPTH))


# --- KITTI


def test_kitti_has_a_line_per_frame(tmp_path):
    put(tmp_path, f"{kitti_line(POSE)}\n\n{kitti_line(OTHER)}\n")
    odometry = read(tmp_path, {"format": "kitti", "path": "t.txt"}, numbers=(4, 9))
    assert np.allclose(odometry.world_from_color, [POSE, OTHER], atol=1e-12)
    assert odometry.frame_index.tolist() == [4, 9]
    assert odometry.timestamp_ns is None


@pytest.mark.parametrize(
    ("n_lines", "numbers", "frames", "expected"),
    [
        (3, (1, 2, 3), None, [1, 2, 3]),  # as many lines as frames: they start together
        (4, (0, 1, 3), None, [0, 1, 2, 3]),  # an image is missing: line i is frame i
        (6, (1, 2, 3, 4, 5, 6), "2:4", [1, 2, 3, 4, 5, 6]),  # a slice moves nothing
        (2, (1, 2, 3, 4, 5, 6), "2:4", [2, 3]),  # poses of the slice alone
    ],
)
def test_which_line_is_which_frame(tmp_path, n_lines, numbers, frames, expected):
    put(tmp_path, "\n".join([kitti_line(POSE)] * n_lines))
    odometry = read(tmp_path, {"format": "kitti", "path": "t.txt"}, numbers, frames)
    assert odometry.frame_index.tolist() == expected


def test_kitti_with_too_few_lines(tmp_path):
    put(tmp_path, "\n".join([kitti_line(POSE)] * 3))
    fault(
        lambda: read(tmp_path, {"format": "kitti", "path": "t.txt"}, (0, 1, 2, 3, 7)),
        "3 lines for 5 frames numbered 0 to 7",
        "TUM or CSV",
    )


def test_kitti_with_16_columns(tmp_path):
    put(tmp_path, " ".join(["0"] * 16))
    section = {"format": "kitti", "path": "t.txt"}
    fault(lambda: read(tmp_path, section, (0,)), "line 1: expected 12 numbers, found 16")


# --- UW


def uw(root, lines, numbers, **more):
    put(root, "\n".join(lines), "01.pose")
    return read(root, {"format": "uw", "path": "01.pose", **more}, numbers)


def test_uw_v2_has_the_scalar_first_and_a_line_per_frame(tmp_path):
    lines = [f"{W} {X} {Y} {Z} 0.5 -1.0 2.0", "0.5 0.5 0.5 0.5 1 2 3"]
    odometry = uw(tmp_path, lines, (0, 1))
    assert np.allclose(odometry.world_from_color, [POSE, OTHER], atol=1e-12)
    assert odometry.frame_index.tolist() == [0, 1]
    assert odometry.timestamp_ns is None
    wrong = uw(tmp_path, lines[:1], (0,), quaternion_order="xyzw")
    assert not np.allclose(wrong.world_from_color, POSE, atol=0.1)


def test_uw_aligned_v1_has_two_stamps_first(tmp_path):
    lines = [f"{t} {t + 7} {W} {X} {Y} {Z} 0.5 -1.0 2.0" for t in (1299116424, 1299116425)]
    odometry = uw(tmp_path, lines, (1, 2))  # the scenes of v1 count frames from 1
    assert np.allclose(odometry.world_from_color, POSE, atol=1e-12)
    assert odometry.frame_index.tolist() == [1, 2]


def test_uw_with_other_columns(tmp_path):
    seven, nine = "1 0 0 0 1 2 3", "5 6 1 0 0 0 1 2 3"
    fault(lambda: uw(tmp_path, ["1 2 3"], (0,)), "line 1: expected 7 or 9 numbers, found 3")
    fault(lambda: uw(tmp_path, [seven, nine], (0, 1)), "line 2: expected 7 numbers, found 9")
    fault(lambda: uw(tmp_path, [nine, seven], (0, 1)), "line 2: expected 9 numbers, found 7")
    fault(lambda: uw(tmp_path, [seven], (0, 1)), "1 lines for 2 frames numbered 0 to 1")


# --- a matrix per file


def test_matrices_of_four_or_three_rows(tmp_path):
    odometry = matrices(tmp_path, {2: POSE, 11: OTHER[:3]})
    assert odometry.frame_index.tolist() == [2, 11]
    assert np.allclose(odometry.world_from_color, [POSE, OTHER], atol=1e-9)


def test_matrices_outside_the_slice_are_not_read(tmp_path):
    matrices(tmp_path, dict.fromkeys(range(4), POSE))
    put(tmp_path, "broken", "pose/0009.txt")
    odometry = matrices(tmp_path, {}, frames="1:3")
    assert odometry.frame_index.tolist() == [1, 2]


def test_matrices_below_the_root(tmp_path):
    for number in (1, 2):
        path = tmp_path / "poses" / "walk" / f"{number}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, POSE)
    section = {"format": "matrix", "path": "poses/{sequence}/{frame}.txt"}
    assert read(tmp_path, section).frame_index.tolist() == [1, 2]
    manifest = split(tmp_path, section)
    files = trajectory_files(manifest.odometry, manifest, manifest.sequences[0])
    assert [path.name for path in files] == ["1.txt", "2.txt"]


@pytest.mark.parametrize("shape", [(2, 4), (5, 4), (8, 4), (0, 4)])
def test_matrices_of_other_shapes(tmp_path, shape):
    pose = np.ones(shape)
    fault(lambda: matrices(tmp_path, {0: pose}), "0000.txt: expected a 4×4", f"found {shape[0]} ")


def test_matrices_with_other_columns(tmp_path):
    fault(lambda: matrices(tmp_path, {7: np.eye(3)}), "0007.txt, line 1: expected 4 numbers")


def test_no_matrix_at_all(tmp_path):
    fault(lambda: matrices(tmp_path, {}), "no pose file fits 'pose/{frame}.txt'")
    matrices(tmp_path, {1: POSE})
    fault(lambda: matrices(tmp_path, {}, frames="5:"), "no pose file fits")


NOT_RIGID = {
    "column by column": POSE.T,
    "moved only, column by column": np.array(
        [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]
    ),
    "scaled": np.diag([2.0, 2.0, 2.0, 1.0]),
    "mirrored": np.diag([1.0, 1.0, -1.0, 1.0]),
}


@pytest.mark.parametrize("convention", ["world_from_cam", "cam_from_world"])
@pytest.mark.parametrize("pose", NOT_RIGID.values(), ids=NOT_RIGID)
def test_matrices_that_are_no_transforms(tmp_path, pose, convention):
    poses = {0: pose, 1: pose, 2: np.full((4, 4), np.nan)}
    fault(
        lambda: matrices(tmp_path, poses, convention=convention),
        "2 of 3 poses are not rigid transforms",
        "row by row",
    )


def test_a_single_bad_matrix_does_not_spoil_the_file(tmp_path):
    odometry = matrices(tmp_path, {0: POSE, 1: OTHER, 2: NOT_RIGID["scaled"]})
    assert np.allclose(odometry.world_from_color[:2], [POSE, OTHER], atol=1e-9)


@pytest.mark.parametrize("convention", ["world_from_cam", "cam_from_world"])
@pytest.mark.parametrize("camera", ["color", "depth"])
@pytest.mark.parametrize("value", [-np.inf, np.inf, np.nan])
def test_poses_that_are_not_finite_stay_so_and_hurt_no_other(tmp_path, convention, camera, value):
    partly = POSE.copy()
    partly[0, 3] = value
    odometry = matrices(
        tmp_path,
        {0: np.full((4, 4), value), 1: OTHER, 2: partly},
        convention=convention,
        camera=camera,
        color_from_depth=COLOR_FROM_DEPTH.tolist(),
    )
    finite = np.isfinite(odometry.world_from_color).all(axis=(1, 2))
    assert finite.tolist() == [False, True, False]
    expected = OTHER if convention == "world_from_cam" else invert(OTHER)
    if camera == "depth":
        expected = expected @ np.linalg.inv(COLOR_FROM_DEPTH)
    assert np.allclose(odometry.world_from_color[1], expected, atol=1e-9)


# --- CSV


def test_csv_by_seconds_nanoseconds_and_number(tmp_path):
    by_s = table(tmp_path, f"timestamp_s,{CSV_HEADER}", f"1305031102.175304,{CSV_LINE}")
    by_ns = table(tmp_path, f"{CSV_HEADER},timestamp_ns", f"{CSV_LINE},1305031102175304001")
    by_number = table(tmp_path, f"frame_index,{CSV_HEADER}", f"12,{CSV_LINE}", f"3.0,{CSV_LINE}")
    assert by_s.timestamp_ns.tolist() == [1305031102175304000]
    assert by_ns.timestamp_ns.tolist() == [1305031102175304001]
    assert by_number.frame_index.tolist() == [12, 3]
    assert by_number.timestamp_ns is None
    for odometry in (by_s, by_ns, by_number):
        assert np.allclose(odometry.world_from_color, POSE, atol=1e-12)


def test_csv_with_other_names_and_other_columns(tmp_path):
    odometry = table(
        tmp_path,
        "time, px ,py,pz,rw,qx,qy,qz,confidence",
        f"2.5,{CSV_LINE},high",
        columns={"timestamp_s": "time", "tx": "px", "ty": "py", "tz": "pz", "qw": "rw"},
    )
    assert odometry.timestamp_ns.tolist() == [2_500_000_000]
    assert np.allclose(odometry.world_from_color, POSE, atol=1e-12)


def test_csv_with_spaces_after_the_commas(tmp_path):
    header = f"timestamp_ns, {CSV_HEADER}".replace(",", ", ")
    odometry = table(tmp_path, header, *(f" {t}, {CSV_LINE}" for t in (100, "2e9", "300.0")))
    assert odometry.timestamp_ns.tolist() == [100, 2 * S, 300]


def test_csv_cells_left_empty_lose_the_pose(tmp_path):
    odometry = table(
        tmp_path,
        f"timestamp_s,{CSV_HEADER}",
        f"1,{CSV_LINE}",
        "2,,,,,,,",
        f",{CSV_LINE}",
        f"4, {CSV_LINE}",
    )
    finite = np.isfinite(odometry.world_from_color).all(axis=(1, 2))
    assert finite.tolist() == [True, False, False, True]
    assert odometry.timestamp_ns.tolist() == [S, 2 * S, NO_STAMP, 4 * S]


def test_csv_missing_columns_offer_the_nearest(tmp_path):
    header = f"timestamp_s,{CSV_HEADER}".replace("tx", "t_x")
    fault(
        lambda: table(tmp_path, header, f"1,{CSV_LINE}"),
        "t.csv: no column 'tx'. Did you mean 't_x'?",
        "odometry.columns = { tx =",
    )
    fault(lambda: table(tmp_path, CSV_HEADER, CSV_LINE), "no column frame_index, timestamp_ns or")


def test_csv_faults_name_the_line_that_an_editor_shows(tmp_path):
    header = f"timestamp_s,{CSV_HEADER}"
    for line, mention in (
        (f"2,{CSV_LINE.replace('2.0', 'two')}", "line 4: 'two' is no number"),
        (f"soon,{CSV_LINE}", "line 4: 'soon' is no number"),
        (f"2,{CSV_LINE},9", "line 4: expected the header's 8 columns"),
        ("2,0.5,1.0", "line 4: expected the header's 8 columns"),
        (f"1403636579763555584,{CSV_LINE}", "line 4: '1403636579763555584' is no moment"),
    ):
        fault(
            lambda line=line: table(tmp_path, header, f"1,{CSV_LINE}", "", line), "t.csv", mention
        )


@pytest.mark.parametrize("number", ["1.5", "", "nan", "inf"])
def test_csv_frame_numbers_are_whole(tmp_path, number):
    header = f"frame_index,{CSV_HEADER}"
    fault(lambda: table(tmp_path, header, f"{number},{CSV_LINE}"), "line 2", "no frame number")


# --- moments


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0", 0),
        ("1305031102.175304", 1305031102175304000),
        ("1305031102.123456789", 1305031102123456789),
        ("-1.5", -1_500_000_000),
        ("1.5e3", 1500 * S),
        (" 7 ", 7 * S),
        ("0.0000000004", 0),
    ],
)
def test_moments_are_exact(text, expected):
    assert nanoseconds(text) == expected
    assert nanoseconds("1305031102123456789", unit_ns=1) == 1305031102123456789


@pytest.mark.parametrize("text", ["", "x", "1:2", "nan", "inf", "1e11", "1e999999"])
def test_what_is_no_moment(text):
    with pytest.raises(ValueError, match=r"no (number|moment)"):
        nanoseconds(text)
