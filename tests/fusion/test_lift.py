"""lift: rows in = rows out, each with the right place or the right reason for having none."""

from collections import Counter

import numpy as np
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import make_transform, matrix_from_quaternion, quaternion_from_matrix
from imodbatch.core.viewpoint import view_angles
from imodbatch.core.voxels import voxel_indices
from imodbatch.datasets.images import UnreadableImageError
from imodbatch.fusion import lift
from imodbatch.settings.config import LiftConfig, ViewpointConfig
from imodbatch.tables.parquet import empty, from_rows
from imodbatch.tables.schemas import DETECTIONS, FRAMES, OBSERVATIONS, POSES

WIDTH, HEIGHT = 80, 60
CAMERA = PinholeCamera(WIDTH, HEIGHT, 70.0, 75.0, 41.0, 29.0)
PIXELS = CAMERA.pixel_centers()
PLACE = ("x_m", "y_m", "z_m")
VOXEL = ("voxel_i", "voxel_j", "voxel_k")
BINS = ("azimuth_bin", "elevation_bin")


def looking(center, target):
    """world_from_cam of a camera at `center` that looks at `target`, its image upright."""
    z = np.subtract(target, center) / np.linalg.norm(np.subtract(target, center))
    x = np.cross(z, [0, 0, 1])
    x /= np.linalg.norm(x)
    return make_transform(np.stack([x, np.cross(z, x), z], axis=1), center)


def frames_table(*numbers, without_depth=()):
    camera = vars(CAMERA)
    return from_rows(
        FRAMES,
        [
            {
                "sequence_id": "s",
                "frame_index": number,
                "color_path": f"{number}.png",
                "depth_path": None if number in without_depth else f"d{number}.png",
                "depth_scale_m": 0.001,
                **camera,
                **{f"depth_{name}": value for name, value in camera.items()},
            }
            for number in numbers
        ],
    )


def poses_table(poses):
    rows = []
    for number, pose in poses.items():
        row = {"sequence_id": "s", "frame_index": number, "status": "lost"}
        if pose is not None:
            values = [*pose[:3, 3], *quaternion_from_matrix(pose[:3, :3])]
            names = ("tx_m", "ty_m", "tz_m", "qw", "qx", "qy", "qz")
            row |= {**dict(zip(names, values, strict=True)), "status": "tracked"}
        rows.append(row)
    return from_rows(POSES, rows)


def detections_table(*boxes):
    """Boxes as (frame, x0, y0, x1, y1)."""
    count = Counter()
    rows = []
    for number, *box in boxes:
        rows.append(
            {
                "sequence_id": "s",
                "frame_index": number,
                "detection_index": count[number],
                **dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), box, strict=True)),
                "background_score": 0.1,
                "class_ids": [0],
                "view_scores": [0.9],
            }
        )
        count[number] += 1
    return from_rows(DETECTIONS, rows)


def flat(depth_m):
    return lambda _row: np.full((HEIGHT, WIDTH), depth_m, dtype=np.float32)


def slope(row):
    """Depth of the plane z = 2 + 0.3 x - 0.2 y, in the camera, at every pixel centre."""
    del row
    ray_x = (PIXELS[..., 0] - CAMERA.cx_px) / CAMERA.fx_px
    ray_y = (PIXELS[..., 1] - CAMERA.cy_px) / CAMERA.fy_px
    return (2 / (1 - 0.3 * ray_x + 0.2 * ray_y)).astype(np.float32)


def run(frames, poses, detections, read_depth, viewpoint=None, **config):
    viewpoint = ViewpointConfig(**(viewpoint or {}))
    return lift.run(frames, poses, detections, read_depth, viewpoint, LiftConfig(**config))


def array(table, names):
    return np.stack([table[name].to_numpy() for name in names], axis=-1)


POSE = make_transform(matrix_from_quaternion([0.3, -0.7, 0.5, 0.2]), [1.5, -2.0, 1.25])


def test_the_world_place_of_a_box_on_a_flat_wall():
    box = (0, 20.0, 10.0, 31.0, 33.0)
    result = run(frames_table(0), poses_table({0: POSE}), detections_table(box), flat(2.5))
    row = result.tables["observations"].to_pylist()[0]
    point_cam = [(25.5 - 41) / 70 * 2.5, (21.5 - 29) / 75 * 2.5, 2.5]
    expected = POSE[:3, :3] @ point_cam + POSE[:3, 3]
    assert [row[name] for name in PLACE] == pytest.approx(expected, abs=1e-6)
    assert (row["status"], row["depth_m"]) == ("placed", 2.5)
    assert result.tables["observations"].schema.equals(OBSERVATIONS.schema)


