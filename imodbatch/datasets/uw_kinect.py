"""The Kinect of both releases of the UW RGB-D Scenes: depth in mm, registered to colour."""

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel
from imodbatch.datasets.layout import registered
from imodbatch.settings.manifest import Manifest, SequenceSection

# The authors' depthToCloud.m has f = 570.3 and the centre at pixel (320, 240) counted from 1: that
# pixel's own centre is 319.5, 239.5 in continuous pixels.
KINECT = PinholeCamera(640, 480, 570.3, 570.3, 319.5, 239.5)


def cameras(manifest: Manifest, _sequence: SequenceSection | None) -> CameraModel:
    """One camera for both images."""
    return registered(manifest, KINECT)
