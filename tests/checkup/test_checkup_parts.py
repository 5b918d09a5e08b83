"""The pure parts of the checks, on made-up numbers."""

from pathlib import Path

import numpy as np
import pytest

from imodbatch.checkup import claims, edges, units
from imodbatch.checkup.depth_values import unknown_as_number
from imodbatch.checkup.files import _has_end_mark
from imodbatch.checkup.finding import Finding, Outcome, setting
from imodbatch.checkup.motions import MOST_POINTS, Motions, relative
from imodbatch.checkup.reading import order_of
from imodbatch.checkup.subject import Subject
from imodbatch.checkup.trajectory import contradicts, find_jumps
from imodbatch.checkup.upright import nearest_axis
from imodbatch.checkup.views import View
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import exp_twist, invert, make_transform
from imodbatch.datasets.base import CameraModel
from imodbatch.settings.manifest import Manifest

CAMERA = PinholeCamera(320, 240, 300.0, 300.0, 160.0, 120.0)


def a_walk(n_frames: int, seed: int = 0) -> np.ndarray:
    """Poses (F, 4, 4) of an unsteady walk."""
    rng = np.random.default_rng(seed)
    speed = np.cumsum(rng.normal(0, [0.006] * 3 + [0.01] * 3, (n_frames, 6)), axis=0)
    poses = [make_transform(np.eye(3), [1.0, 2.0, 0.5])]
    for twist in speed[1:]:
        poses.append(poses[-1] @ exp_twist(np.clip(twist, -0.05, 0.05)))
    return np.array(poses)


def motions_of(world_from_cam: np.ndarray, noise_px: float = 0.5) -> Motions:
    """What perfect matches of 60 points would tell of pairs three frames apart."""
    rng = np.random.default_rng(1)
    first = np.arange(0, len(world_from_cam) - 3, 2)
    b_from_a = relative(world_from_cam, first, first + 3)
    points = np.full((len(first), MOST_POINTS, 3), np.nan)
    pixels = rng.uniform([0, 0], [320, 240], (len(first), 60, 2))
    points[:, :60] = CAMERA.unproject(pixels, rng.uniform(0.8, 3.0, (len(first), 60)))
    moved = np.einsum("pij,pmj->pmi", b_from_a[:, :3, :3], points) + b_from_a[:, None, :3, 3]
    seen = CAMERA.project(moved) + rng.normal(0, noise_px, (*points.shape[:2], 2))
    return Motions(CAMERA, first, first + 3, b_from_a, points, seen, np.full(len(first), 1.9))


@pytest.fixture(scope="module")
def walked() -> tuple[np.ndarray, Motions]:
    poses = a_walk(60)
    return poses, motions_of(poses)


def test_right_poses_stay_as_given(walked: tuple[np.ndarray, Motions]) -> None:
    poses, motions = walked
    noisy = poses @ exp_twist(np.random.default_rng(2).normal(0, 0.004, (len(poses), 6)))
    for given in (poses, noisy):
        verdict = claims.judge(motions, given, "world_from_cam", "xyzw")
        assert verdict is not None
        assert verdict.best is verdict.given
        assert verdict.rivals == ()
        assert verdict.scale == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("read_as", ["world_from_cam", "cam_from_world"])
def test_inverse_poses_are_told(walked: tuple[np.ndarray, Motions], read_as: str) -> None:
    poses, motions = walked
    verdict = claims.judge(motions, invert(poses), read_as)  # type: ignore[arg-type]
    assert verdict is not None
    assert verdict.best.claim == claims.Claim(is_inverse=True)
    assert verdict.best.error_px < 1 < verdict.given.error_px


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
@pytest.mark.parametrize("read_as", ["world_from_cam", "cam_from_world"])
def test_a_wrong_quaternion_order_is_told(
    walked: tuple[np.ndarray, Motions], order: str, read_as: str
) -> None:
    poses, motions = walked
    in_file = invert(poses) if read_as == "cam_from_world" else poses
    other = {"xyzw": "wxyz", "wxyz": "xyzw"}[order]
    # what a reader with the wrong order makes of it is what rereading with the other order undoes
    misread = claims._reread(in_file, "world_from_cam", other, False, True)  # type: ignore[arg-type]
    given = invert(misread) if read_as == "cam_from_world" else misread
    verdict = claims.judge(motions, given, read_as, order)  # type: ignore[arg-type]
    assert verdict is not None
    assert verdict.best.claim == claims.Claim(has_other_order=True)