def test_places_on_a_slope_lie_on_it():
    rng = np.random.default_rng(0)
    corners = rng.uniform(2, 40, (40, 2)).round(1)
    boxes = [(0, x, y, x + 15, y + 12) for x, y in corners]
    table = run(
        frames_table(0), poses_table({0: POSE}), detections_table(*boxes), slope, depth="center"
    ).tables["observations"]
    points_cam = (array(table, PLACE) - POSE[:3, 3]) @ POSE[:3, :3]
    x, y, z = points_cam.T
    assert np.abs(z - (2 + 0.3 * x - 0.2 * y)).max() < 0.02  # a pixel's width of slope
    assert np.allclose(CAMERA.project(points_cam), corners + np.array([7.5, 6]), atol=1e-4)


def all_statuses():
    """One table in which every status occurs, `out_of_range` for both reasons."""
    frames = frames_table(*range(7), without_depth=(2, 6))
    level = looking([0, 0, 1.0], [1.0, 0, 1.0])  # elevation 0
    above = looking([0, 0, 3.0], [2.0, 0, 1.0])  # 45 degrees above the horizon
    poses = poses_table({0: above, 1: above, 2: above, 3: above, 4: None, 5: level, 6: None})
    middle = (30, 20, 50, 40)
    boxes = [(n, *middle) for n in (6, 0, 1, 2, 3, 4, 5, 0)] + [(0, 0, 0, 10, 10), (3, *middle)]

    def read_depth(row):
        number = row["frame_index"]
        if number == 3:
            raise UnreadableImageError("d3.png: damaged image (cut).")
        depth = np.full((HEIGHT, WIDTH), 9.0 if number == 1 else 2.0, dtype=np.float32)
        depth[:15, :15] = np.nan
        return depth

    viewpoint = {"elevations_deg": (30, 50), "elevation_margin_deg": 10}
    return run(frames, poses, detections_table(*boxes), read_depth, viewpoint, max_depth_m=5)


def test_every_status_occurs_and_all_add_up():
    result = all_statuses()
    table = result.tables["observations"]
    assert list(
        zip(table["frame_index"].to_pylist(), table["status"].to_pylist(), strict=True)
    ) == [
        (6, "no_pose"),
        (0, "placed"),
        (1, "out_of_range"),
        (2, "no_depth"),
        (3, "unreadable_depth"),
        (4, "no_pose"),
        (5, "out_of_range"),
        (0, "placed"),
        (0, "no_depth"),
        (3, "unreadable_depth"),
    ]
    assert table["detection_index"].to_pylist() == [0, 0, 0, 0, 0, 0, 0, 1, 2, 1]
    assert result.summary == (
        "10 detections = 2 placed + 2 no_depth + 2 unreadable_depth + 2 no_pose + 2 out_of_range"
    )
    assert result.warnings == ["d3.png: damaged image (cut)."]


def test_what_each_status_knows_and_what_it_leaves_open():
    known = {}
    for row in all_statuses().tables["observations"].to_pylist():
        present = {name for name, value in row.items() if value is not None} - {*OBSERVATIONS.key}
        known.setdefault((row["status"], row["frame_index"]), present)
    place = {"status", "depth_m", *PLACE, "azimuth_rad", "elevation_rad"}
    assert known == {
        ("placed", 0): place | {*VOXEL, *BINS},
        ("out_of_range", 1): place,
        ("out_of_range", 5): place,
        ("no_depth", 0): {"status"},
        ("no_depth", 2): {"status"},
        ("unreadable_depth", 3): {"status"},
        ("no_pose", 4): {"status", "depth_m"},
        ("no_pose", 6): {"status"},
    }


def test_the_elevation_margin_is_measured_from_the_grid():
    camera = looking([0, 0, 3.0], [2.0, 0, 1.0])
    box = (0, 40, 28, 42, 30)  # round the principal point: seen at 45 degrees
    for margin_deg, status in ((15.1, "placed"), (14.9, "out_of_range")):
        viewpoint = {"elevations_deg": (10, 30), "elevation_margin_deg": margin_deg}
        table = run(
            frames_table(0), poses_table({0: camera}), detections_table(box), flat(2), viewpoint
        ).tables["observations"]
        assert table["status"].to_pylist() == [status]
        assert np.degrees(table["elevation_rad"][0].as_py()) == pytest.approx(45, abs=1e-4)


def test_depth_at_the_limit_is_in_range():
    for limit_m, status in ((2.5, "placed"), (2.499, "out_of_range")):
        table = run(
            frames_table(0),
            poses_table({0: POSE}),
            detections_table((0, 30, 20, 50, 40)),
            flat(2.5),
            max_depth_m=limit_m,
        ).tables["observations"]
        assert table["status"].to_pylist() == [status]


