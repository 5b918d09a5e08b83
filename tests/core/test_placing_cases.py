"""Where a point lies and from where it is seen: voxel, angles and bins, on paper."""

import math

import numpy as np
import pytest

from imodbatch.core.placing import place
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.core.voxels import group_labels, voxel_indices

GRID = ViewGrid(8, (math.radians(10), math.radians(50)))


def test_voxels_are_equally_wide_on_both_sides_of_the_origin():
    points = [[-0.2, -0.01, 0.0], [0.01, 0.19, 0.21], [-0.39, -0.41, 0.4]]
    assert voxel_indices(points, 0.2).tolist() == [[-1, -1, 0], [0, 0, 1], [-2, -3, 2]]


def test_voxels_are_numbered_in_order():
    voxels = np.array([[1, 0, 0], [-1, 5, 0], [1, 0, 0], [0, 0, 0]])
    assert group_labels(voxels).tolist() == [2, 0, 2, 1]


def test_a_place_by_hand():
    """From 1 m north (+y), level and 1 m up: azimuth 90° is bin 2 of 8; elevations 0° and 45°."""
    xyz = [[1.0, 2.0, 3.0]] * 2
    found = place(xyz, [[1.0, 3.0, 3.0], [1.0, 3.0, 4.0]], GRID, 0.5)
    assert np.degrees(found.azimuth_rad) == pytest.approx([90, 90])
    assert np.degrees(found.elevation_rad) == pytest.approx([0, 45])
    assert found.azimuth_bin.tolist() == [2, 2]
    assert found.elevation_bin.tolist() == [0, 1]
    assert found.voxel.tolist() == [[2, 4, 6]] * 2
    assert np.degrees(found.elevation_excess_rad) == pytest.approx([10, 0])


@pytest.mark.parametrize(("margin_deg", "steep"), [(9.9, True), (10.0, False), (10.1, False)])
def test_too_steep_is_more_degrees_outside_the_grid_than_allowed(margin_deg, steep):
    """A level view lies 10° below the lowest elevation."""
    found = place([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], GRID, 0.5)
    assert found.is_too_steep(margin_deg).tolist() == [steep]
