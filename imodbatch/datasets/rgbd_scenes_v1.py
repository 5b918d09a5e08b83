"""UW RGB-D Scenes v1: <scene>/<scene>_<k>/<scene>_<k>_<n>.png and …_<n>_depth.png, n from 1.

The boxes of a sequence are in <scene>/<scene>_<k>.mat. The first release has no poses. A later one,
`rgbd-scenes_aligned`, has a `.pose` file per sequence; it is found in the sequence's folder, or in
the folder `rgbd-scenes_aligned` beside the root.
"""

from imodbatch.datasets.base import FrameFile
from imodbatch.datasets.layout import Layout, paired_frames
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.uw_kinect import cameras
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import AnnotationsSection, OdometrySection

ALIGNED = "rgbd-scenes_aligned"


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Frames of a sequence's folder; its name stands in the files' names, too."""
    folder = manifest.root_path / sequence.path
    color = PathPattern(f"{folder.name}_{{frame}}.png")
    depth = PathPattern(f"{folder.name}_{{frame}}_depth.png")
    return paired_frames(manifest.root_path, folder, [color], depth)


def _aligned(manifest: Manifest, sequence: SequenceSection) -> OdometrySection | None:
    """The aligned release's poses of a sequence, None = they are not there."""
    folder = manifest.root_path / sequence.path
    beside_root = manifest.root_path.resolve().parent / ALIGNED / sequence.path
    for place in (folder, beside_root):
        path = place / f"{folder.name}.pose"
        if path.is_file():
            return OdometrySection(format="uw", path=str(path.resolve()))
    return None


LAYOUT = Layout(
    _frames,
    cameras,
    images="files such as desk_1_1.png and desk_1_1_depth.png",
    own_poses=_aligned,
    true_poses=_aligned,
    own_boxes=AnnotationsSection(format="uw_mat", path="{sequence}.mat"),
    first_number=1,
)