@pytest.mark.parametrize("push", [0.5, 1.0])
def test_the_point_is_pushed_along_its_ray_by_half_the_smaller_side(push):
    box = (0, 10.0, 5.0, 24.0, 50.0)
    at = {}
    for fraction in (0.0, push):
        table = run(
            frames_table(0),
            poses_table({0: POSE}),
            detections_table(box),
            flat(2.0),
            push_fraction=fraction,
        ).tables["observations"]
        at[fraction] = array(table, PLACE)[0] - POSE[:3, 3]
        assert table["depth_m"].to_pylist() == [2.0]
    width_m = 14 * 2.0 / 70  # smaller than the height, 45 · 2 / 75
    distances = {fraction: np.linalg.norm(ray) for fraction, ray in at.items()}
    assert distances[push] - distances[0.0] == pytest.approx(push * width_m / 2, abs=1e-9)
    assert np.allclose(at[push] / distances[push], at[0.0] / distances[0.0])


def test_voxels_and_bins_are_those_of_the_core():
    rng = np.random.default_rng(1)
    centers = rng.uniform([-3, -3, 0], [3, 3, 3], (12, 3))
    poses = {n: looking(center, rng.uniform(-0.3, 0.3, 3)) for n, center in enumerate(centers)}
    boxes = [(n, x, y, x + 9, y + 9) for n in poses for x, y in rng.uniform(5, 45, (4, 2)).tolist()]
    viewpoint = {"n_azimuths": 8, "elevations_deg": (0, 20, 60)}
    table = run(
        frames_table(*poses),
        poses_table(poses),
        detections_table(*boxes),
        slope,
        viewpoint,
        voxel_size_m=0.15,
    ).tables["observations"]
    assert set(table["status"].to_pylist()) == {"placed"}
    points = array(table, PLACE)
    cameras = np.array([centers[n] for n in table["frame_index"].to_pylist()])
    azimuth, elevation = view_angles(points, cameras)
    grid = ViewpointConfig(**viewpoint).grid()
    assert np.array_equal(array(table, VOXEL), voxel_indices(points, 0.15))
    assert np.allclose(table["azimuth_rad"].to_numpy(), azimuth, atol=1e-5)
    assert np.allclose(table["elevation_rad"].to_numpy(), elevation, atol=1e-5)
    assert np.array_equal(table["azimuth_bin"].to_numpy(), grid.azimuth_bins(azimuth))
    assert np.array_equal(table["elevation_bin"].to_numpy(), grid.elevation_bins(elevation))
    assert len(set(table["azimuth_bin"].to_pylist())) > 4
    assert set(table["elevation_bin"].to_pylist()) == {0, 1, 2}


def test_depth_modes_see_different_things_in_a_box():
    depth = np.full((HEIGHT, WIDTH), 4.0, dtype=np.float32)
    depth[20:40, 30:42] = 1.0  # a thing in front fills the left 60 % of the window
    depth[30, 40] = np.nan

    def at(mode, **more):
        return run(
            frames_table(0),
            poses_table({0: POSE}),
            detections_table((0, 30, 20, 50, 40)),
            lambda _row: depth,
            depth=mode,
            **more,
        ).tables["observations"]

    assert at("window_median", window=1.0)["depth_m"].to_pylist() == [1.0]
    assert at("foreground", window=0.3)["depth_m"].to_pylist() == [1.0]
    assert at("center")["status"].to_pylist() == ["no_depth"]


def test_each_depth_image_is_read_once_and_only_where_there_are_boxes():
    read = []

    def read_depth(row):
        read.append((row["frame_index"], row["depth_path"]))
        return np.ones((HEIGHT, WIDTH), dtype=np.float32)

    boxes = [(n, 30, 20, 50, 40) for n in (3, 1, 3, 1)]
    run(
        frames_table(0, 1, 2, 3),
        poses_table({1: POSE, 3: POSE}),
        detections_table(*boxes),
        read_depth,
    )
    assert sorted(read) == [(1, "d1.png"), (3, "d3.png")]


def test_no_detections():
    result = run(frames_table(0), poses_table({0: POSE}), empty(DETECTIONS), flat(1))
    assert result.tables["observations"].num_rows == 0
    assert result.summary == "0 detections = 0 placed"


def test_depth_images_are_not_written_into():
    depth = np.ones((HEIGHT, WIDTH), dtype=np.float32)
    depth.setflags(write=False)
    boxes = detections_table((0, 30, 20, 50, 40))
    for mode in ("center", "window_median", "foreground"):
        result = run(frames_table(0), poses_table({0: POSE}), boxes, lambda _r: depth, depth=mode)
        assert result.tables["observations"]["status"].to_pylist() == ["placed"]
