"""Depth in the colour camera against plain loops and planes; the depth of a box, case by case."""

import math

import numpy as np
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import box_depth, register
from imodbatch.core.frames import make_transform, matrix_from_quaternion

NAN = float("nan")
DEPTH_CAMERA = PinholeCamera(64, 48, 52.5, 52.5, 32.0, 24.0)
# colour cameras without a baseline; where "aligned", footprints meet on pixel centres
COLOR_CAMERAS = {
    "other principal point": PinholeCamera(64, 48, 52.5, 52.5, 30.3, 25.9),
    "half a pixel off, aligned": PinholeCamera(64, 48, 52.5, 52.5, 31.5, 23.5),
    "2.5 times as fine": PinholeCamera(160, 120, 131.25, 131.25, 80.0, 60.0),
    "5/3 as fine, aligned": PinholeCamera(100, 80, 87.5, 87.5, 49.5, 40.5),
    "half as fine, aligned": PinholeCamera(32, 24, 26.25, 26.25, 16.0, 12.0),
    "a third as fine, aligned": PinholeCamera(22, 16, 17.5, 17.5, 10.5, 8.5),
    "wider": PinholeCamera(80, 60, 47.1, 46.2, 41.3, 28.7),
    "narrower, not square": PinholeCamera(50, 70, 90.0, 61.0, 20.2, 37.7),
}


def frozen(values, dtype=np.float32):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def shifted(x_m=0.0, y_m=0.0, z_m=0.0):
    return make_transform(np.eye(3), [x_m, y_m, z_m])


def source_pixels(depth_camera, color_camera):
    """Depth column and row (continuous) on the ray of each colour pixel's centre, no baseline."""
    u = (np.arange(color_camera.width_px) + 0.5 - color_camera.cx_px) / color_camera.fx_px
    v = (np.arange(color_camera.height_px) + 0.5 - color_camera.cy_px) / color_camera.fy_px
    columns = u * depth_camera.fx_px + depth_camera.cx_px
    rows = v * depth_camera.fy_px + depth_camera.cy_px
    return columns, rows


def assert_nearest_neighbour(registered, depth_m, depth_camera, color_camera):
    """Without a baseline each colour pixel has the depth of the pixel on its ray, and no other."""
    columns, rows = source_pixels(depth_camera, color_camera)
    assert registered.shape == (color_camera.height_px, color_camera.width_px)
    n_checked = 0
    for y, x in np.ndindex(registered.shape):
        column, row = columns[x], rows[y]
        if min(abs(column - round(column)), abs(row - round(row))) < 1e-5:
            continue  # two depth pixels meet on this ray: either may be seen
        n_checked += 1
        i, j = math.floor(row), math.floor(column)
        inside = 0 <= i < depth_m.shape[0] and 0 <= j < depth_m.shape[1]
        expected = depth_m[i, j] if inside else NAN
        np.testing.assert_equal(registered[y, x], expected, err_msg=f"pixel {x}, {y}")
    return n_checked


def test_identity():
    depth = frozen(np.random.default_rng(0).uniform(0.4, 4, (48, 64)))
    np.testing.assert_array_equal(register(depth, DEPTH_CAMERA, DEPTH_CAMERA), depth)
    same_place = register(depth, DEPTH_CAMERA, DEPTH_CAMERA, np.eye(4))
    np.testing.assert_array_equal(same_place, depth)
    assert same_place.dtype == np.float32


@pytest.mark.parametrize("name", COLOR_CAMERAS)
def test_a_plane_has_no_holes_inside_the_overlap(name):
    color = COLOR_CAMERAS[name]
    plane = frozen(np.full((48, 64), 1.37))
    registered = register(plane, DEPTH_CAMERA, color)
    assert registered.dtype == np.float32
    columns, rows = source_pixels(DEPTH_CAMERA, color)
    inside = ((rows > 1e-5) & (rows < 48 - 1e-5))[:, None]
    inside = inside & ((columns > 1e-5) & (columns < 64 - 1e-5))
    outside = ((rows < -1e-5) | (rows > 48 + 1e-5))[:, None] | (
        (columns < -1e-5) | (columns > 64 + 1e-5)
    )
    assert inside.sum() > 300
    np.testing.assert_array_equal(registered[inside], np.float32(1.37))
    assert np.isnan(registered[outside]).all()


