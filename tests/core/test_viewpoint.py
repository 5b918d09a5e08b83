"""Azimuths, elevations, their bins, and the voxels in which sightings meet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.core.viewpoint import ViewGrid, azimuth_bins_apart, view_angles, yaw_from_pose_bin
from imodbatch.core.voxels import group_labels, voxel_indices

ELEVATIONS = tuple(np.radians([10.0, 30.0, 50.0]).tolist())
STEPS = [1, 3, 8, 12, 16]


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def test_the_grid_s_size():
    grid = ViewGrid(16, ELEVATIONS)
    assert grid.n_elevations == 3
    assert np.degrees(grid.azimuth_step_rad) == pytest.approx(22.5)


@pytest.mark.parametrize("n", STEPS)
def test_azimuth_bins_are_centred_on_multiples_of_the_step(n):
    grid, step = ViewGrid(n, ELEVATIONS), 2 * np.pi / n
    centers = step * np.arange(n)
    np.testing.assert_array_equal(grid.azimuth_bins(frozen(centers)), np.arange(n))
    # the last moment of a bin, the first of the next; bin 0 wraps round
    just_below, just_above = centers + 0.5 * step - 1e-9, centers + 0.5 * step + 1e-9
    np.testing.assert_array_equal(grid.azimuth_bins(just_below), np.arange(n))
    np.testing.assert_array_equal(grid.azimuth_bins(just_above), (np.arange(n) + 1) % n)
    turns = 2 * np.pi * frozen([[-2], [-1], [0], [1], [5]])
    np.testing.assert_array_equal(
        grid.azimuth_bins(centers + 0.4 * step + turns), np.tile(np.arange(n), (5, 1))
    )


def test_azimuth_bin_0_lies_on_both_sides_of_0():
    grid = ViewGrid(4, ELEVATIONS)
    degrees = frozen([0, 44.9, 45, 45.1, 314.9, 315, 315.1, 359.999, 360, -44.9, -45.1])
    expected = [0, 0, 1, 1, 3, 0, 0, 0, 0, 0, 3]
    np.testing.assert_array_equal(grid.azimuth_bins(np.radians(degrees)), expected)


def test_elevation_bins_are_the_nearest():
    grid = ViewGrid(8, ELEVATIONS)
    degrees = frozen([-90, 0, 10, 19.99, 20.01, 30, 39.99, 40.01, 50, 90])
    np.testing.assert_array_equal(
        grid.elevation_bins(np.radians(degrees)), [0, 0, 0, 0, 1, 1, 1, 2, 2, 2]
    )
    assert ViewGrid(8, (0.25, 0.75)).elevation_bins(0.5) == 0  # the lower one when tied


def test_elevation_excess():
    grid = ViewGrid(8, ELEVATIONS)
    degrees = frozen([-20, 9, 10, 25, 50, 51, 90])
    excess = np.degrees(grid.elevation_excess_rad(np.radians(degrees)))
    np.testing.assert_allclose(excess, [30, 1, 0, 0, 0, 1, 40], atol=1e-12)


@pytest.mark.parametrize(
    ("offset", "azimuth_deg", "elevation_deg"),
    [
        ([1, 0, 0], 0, 0),
        ([0, 2, 0], 90, 0),
        ([-3, 0, 0], 180, 0),
        ([0, -1, 0], 270, 0),
        ([1, -1, 0], 315, 0),
        ([1, 1, np.sqrt(2)], 45, 45),
        ([0, 0, 5], 0, 90),
        ([0, 0, -5], 0, -90),
        ([-np.sqrt(3), 0, -1], 180, -30),
    ],
)
def test_view_angles_by_hand(offset, azimuth_deg, elevation_deg):
    """The line runs from the object to the camera: a camera in +x sees azimuth 0."""
    xyz = frozen([0.3, -4.0, 0.7])
    azimuth, elevation = view_angles(xyz, frozen(xyz + offset))
    assert np.degrees(azimuth) == pytest.approx(azimuth_deg, abs=1e-9)
    assert np.degrees(elevation) == pytest.approx(elevation_deg, abs=1e-9)


COORDINATES = st.tuples(*[st.floats(-10, 10)] * 3)


@given(COORDINATES, COORDINATES)
@settings(max_examples=150)
def test_view_angles_are_in_range_and_point_at_the_camera(xyz, camera):
    azimuth, elevation = view_angles(frozen(xyz), frozen(camera))
    assert 0 <= azimuth < 2 * np.pi
    assert -np.pi / 2 <= elevation <= np.pi / 2
    view = np.subtract(camera, xyz)
    direction = [
        np.cos(elevation) * np.cos(azimuth),
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
    ]
    np.testing.assert_allclose(np.linalg.norm(view) * np.array(direction), view, atol=1e-9)


@pytest.mark.parametrize("y", [-1e-17, -1e-300, -5e-324, -0.0, 0.0])
def test_azimuth_never_reaches_a_full_turn(y):
    azimuth, _ = view_angles(frozen([0, 0, 0]), frozen([1, y, 0]))
    assert 0 <= azimuth < 2 * np.pi
    assert azimuth == pytest.approx(0, abs=1e-9)


def test_unknown_places_stay_unknown():
    azimuth, elevation = view_angles(frozen([[np.nan] * 3, [0, 0, 0]]), frozen([1, 0, 0]))
    np.testing.assert_array_equal(np.isnan(azimuth), [True, False])
    np.testing.assert_array_equal(np.isnan(elevation), [True, False])


def test_yaw_from_pose_bin():
    """b = a + d: an object turned by +90° shows its azimuth 0 to a camera at world azimuth 90°."""
    assert yaw_from_pose_bin(0, 16) == 0
    np.testing.assert_allclose(
        np.degrees(yaw_from_pose_bin(frozen([1, 4, 12, 15], np.int64), 16)), [337.5, 270, 90, 22.5]
    )
    n, yaw_bin = 8, 3
    for a in range(n):
        b = (a - yaw_bin) % n  # what the camera sees of the turned object
        d = (b - a) % n
        assert yaw_from_pose_bin(d, n) == pytest.approx(yaw_bin * 2 * np.pi / n)


def test_voxels_also_on_the_negative_side():
    xyz = frozen([[0, 0.19, 0.2], [-0.01, -0.2, -0.21], [1.05, -1.05, 0.39]])
    np.testing.assert_array_equal(voxel_indices(xyz, 0.2), [[0, 0, 1], [-1, -1, -2], [5, -6, 1]])
    halves = voxel_indices(frozen([[[0.5, -0.5, 1.0]]]), 0.5)
    assert halves.dtype == np.int64
    np.testing.assert_array_equal(halves, [[[1, -1, 2]]])


@given(st.tuples(*[st.floats(-50, 50)] * 3), st.sampled_from([0.1, 0.2, 0.25, 0.4]))
@settings(max_examples=100)
def test_a_point_lies_in_its_voxel(xyz, size):
    low = voxel_indices(frozen(xyz), size) * size
    assert (low <= np.array(xyz) + 1e-9).all()
    assert (np.array(xyz) < low + size + 1e-9).all()


def test_group_labels_number_the_distinct_voxels():
    voxels = frozen([[2, 0, 0], [-1, 5, 0], [2, 0, 0], [-1, 4, 9], [2, 0, 1]], np.int64)
    labels = group_labels(voxels)
    np.testing.assert_array_equal(labels, [2, 1, 2, 0, 3])
    assert labels.shape == (5,)
    assert group_labels(frozen(np.zeros((0, 3)), np.int64)).shape == (0,)
    # any other column that tells places apart will do, e.g. (V, 1) instances
    np.testing.assert_array_equal(group_labels(frozen([[7], [3], [7]], np.int64)), [1, 0, 1])


def test_bins_apart_go_the_shorter_way_round():
    """16 bins of 22.5 degrees."""
    true = np.deg2rad([0.0, 0.0, 0.0, 350.0, 90.0, 11.0, 11.5])
    predicted = np.array([0, 15, 8, 1, 4, 0, 0])
    assert azimuth_bins_apart(predicted, true, 16).tolist() == [0, 1, 8, 1, 0, 0, 1]


def test_bins_apart_of_a_symmetric_object_count_from_its_nearest_equal_view():
    predicted, true = np.arange(8), np.zeros(8)
    assert azimuth_bins_apart(predicted, true, 8, 2).tolist() == [0, 1, 2, 1, 0, 1, 2, 1]
    assert azimuth_bins_apart(predicted, true, 8, 4).tolist() == [0, 1, 0, 1, 0, 1, 0, 1]
    # thirds of a turn lie at bins 0, 2.67 and 5.33 of 8
    assert azimuth_bins_apart(predicted, true, 8, 3).tolist() == [0, 1, 1, 0, 1, 0, 1, 1]
