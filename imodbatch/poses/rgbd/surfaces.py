"""Depth images as surfaces, and how well one lies on another (point to plane, Chen & Medioni 1992).

A point of one frame, moved into another by a guessed relative pose, falls on one of its pixels; its
distance from the plane through that pixel's surface should be none (projective association, as in
KinectFusion, Newcombe et al. 2011). Points are so far apart that their errors hardly go together.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply
from imodbatch.poses.rgbd.measurement import DEPTH_SIGMA_FLOOR_M, DEPTH_SIGMA_PER_M, MIN_Z_M

Array = NDArray[np.float64]
SHRINK = 4
SOURCE_STEP = 10
MAX_DEPTH_M = 5.0
MAX_EDGE_SHARE = 0.03
MAX_DISTANCE_M = 0.08
TUKEY_BOUND, LEAST_SPREAD, CHI2_MEDIAN = 4.0, 0.3, 0.455


@dataclass(frozen=True)
class Surface:
    """A frame's depth, thinned out.

    Attributes:
        camera: of the thinned image (h, w).
        points: (h, w, 3) metres in the camera, NaN = unknown.
        normals: (h, w, 3) unit normals towards the camera, NaN = unknown or an edge.
        samples: (S, 3) points to lay on other surfaces, all finite.
    """

    camera: PinholeCamera
    points: Array
    normals: Array
    samples: Array


@dataclass(frozen=True)
class Contact:
    """How S points lie on a surface.

    Attributes:
        met: (S,) whether a sample falls on a known part of the surface, near enough.
        error: (S,) whitened distances from the tangent planes; 0 where nothing is met.
        weight: (S,) how far to trust them, 0 where nothing is met.
        jacobian: (S, 6) of the error by a twist on the left of target_from_source.
    """

    met: NDArray[np.bool_]
    error: Array
    weight: Array
    jacobian: Array


def surface(depth_m: DepthImage, camera: PinholeCamera) -> Surface:
    """Thin out a registered depth image (H, W) and find its normals."""
    known = np.isfinite(depth_m) & (depth_m < MAX_DEPTH_M)
    filled = np.where(known, depth_m, 0).astype(np.float32)
    size = (camera.width_px // SHRINK, camera.height_px // SHRINK)
    share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(filled, size, interpolation=cv2.INTER_AREA)
    with np.errstate(invalid="ignore", divide="ignore"):
        small = np.where(share > 0.5, total / share, np.nan).astype(np.float64)
    # no exact quarter where the size is no multiple of four
    across, down = size[0] / camera.width_px, size[1] / camera.height_px
    thin = PinholeCamera(
        *size,
        camera.fx_px * across,
        camera.fy_px * down,
        camera.cx_px * across,
        camera.cy_px * down,
    )
    normals = _normals(small, thin)
    pixels = camera.pixel_centers()[
        SOURCE_STEP // 2 :: SOURCE_STEP, SOURCE_STEP // 2 :: SOURCE_STEP
    ]
    sampled = filled[SOURCE_STEP // 2 :: SOURCE_STEP, SOURCE_STEP // 2 :: SOURCE_STEP]
    there = sampled > 0
    samples = camera.unproject(pixels[there], sampled[there])
    return Surface(thin, thin.unproject(thin.pixel_centers(), small), normals, samples)


def _normals(depth_m: Array, camera: PinholeCamera) -> Array:
    """Unit normals (h, w, 3) from the slope of depth between neighbours; NaN at edges."""
    slope_v, slope_u = np.full_like(depth_m, np.nan), np.full_like(depth_m, np.nan)
    slope_u[:, 1:-1] = 0.5 * (depth_m[:, 2:] - depth_m[:, :-2])
    slope_v[1:-1] = 0.5 * (depth_m[2:] - depth_m[:-2])
    steep = np.maximum(np.abs(slope_u), np.abs(slope_v)) > MAX_EDGE_SHARE * depth_m
    offset = camera.pixel_centers() - (camera.cx_px, camera.cy_px)
    normal = np.stack(
        [
            camera.fx_px * slope_u,
            camera.fy_px * slope_v,
            -(depth_m + offset[..., 0] * slope_u + offset[..., 1] * slope_v),
        ],
        axis=-1,
    )
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[steep] = np.nan
    return normal


def contact(target: Surface, samples: Array, target_from_source: Array) -> Contact:
    """Lay points (S, 3) of a source camera on a surface."""
    moved = apply(target_from_source, samples)
    camera = target.camera
    z = np.maximum(moved[:, 2], MIN_Z_M)
    column = np.floor(camera.fx_px * moved[:, 0] / z + camera.cx_px).astype(np.int64)
    row = np.floor(camera.fy_px * moved[:, 1] / z + camera.cy_px).astype(np.int64)
    inside = (column >= 0) & (column < camera.width_px) & (row >= 0) & (row < camera.height_px)
    inside &= moved[:, 2] > MIN_Z_M
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    normal, point = target.normals[row, column], target.points[row, column]
    gap = moved - point
    distance = (normal * gap).sum(axis=1)
    met = inside & np.isfinite(distance)
    met &= np.where(met, (gap * gap).sum(axis=1), np.inf) < MAX_DISTANCE_M**2
    sigma = DEPTH_SIGMA_FLOOR_M + DEPTH_SIGMA_PER_M * z**2
    error = np.where(met, distance / sigma, 0.0)
    spread = np.sqrt(np.median(np.square(error[met])) / CHI2_MEDIAN) if met.any() else 1.0
    bound = TUKEY_BOUND * np.clip(spread, LEAST_SPREAD, 1.0)
    weight = np.where(met, np.square(np.clip(1 - np.square(error / bound), 0, None)), 0.0)
    normal = np.where(met[:, None], normal, 0.0)
    jacobian = np.concatenate([normal, np.cross(moved, normal)], axis=1) / sigma[:, None]
    return Contact(met, error, weight, jacobian)