@pytest.mark.parametrize("name", [n for n in COLOR_CAMERAS if "aligned" not in n])
def test_without_a_baseline_each_ray_keeps_its_depth(name):
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.4, 4, (48, 64))
    depth[rng.random(depth.shape) < 0.2] = NAN
    depth = frozen(depth)
    registered = register(depth, DEPTH_CAMERA, COLOR_CAMERAS[name])
    assert assert_nearest_neighbour(registered, depth, DEPTH_CAMERA, COLOR_CAMERAS[name]) > 500


def random_camera(rng, size_px, focal_px):
    """A camera whose image may look past that of another, with borders on a grid of 1/8 pixel."""
    width, height = (int(n) for n in rng.integers(*size_px, 2))
    fx, fy = rng.uniform(*focal_px, 2)
    cx, cy = np.round(rng.uniform(-0.2, 1.2, 2) * [width, height] * 8) / 8
    return PinholeCamera(width, height, fx, fy, cx, cy)


def assert_looking_up_is_splatting(depth_m, depth_camera, color_camera):
    """With a baseline of zero, register takes the way of cameras that stand apart."""
    looked_up = register(depth_m, depth_camera, color_camera)
    splatted = register(depth_m, depth_camera, color_camera, np.eye(4))
    np.testing.assert_array_equal(looked_up, splatted, strict=True)
    return np.isfinite(looked_up).sum()


def holed(rng, camera):
    depth = rng.uniform(0.4, 8, (camera.height_px, camera.width_px))
    depth[rng.random(depth.shape) < 0.2] = NAN
    depth[rng.random(depth.shape) < 0.05] = np.inf
    return frozen(depth)


@pytest.mark.parametrize("name", COLOR_CAMERAS)
def test_looking_up_is_bit_by_bit_what_the_z_buffer_gives(name):
    depth = holed(np.random.default_rng(5), DEPTH_CAMERA)
    assert assert_looking_up_is_splatting(depth, DEPTH_CAMERA, COLOR_CAMERAS[name]) > 100


@pytest.mark.parametrize("size_px", [(8, 40), (60, 150)], ids=["coarser", "finer"])
def test_looking_up_is_the_z_buffer_for_any_two_cameras(size_px):
    rng = np.random.default_rng(6)
    seen = []
    for _ in range(60):
        depth_camera = random_camera(rng, (8, 60), (20, 60))
        focal_px = (20, 60) if size_px[0] < 60 else (60, 150)
        color_camera = random_camera(rng, size_px, focal_px)
        depth = holed(rng, depth_camera)
        seen.append(assert_looking_up_is_splatting(depth, depth_camera, color_camera))
    assert sum(n > 0 for n in seen) > 30


@pytest.mark.parametrize("shift_px", [-500.0, 500.0])
def test_a_colour_camera_that_looks_past_the_depth_image_sees_none(shift_px):
    aside = PinholeCamera(64, 48, 52.5, 52.5, 32.0 + shift_px, 24.0)
    depth = holed(np.random.default_rng(7), DEPTH_CAMERA)
    assert assert_looking_up_is_splatting(depth, DEPTH_CAMERA, aside) == 0


def test_depth_of_zero_or_less_is_none():
    depth = np.full((48, 64), 2.0)
    depth[3:9], depth[20:30] = 0.0, -1.0
    registered = register(frozen(depth), DEPTH_CAMERA, COLOR_CAMERAS["wider"])
    assert set(registered[np.isfinite(registered)].tolist()) == {2.0}


def test_a_kinect_s_depth_focal_length_of_585_px_against_525_px():
    """RedKitchen: the wider colour camera sees a border of 32 columns that has no depth."""
    depth_camera = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
    color_camera = PinholeCamera(640, 480, 525.37, 525.37, 320.0, 240.0)
    ramp = frozen(1 + np.arange(640 * 480).reshape(480, 640) / 200_000)
    registered = register(ramp, depth_camera, color_camera)
    columns, rows = source_pixels(depth_camera, color_camera)
    known_x, known_y = (columns >= 0) & (columns < 640), (rows >= 0) & (rows < 480)
    assert known_x.sum() == 574  # 640 · 525.37 / 585 = 574.8, centred
    np.testing.assert_array_equal(np.isfinite(registered), known_y[:, None] & known_x)
    i, j = np.floor(rows[known_y]).astype(int), np.floor(columns[known_x]).astype(int)
    np.testing.assert_array_equal(registered[np.ix_(known_y, known_x)], ramp[np.ix_(i, j)])


