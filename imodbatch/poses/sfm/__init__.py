"""Structure from motion: camera poses of a whole sequence at once, from its images (COLMAP).

Neighbouring video frames tell geometry little and cost much. So keyframes are chosen by how far
the image has moved (`keyframes`), described by SIFT (`features`) and matched with their neighbours
and with whatever else in the sequence looks alike (`retrieval`). COLMAP reconstructs the keyframes
(`mapping`), depth images give the result its metres (`scale`), and the frames in between find their
pose by tracking the reconstructed points into them (`localization`). Depth, also as surfaces,
straightens both (`depth_adjustment`). `estimation` is the order of events.
"""

from imodbatch.poses.sfm.estimation import estimate

__all__ = ["estimate"]
