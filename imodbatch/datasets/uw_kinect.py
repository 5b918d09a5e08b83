"""What both releases of the UW RGB-D Scenes share: one Kinect, and images in pairs by number."""

from pathlib import Path

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.patterns import PathPattern
from imodbatch.manifest import Manifest

# The authors' depthToCloud.m has f = 570.3 and the centre at pixel (320, 240) counted from 1: that
# pixel's own centre is 319.5, 239.5 in continuous pixels.
KINECT = PinholeCamera(640, 480, 570.3, 570.3, 319.5, 239.5)


def cameras(manifest: Manifest) -> CameraModel:
    """One camera for both images: depth is registered to colour, in millimetres, 0 = none.

    `camera.color` of the manifest therefore replaces the camera of both.
    """
    section = manifest.camera
    camera = KINECT if section.color is None else section.color.camera(section.pixel_origin)
    return CameraModel(camera, camera, depth_scale_m=0.001, depth_invalid=(0,))


def paired_frames(
    root: Path, folder: Path, color: PathPattern, depth: PathPattern
) -> list[FrameFile]:
    """Colour images of a folder by number, each with the depth image of its number.

    Args:
        root: of the dataset; paths are relative to it.
        folder: where the images lie.
        color: pattern of the colour images, with ``{frame}``.
        depth: pattern of the depth images.
    """
    depth_of = dict(depth.find(folder))
    return [
        FrameFile(
            number,
            None,
            path.relative_to(root).as_posix(),
            depth_of[number].relative_to(root).as_posix() if number in depth_of else None,
        )
        for number, path in color.find(folder)
    ]