def test_a_baseline_shifts_a_plane_by_fx_b_over_z():
    camera = PinholeCamera(40, 30, 100.0, 100.0, 20.0, 15.0)
    rng = np.random.default_rng(2)
    known = rng.random((30, 40)) > 0.3
    plane = frozen(np.where(known, 2.0, NAN))
    right = register(plane, camera, camera, shifted(x_m=0.1))  # 100 · 0.1 / 2 = 5 columns
    np.testing.assert_array_equal(np.isfinite(right[:, 5:]), known[:, :-5])
    assert np.isnan(right[:, :5]).all()
    np.testing.assert_array_equal(right[np.isfinite(right)], 2.0)
    up = register(plane, camera, camera, shifted(y_m=-0.06))  # 3 rows
    np.testing.assert_array_equal(np.isfinite(up[:-3]), known[3:])
    assert np.isnan(up[-3:]).all()


def test_a_camera_further_back_sees_the_depth_from_there():
    camera = PinholeCamera(40, 30, 100.0, 100.0, 20.0, 15.0)
    registered = register(frozen(np.full((30, 40), 2.0)), camera, camera, shifted(z_m=2.0))
    # half the size about the principal point, twice the depth
    expected = np.full((30, 40), NAN)
    expected[8:22, 10:30] = 4.0
    np.testing.assert_allclose(registered[8:22, 10:30], 4.0, rtol=1e-6)
    assert np.isnan(registered[:7]).all()
    assert np.isnan(registered[23:]).all()
    assert np.isnan(registered[:, :9]).all()
    assert np.isnan(registered[:, 31:]).all()


def test_what_lies_behind_the_colour_camera_is_not_seen():
    camera = PinholeCamera(8, 6, 10.0, 10.0, 4.0, 3.0)
    depth = np.full((6, 8), 1.0)
    depth[2, 3] = 3.0
    registered = register(frozen(depth), camera, camera, shifted(z_m=-2.0))
    seen = registered[np.isfinite(registered)]
    assert seen.size > 0
    np.testing.assert_array_equal(seen, 1.0)


@pytest.mark.parametrize("side", [1, -1])
def test_the_near_surface_hides_the_far_one(side):
    """Both land on one pixel; whichever comes later in the image, the near one stays."""
    camera = PinholeCamera(24, 4, 100.0, 100.0, 12.0, 2.0)
    depth = np.full((4, 24), NAN)
    near, far = 12 - 4 * side, 12 - 2 * side  # shifts: 100·0.08/2 = 4, 100·0.08/4 = 2 columns
    depth[1, near], depth[1, far] = 2.0, 4.0
    registered = register(frozen(depth), camera, camera, shifted(x_m=0.08 * side))
    expected = np.full((4, 24), NAN)
    expected[1, 12] = 2.0
    np.testing.assert_array_equal(registered, expected)


def test_unknown_depth_stays_unknown():
    depth = frozen(np.full((48, 64), NAN))
    for color in (DEPTH_CAMERA, COLOR_CAMERAS["2.5 times as fine"]):
        for transform in (None, shifted(x_m=0.05)):
            assert np.isnan(register(depth, DEPTH_CAMERA, color, transform)).all()
    infinite = depth.copy()
    infinite[5, 5] = np.inf
    assert np.isnan(register(frozen(infinite), DEPTH_CAMERA, COLOR_CAMERAS["wider"])).all()


def plain_register(depth_m, depth_camera, color_camera, color_from_depth):
    result = np.full((color_camera.height_px, color_camera.width_px), np.inf)
    for i, j in np.ndindex(depth_m.shape):
        z = float(depth_m[i, j])
        if not math.isfinite(z):
            continue
        x = (j + 0.5 - depth_camera.cx_px) / depth_camera.fx_px * z
        y = (i + 0.5 - depth_camera.cy_px) / depth_camera.fy_px * z
        point = color_from_depth @ [x, y, z, 1.0]
        if point[2] <= 0:
            continue
        u = color_camera.fx_px * point[0] / point[2] + color_camera.cx_px
        v = color_camera.fy_px * point[1] / point[2] + color_camera.cy_px
        half_w = 0.5 * z / depth_camera.fx_px * color_camera.fx_px / point[2]
        half_h = 0.5 * z / depth_camera.fy_px * color_camera.fy_px / point[2]
        for row, column in np.ndindex(result.shape):
            covers_x = u - half_w <= column + 0.5 < u + half_w
            covers_y = v - half_h <= row + 0.5 < v + half_h
            if covers_x and covers_y:
                result[row, column] = min(result[row, column], point[2])
    return np.where(np.isinf(result), NAN, result)


