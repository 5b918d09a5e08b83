"""Features: where they are, how they are spread, and what depth they get."""

import cv2
import numpy as np
import pytest
from rooms import CAMERA, Room, freeze, look, render

from imodbatch.core.camera import PinholeCamera
from imodbatch.poses.rgbd.features import CELL_PX, SCALE_FACTOR, FeatureExtractor, smooth_depth

SIZE = (CAMERA.height_px, CAMERA.width_px)
TWO_METRES = freeze(np.full(SIZE, 2.0, dtype=np.float32))


def extract(gray, depth_m=TWO_METRES, n_features=500, camera=CAMERA):
    return FeatureExtractor(camera, n_features).extract(freeze(gray), freeze(depth_m))


def noise(seed, width=320, height=240):
    rng = np.random.default_rng(seed)
    total = sum(
        cv2.resize(rng.normal(size=(height // n, width // n)), (width, height), interpolation=2)
        for n in (4, 8, 16)
    )
    return np.clip(128 + 45 * total, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gray", [0, 120, 255])
def test_an_image_without_contrast_has_none(gray):
    found = extract(np.full(SIZE, gray, dtype=np.uint8))
    assert len(found) == 0
    assert found.descriptors.shape == (0, 4)
    assert found.points_cam.shape == (0, 3)
    assert found.has_depth.shape == (0,)


def test_shapes_and_types():
    found = extract(noise(0))
    n = len(found)
    assert 300 < n <= 500
    assert found.pixels.shape == (n, 2)
    assert found.descriptors.shape == (n, 4)
    assert found.descriptors.dtype == np.uint64
    assert found.has_depth.all()
    assert np.allclose(CAMERA.project(found.points_cam), found.pixels)


def test_one_busy_corner_does_not_get_all():
    """Strong contrast in one quarter, weak elsewhere: the weak parts get features, too."""
    gray = noise(1).astype(float)
    gray[120:] = 128 + 0.3 * (gray[120:] - 128)
    gray[:, 160:] = 128 + 0.3 * (gray[:, 160:] - 128)
    found = extract(gray.astype(np.uint8))
    in_corner = (found.pixels < (160, 120)).all(axis=1)
    cells = np.unique(found.pixels[~in_corner] // CELL_PX, axis=0)
    assert len(cells) >= 15
    assert (~in_corner).sum() > 100


def test_no_cell_gets_more_than_four_equal_shares():
    gray = np.full(SIZE, 128, dtype=np.uint8)
    gray[70:170, 110:210] = noise(2)[70:170, 110:210]
    found = extract(gray)
    n_cells = 10 * 8
    _, count = np.unique((found.pixels - 0.5) // CELL_PX, axis=0, return_counts=True)
    assert count.max() <= np.ceil(4 * 500 / n_cells) + 2  # two on the border of a cell


def test_a_corner_lies_where_its_edges_meet():
    """White from (100, 90) on to the right and down: that is between pixels 99 and 100."""
    gray = np.full(SIZE, 40, dtype=np.uint8)
    gray[90:, 100:] = 220
    found = extract(gray)
    inside = found.pixels - (100, 90)
    assert len(inside) > 0
    assert (inside > 0).all()
    assert (np.linalg.norm(inside, axis=1) < 2.5 * SCALE_FACTOR**found.octave).all()


def test_a_turned_image_has_its_features_at_the_turned_places():
    """Whatever the octave: a fixed offset of a pixel convention would not turn with the image."""
    off = {octave: [] for octave in range(8)}
    camera = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
    depth = np.full((480, 640), 2.0, dtype=np.float32)
    for seed in range(3):
        gray = noise(seed, 640, 480)
        a = extract(gray, depth, 1500, camera)
        b = extract(np.ascontiguousarray(gray[::-1, ::-1]), depth, 1500, camera)
        turned = np.array([640, 480]) - b.pixels
        for octave, found in off.items():
            mine, theirs = a.pixels[a.octave == octave], turned[b.octave == octave]
            between = mine[:, None] - theirs[None]
            distance = np.linalg.norm(between, axis=2)
            nearest = distance.argmin(axis=1)
            near = distance.min(axis=1) < 0.8 * SCALE_FACTOR**octave
            found.append(between[np.arange(len(mine)), nearest][near] / 2)
    for octave, found in off.items():
        values = np.concatenate(found)
        assert len(values) > 50
        assert np.abs(values.mean(axis=0)).max() < 0.05 * SCALE_FACTOR**octave


def test_depth_is_the_median_of_the_neighbourhood():
    depth = np.full(SIZE, 2.0, dtype=np.float32)
    depth[50, 60] = 2.02
    assert smooth_depth(depth, np.array([[60.5, 50.5], [60.0, 50.9]])) == pytest.approx([2, 2])


def test_depth_is_unknown_across_an_edge_or_a_hole():
    depth = np.full(SIZE, 2.0, dtype=np.float32)
    depth[:, 100:] = 3.0
    depth[20, 20] = np.nan
    pixels = np.array([[99.5, 50], [100.2, 50], [97.5, 50], [102.5, 50], [21.9, 21.9], [23.5, 20]])
    known = np.isfinite(smooth_depth(depth, pixels))
    assert known.tolist() == [False, False, True, True, False, True]


def test_depth_at_the_border_of_the_image():
    depth = np.full(SIZE, 2.0, dtype=np.float32)
    corners = np.array([[0.0, 0.0], [319.9, 239.9], [320.0, 240.0]])
    assert smooth_depth(depth, corners) == pytest.approx([2, 2, 2])


def test_depth_of_a_room():
    gray, depth = render(Room(), look([-0.9, -0.4, 1.3], 5.0))
    found = extract(gray, depth)
    column, row = found.pixels.astype(int).T
    known = found.has_depth
    assert 0.6 < known.mean() < 1
    assert np.abs(found.points_cam[known, 2] - depth[row, column][known]).max() < 0.03 * 3.5


def test_no_depth_no_places():
    found = extract(noise(3), np.full(SIZE, np.nan, dtype=np.float32))
    assert len(found) > 100
    assert not found.has_depth.any()


def test_the_same_twice():
    a, b = extract(noise(4)), extract(noise(4))
    assert np.array_equal(a.pixels, b.pixels)
    assert np.array_equal(a.descriptors, b.descriptors)
