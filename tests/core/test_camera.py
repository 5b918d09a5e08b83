"""The pinhole camera against OpenCV and Open3D, whose pixel centres are integers."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.core.camera import PinholeCamera
from imodbatch.libraries.open3d_library import intrinsics, open3d

CAMERA = PinholeCamera(64, 48, 52.5, 57.25, 31.75, 23.0)


def frozen(values, dtype=np.float64):
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


CAMERAS = st.builds(
    PinholeCamera,
    st.just(640),
    st.just(480),
    st.floats(50, 2000),
    st.floats(50, 2000),
    st.floats(-100, 1000),
    st.floats(-100, 1000),
)


@given(CAMERAS, st.floats(-500, 2000), st.floats(-500, 2000), st.floats(0.05, 50))
@settings(max_examples=150)
def test_project_and_unproject_invert(camera, u, v, depth_m):
    point = camera.unproject(frozen([u, v]), depth_m)
    assert point[2] == depth_m
    np.testing.assert_allclose(camera.project(point), [u, v], rtol=0, atol=1e-8)
    again = camera.unproject(camera.project(point), point[2])
    np.testing.assert_allclose(again, point, rtol=1e-9, atol=1e-9)


def test_by_hand():
    """x right, y down, z forward."""
    camera = PinholeCamera(100, 80, 50.0, 40.0, 50.0, 30.0)
    points = frozen([[0, 0, 1], [1, 0, 1], [0, 1, 2], [-1, -1, 4]])
    pixels = [[50, 30], [100, 30], [50, 50], [37.5, 20]]
    np.testing.assert_allclose(camera.project(points), pixels)
    np.testing.assert_allclose(camera.unproject(frozen(pixels), points[:, 2]), points)


def test_shapes_and_broadcasting():
    pixels = frozen(np.zeros((3, 5, 2)))
    assert CAMERA.unproject(pixels, 2.0).shape == (3, 5, 3)
    assert CAMERA.unproject(pixels[0, 0], frozen([1, 2])).shape == (2, 3)
    assert CAMERA.project(frozen(np.ones((3, 5, 3)))).shape == (3, 5, 2)


def test_what_lies_behind_the_camera_has_no_pixel():
    points = frozen([[1, 1, -2], [1, 1, 0], [0, 0, 0], [1, 1, np.nan], [1, 1, 2]])
    pixels = CAMERA.project(points)
    np.testing.assert_array_equal(np.isnan(pixels).all(axis=1), [True] * 4 + [False])
    np.testing.assert_array_equal(np.isnan(pixels).any(axis=1), [True] * 4 + [False])
    assert np.isnan(CAMERA.unproject([3.0, 4.0], np.nan)).all()


def test_pixel_centers():
    centers = CAMERA.pixel_centers()
    assert centers.shape == (48, 64, 2)
    np.testing.assert_array_equal(centers[0, 0], [0.5, 0.5])
    np.testing.assert_array_equal(centers[47, 63], [63.5, 47.5])
    np.testing.assert_array_equal(centers[7, 11], [11.5, 7.5])


def test_opencv_has_the_same_pixels_half_a_pixel_less():
    rng = np.random.default_rng(0)
    points = frozen(rng.uniform([-2, -2, 0.5], [2, 2, 5], (100, 3)))
    # OpenCV: the centre of the top-left pixel is (0, 0); hence cx − 0.5 there, + 0.5 here
    matrix = np.array(
        [[CAMERA.fx_px, 0, CAMERA.cx_px - 0.5], [0, CAMERA.fy_px, CAMERA.cy_px - 0.5], [0, 0, 1]]
    )
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, None)[0][:, 0]
    np.testing.assert_allclose(CAMERA.project(points), theirs + 0.5, rtol=0, atol=1e-9)


def test_open3d_gives_the_same_points_for_a_whole_depth_image():
    o3d = open3d()
    depth_m = np.random.default_rng(1).uniform(0.4, 6, (48, 64)).astype(np.float32)
    cloud = o3d.geometry.PointCloud.create_from_depth_image(
        o3d.geometry.Image(depth_m), intrinsics(CAMERA), depth_scale=1.0, depth_trunc=100.0
    )
    ours = CAMERA.unproject(CAMERA.pixel_centers(), depth_m).reshape(-1, 3)
    np.testing.assert_allclose(ours, np.asarray(cloud.points), rtol=0, atol=1e-5)


def test_cameras_are_values():
    twin = PinholeCamera(64, 48, 52.5, 57.25, 31.75, 23.0)
    assert twin == CAMERA
    assert hash(CAMERA) == hash(twin)
    with pytest.raises(AttributeError):
        CAMERA.fx_px = 1.0  # type: ignore[misc]