@pytest.mark.parametrize(
    "color_camera",
    [
        PinholeCamera(12, 9, 11.0, 11.5, 6.2, 4.4),
        PinholeCamera(25, 20, 26.0, 27.0, 12.1, 9.7),
        PinholeCamera(7, 5, 6.0, 5.5, 3.3, 2.6),
    ],
)
def test_a_turned_and_shifted_camera_against_a_plain_loop(color_camera):
    depth_camera = PinholeCamera(12, 9, 10.0, 10.5, 5.7, 4.6)
    rng = np.random.default_rng(4)
    depth = rng.uniform(0.5, 3.0, (9, 12))
    depth[rng.random(depth.shape) < 0.15] = NAN
    rotation = matrix_from_quaternion([1, 0.02, -0.05, 0.03])
    color_from_depth = make_transform(rotation, [0.11, -0.03, 0.2])
    color_from_depth.setflags(write=False)
    depth = frozen(depth)
    found = register(depth, depth_camera, color_camera, color_from_depth)
    expected = plain_register(depth, depth_camera, color_camera, color_from_depth)
    assert np.isfinite(expected).sum() > 10
    np.testing.assert_allclose(found, expected, rtol=1e-6)


# --- the depth of a box ---------------------------------------------------------------------------


def wall(depth_m=3.0, height=40, width=60):
    return np.full((height, width), depth_m)


def test_center_takes_the_pixel_under_the_centre():
    numbered = frozen(np.arange(40 * 60).reshape(40, 60))
    assert box_depth(numbered, [10, 4, 21, 11], "center", 0.3) == 7 * 60 + 15  # (15.5, 7.5)
    assert box_depth(numbered, [10, 4, 20, 10], "center", 0.3) == 7 * 60 + 15  # (15, 7): its pixel
    assert box_depth(numbered, [9.9, 4, 20, 10], "center", 0.3) == 7 * 60 + 14
    hole = numbered.copy()
    hole[7, 15] = NAN
    assert math.isnan(box_depth(frozen(hole), [10, 4, 20, 10], "center", 0.3))


def test_window_median_looks_past_a_hole_and_no_further_than_the_window():
    depth = wall()
    depth[10:30, 20:40] = 1.0  # the object
    depth[18:22, 28:32] = NAN  # a hole in its middle
    depth[24:26, 33:35] = 9.0  # noise
    depth = frozen(depth)
    box = [10, 0, 50, 40]
    assert math.isnan(box_depth(depth, box, "center", 0.5))
    assert box_depth(depth, box, "window_median", 0.5) == 1.0
    assert box_depth(depth, box, "window_median", 1.0) == 3.0
    # exactly the window's pixels: 40 · 0.1 = 4 columns, 4 rows, all unknown
    assert math.isnan(box_depth(depth, box, "window_median", 0.1))
    assert box_depth(depth, box, "window_median", 0.11) == 1.0


def test_the_window_covers_every_pixel_it_touches():
    depth = frozen(np.arange(12.0)[None, :] * np.ones((5, 1)))
    # x from 4.5 to 7.5: pixels 4, 5, 6, 7
    assert box_depth(depth, [3, 0, 9, 5], "window_median", 0.5) == 5.5
    # x from 4 to 8, the same four
    assert box_depth(depth, [2, 0, 10, 5], "window_median", 0.5) == 5.5
    # x from 3.8 to 7: pixels 3, 4, 5, 6
    assert box_depth(depth, [2.2, 0, 8.6, 5], "window_median", 0.5) == 4.5


def test_foreground_finds_a_near_object_before_a_far_wall():
    depth = wall()
    depth[10:30, 24:36] = 1.0  # 30 % of the box, so the median is the wall
    depth = frozen(depth)
    box = [10, 10, 50, 30]
    assert box_depth(depth, box, "window_median", 1.0) == 3.0
    assert box_depth(depth, box, "foreground", 1.0) == pytest.approx(1.0, abs=1e-6)


