"""UW RGB-D Scenes v2: imgs/scene_01/00000-color.png and …-depth.png, poses in pc/01.pose.

A sequence's `path` is its folder below ``imgs``. The number at its end names the files in ``pc``.
"""

from imodbatch.core.errors import DataError
from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.layout import Layout, always, paired_frames
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.uw_kinect import cameras
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection

IMAGES = "imgs"
POSES = OdometrySection(format="uw", path="pc/{number}.pose")
COLOR, DEPTH = PathPattern("{frame}-color.png"), PathPattern("{frame}-depth.png")


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Frames of a ``scene_XX`` folder.

    Raises:
        DataError: there is no such folder below ``imgs``.
    """
    folder = manifest.root_path / IMAGES / sequence.path
    if not folder.is_dir():
        raise DataError(
            f"{folder}: no such folder (sequence {sequence.id!r}). Correct root or sequences.path, "
            "such as 'scene_01'."
        )
    return paired_frames(manifest.root_path, folder, [COLOR], DEPTH)


LAYOUT = Layout(
    _frames,
    cameras,
    images="imgs/{sequence}/{frame}-color.png and {frame}-depth.png",
    own_poses=always(POSES),
    true_poses=always(POSES),
)
