"""A frame as slam knows it: its features with what they measure, and its surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.poses.rgbd import measurement
from imodbatch.poses.rgbd.features import Features
from imodbatch.poses.rgbd.gray import Gray
from imodbatch.poses.rgbd.resection import Sightings
from imodbatch.poses.rgbd.surfaces import Surface

Array = NDArray[np.float64]


class Frame:
    """A frame's features with their measurements, and its surface."""

    def __init__(self, features: Features, surface: Surface, camera: PinholeCamera) -> None:
        self.features = features
        self.surface = surface
        self.camera = camera
        self.measurements = measurement.measured(features.pixels, features.points_cam)
        self.sigma = measurement.sigmas(self.measurements, features.octave)

    def sightings(self, points: Array, rows: NDArray[np.int64]) -> Sightings:
        """That these features (n,) see these points (n, 3)."""
        return Sightings(points, self.measurements[rows], self.sigma[rows])


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame with the images it comes from: grey (H, W) and depth (H, W), NaN = unknown."""

    gray: Gray
    depth_m: DepthImage
    frame: Frame