def test_foreground_finds_the_rim_of_a_mug_before_its_inner_wall():
    y, x = np.mgrid[:40, :60] + 0.5
    radius = np.hypot(y - 20, x - 30)
    depth = wall()
    depth[radius < 16] = 1.0
    depth[radius < 11] = 1.08  # the far inner wall: the centre, and most of the inner window
    depth = frozen(depth)
    box = [14, 4, 46, 36]
    assert box_depth(depth, box, "center", 0.8) == pytest.approx(1.08)
    assert box_depth(depth, box, "window_median", 0.8) == pytest.approx(1.08)
    assert box_depth(depth, box, "foreground", 0.8) == pytest.approx(1.0)


@pytest.mark.parametrize(("n_columns", "expected"), [(7, 3.0), (9, 1.0)])
def test_a_near_sliver_under_a_fifth_is_not_the_foreground(n_columns, expected):
    depth = wall()
    depth[:, 10 : 10 + n_columns] = 1.0  # 17.5 % and 22.5 % of 40 columns
    found = box_depth(frozen(depth), [10, 0, 50, 40], "foreground", 1.0)
    assert found == pytest.approx(expected)


def test_a_surface_on_a_bin_s_border_is_not_halved():
    depth = wall()
    depth[:, 10:14], depth[:, 14:19] = 1.0, 1.021  # 10 % and 12.5 %: bins 0 and 1 of 2 cm
    box = [10, 0, 50, 40]
    assert box_depth(frozen(depth), box, "foreground", 1.0) == pytest.approx(1.021)
    # with bins of 5 mm they are two surfaces, each under a fifth
    assert box_depth(frozen(depth), box, "foreground", 1.0, bin_m=0.005) == pytest.approx(3.0)


def test_without_a_large_surface_the_largest_is_the_foreground():
    depth = np.linspace(1.0, 9.0, 40 * 60).reshape(40, 60)  # 20 pixels to 6 cm
    depth[3] = 5.0
    assert box_depth(frozen(depth), [0, 0, 60, 40], "foreground", 1.0) == pytest.approx(5.0)


MODES = ["center", "window_median", "foreground"]


@pytest.mark.parametrize("mode", MODES)
def test_an_unknown_window_gives_no_depth(mode):
    depth = wall()
    depth[10:30, 20:40] = NAN
    assert math.isnan(box_depth(frozen(depth), [20, 10, 40, 30], mode, 1.0))
    depth[10:30, 20:40] = np.inf
    if mode != "center":
        assert math.isnan(box_depth(frozen(depth), [20, 10, 40, 30], mode, 1.0))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "box",
    [
        [-40, 10, -20, 30],
        [70, 10, 90, 30],
        [10, -40, 30, -20],
        [10, 45, 30, 65],
        [60, 10, 80, 30],
        [-1.5, 10, -0.5, 30],
        [-0.5, 10, -0.5, 30],
    ],
)
def test_a_box_outside_the_image_has_no_depth(mode, box):
    assert math.isnan(box_depth(frozen(wall()), box, mode, 0.5))


@pytest.mark.parametrize("mode", ["window_median", "foreground"])
def test_of_a_box_partly_outside_the_rest_counts(mode):
    depth = wall()
    depth[:, :6], depth[:, 50:] = 1.0, 2.0
    depth = frozen(depth)
    assert box_depth(depth, [-14, 10, 20, 30], mode, 0.3) == pytest.approx(1.0)
    assert box_depth(depth, [-16, 10, 10, 30], mode, 1.0) == pytest.approx(1.0)
    assert box_depth(depth, [52, 30, 90, 60], mode, 1.0) == pytest.approx(2.0)
    # the centre is outside, part of the window is not
    assert math.isnan(box_depth(depth, [-16, 10, 10, 30], "center", 1.0))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("box", [[20, 10, 20, 10], [20.5, 10.5, 20.5, 10.5], [20, 5.5, 20, 15.5]])
def test_a_box_of_no_size_has_the_depth_under_it(mode, box):
    depth = wall()
    depth[:, 20] = 1.5
    assert box_depth(frozen(depth), box, mode, 0.5) == 1.5