@pytest.mark.parametrize("lag", [-5, 5])
def test_late_and_early_poses_are_told(walked: tuple[np.ndarray, Motions], lag: int) -> None:
    poses, motions = walked
    shifted = np.full_like(poses, np.nan)
    rows = np.arange(len(poses))
    inside = (rows - lag >= 0) & (rows - lag < len(poses))
    shifted[inside] = poses[rows[inside] - lag]
    verdict = claims.judge(motions, shifted)
    assert verdict is not None
    assert verdict.best.claim == claims.Claim(lag=lag)


def test_two_faults_at_once_are_told(walked: tuple[np.ndarray, Motions]) -> None:
    poses, motions = walked
    given = invert(poses)
    given[:, :3, 3] *= 1000
    verdict = claims.judge(motions, given)
    assert verdict is not None
    assert verdict.best.claim.is_inverse
    assert verdict.best.claim.scale == pytest.approx(0.001, rel=0.05)


def test_a_camera_at_rest_tells_nothing() -> None:
    poses = np.tile(np.eye(4), (30, 1, 1))
    verdict = claims.judge(motions_of(poses), poses, "world_from_cam", "xyzw")
    assert verdict is not None
    assert verdict.best is verdict.given
    assert len(verdict.rivals) >= 1
    assert np.isnan(verdict.scale)


def test_too_few_pairs_give_no_verdict() -> None:
    poses = a_walk(9)
    assert claims.judge(motions_of(poses), poses) is None


@pytest.mark.parametrize(
    ("scale", "given", "median_m", "cured"),
    [
        (5.35, units.Units(0.005, 1.0), 9.0, units.Units(0.001, 1.0)),
        (0.2, units.Units(0.0002, 1.0), 0.36, units.Units(0.001, 1.0)),
        (0.00107, units.Units(1e-6, 1.0), 0.0018, units.Units(0.001, 1.0)),
        (0.00098, units.Units(0.001, 1.0), 1.8, units.Units(0.001, 0.001)),
        (1010.0, units.Units(0.001, 0.001), 1.8, units.Units(0.001, 1.0)),
        (10.0, units.Units(0.001, 1.0), 7.0, units.Units(0.0001, 1.0)),
    ],
)
def test_the_likelier_unit_is_blamed(
    scale: float, given: units.Units, median_m: float, cured: units.Units
) -> None:
    assert units.explain_scale(scale, given, median_m) == cured


@pytest.mark.parametrize(
    ("scale_m", "median_m", "likely"),
    [(0.001, 1.8, 0.001), (1.0, 1800.0, 0.001), (1e-6, 2e-3, 0.001)],
)
def test_a_room_is_at_a_rooms_distance(scale_m: float, median_m: float, likely: float) -> None:
    assert units.likely_depth_scale(scale_m, median_m) == likely


def a_view(seed: int, depth_size: float) -> View:
    """Squares before a wall; depth drawn larger or smaller about the centre than colour."""
    rng = np.random.default_rng(seed)
    gray = np.full((240, 320), 60, dtype=np.uint8)
    depth = np.full((240, 320), 3.0, dtype=np.float32)
    u, v = CAMERA.pixel_centers()[..., 0], CAMERA.pixel_centers()[..., 1]
    for _ in range(5):
        left, top = rng.uniform(20, 230), rng.uniform(20, 160)
        size, tone, near = rng.uniform(30, 70), rng.integers(120, 250), rng.uniform(0.8, 1.8)

        def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            return (x > left) & (x < left + size) & (y > top) & (y < top + size)  # noqa: B023

        gray[inside(u, v)] = tone
        depth[inside((u - 160) / depth_size + 160, (v - 120) / depth_size + 120)] = near
    return View(seed, gray, depth, CameraModel(CAMERA, CAMERA, 0.001, (0,)))


@pytest.mark.parametrize("depth_size", [1.0, 0.9, 1.11])
def test_edges_tell_the_ratio_of_focal_lengths(depth_size: float) -> None:
    fit = edges.fit_edges([a_view(seed, depth_size) for seed in range(8)])
    assert fit is not None
    assert fit.size == pytest.approx(1 / depth_size, rel=0.015)
    assert (fit.gain > 1.1) == (depth_size != 1.0)


