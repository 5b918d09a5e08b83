"""7-Scenes: frame-%06d.color.png|jpg, .depth.png (mm), .pose.txt (4×4 world_from_depth_camera).

The colour image is not registered to the depth image: depth has a focal length of 585 pixels,
colour about 525, as the dataset's page and its users say. The baseline between the cameras is not
published and taken as 0 unless the manifest gives `camera.color_from_depth`.
"""

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel, FrameFile
from imodbatch.datasets.layout import Layout, always, paired_frames
from imodbatch.datasets.patterns import PathPattern
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection

POSES = OdometrySection(format="matrix", path="frame-{frame}.pose.txt", camera="depth")
DEPTH = PathPattern("frame-{frame}.depth.png")
COLOR = [PathPattern(f"frame-{{frame}}.color.{ending}") for ending in ("png", "jpg", "jpeg")]
CAMERAS = CameraModel(
    color=PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0),
    depth=PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0),
    depth_scale_m=0.001,
    depth_invalid=(0, 65535),
)


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """The images of a ``seq-XX`` folder."""
    root = manifest.root_path
    return paired_frames(root, root / sequence.path, COLOR, DEPTH)


LAYOUT = Layout(
    _frames,
    always(CAMERAS),
    images="frame-{frame}.color.png and frame-{frame}.depth.png",
    own_poses=always(POSES),
    true_poses=always(POSES),
)