def test_without_depth_edges_there_is_no_fit() -> None:
    flat = np.full((240, 320), 2.0, dtype=np.float32)
    view = View(0, np.zeros((240, 320), np.uint8), flat, CameraModel(CAMERA, CAMERA, 0.001, (0,)))
    assert edges.fit_edges([view] * 8) is None


def test_a_gap_beside_a_near_thing_belongs_to_what_is_behind() -> None:
    depth = np.full((20, 40), 3.0, dtype=np.float32)
    depth[:, 10:20] = 1.0
    depth[:, 20:26] = np.nan
    jumps = edges.depth_jumps(depth)
    assert sorted(set(jumps[:, 0])) == [10.0, 20.0]
    assert (jumps[:, 2] == 1.0).all()


def test_a_jump_is_out_of_proportion_a_start_is_not() -> None:
    poses = np.tile(np.eye(4), (60, 1, 1))
    poses[20:, 0, 3] = 0.02 * np.arange(40)  # sets off after a wait
    assert find_jumps(poses) == []
    poses[40:, 1, 3] = 0.5
    assert find_jumps(poses) == [39]
    poses[10] = np.nan
    assert find_jumps(poses) == [39]


def test_images_contradict_a_jump_and_confirm_a_turn() -> None:
    step = exp_twist([0.3, 0, 0, 0, 0.2, 0])
    assert contradicts(step, np.eye(4))
    assert contradicts(exp_twist([0.0, 0, 0, 0, 0.4, 0]), np.eye(4))
    assert not contradicts(step, step @ exp_twist([0.02, 0, 0.02, 0, 0.02, 0]))


def test_a_number_for_unknown_stands_apart() -> None:
    rng = np.random.default_rng(0)
    depth = rng.integers(500, 5000, 10_000).astype(float)
    assert unknown_as_number(depth) is None
    depth[:100] = 65535
    assert unknown_as_number(depth) == 65535
    depth[:100] = 5001
    assert unknown_as_number(depth) is None


def test_lines_for_the_manifest() -> None:
    assert setting("camera", "depth.scale_m", 0.0002) == "[camera] depth.scale_m = 0.0002"
    assert setting("world", "up", "-y") == '[world] up = "-y"'
    assert setting("camera", "depth.invalid", [0, 65535]) == "[camera] depth.invalid = [0, 65535]"
    assert setting("annotations", "rename", {"Mug": "cup"}) == (
        '[annotations] rename = { "Mug" = "cup" }'
    )


def test_directions_near_an_axis_are_named() -> None:
    assert nearest_axis(np.array([0.02, -0.999, 0.03])) == "-y"
    assert nearest_axis(np.array([0.0, -0.8, -0.6])) == [0.0, -0.8, -0.6]


def test_figures_that_are_none_are_null() -> None:
    finding = Finding("warning", "seen", figures={"a_m": float("nan"), "b_m": 1.0})
    document = Outcome("check", "", (finding,)).as_json()
    assert document["findings"][0]["figures"] == {"a_m": None, "b_m": 1.0}
    assert document["state"] == "found"


def test_a_file_cut_off_has_no_end_mark(tmp_path: Path) -> None:
    from PIL import Image

    for ending in ("png", "jpg"):
        path = tmp_path / f"a.{ending}"
        Image.new("L", (40, 30), 90).save(path)
        assert _has_end_mark(path)
        path.write_bytes(path.read_bytes()[:-20])
        assert not _has_end_mark(path)


def test_the_layout_says_how_its_poses_are_read(tmp_path: Path) -> None:
    folder = tmp_path / "desk" / "desk_1"
    folder.mkdir(parents=True)
    (folder / "desk_1_1.png").touch()
    split = Manifest(
        name="uw",
        adapter="rgbd_scenes_v1",
        root=str(tmp_path),
        classes=["cap"],
        sequences=[{"id": "desk_1", "path": "desk/desk_1"}],
    )
    subject = Subject.of(split, split.sequences[0])
    assert subject.odometry_section is None
    (folder / "desk_1.pose").touch()
    section = subject.odometry_section
    assert section is not None
    assert (section.format, order_of(section)) == ("uw", "wxyz")
