"""RGB-D SLAM: ORB features and depth surfaces → the camera's path.

After ORB-SLAM2 (Mur-Artal & Tardós 2017) in plan, not in code: frames are found by map points near
where they should appear, else by PnP in RANSAC; a local map of keyframes is refined in windows; old
places seen again close loops. Depth is used twice, behind each feature and as a surface.

What frames offer and how they are compared is in `imodbatch.poses.rgbd`.

- `frame`, `landmarks`, `refinement`: the map, and bundle adjustment of it.
- `places`, `loops`: recognition and loop closing. `dense`: where features are too few.
- `tracking`, `mapping`: the way of one frame. `path`: from the map to a trajectory.
"""

from imodbatch.poses.slam.path import estimate

__all__ = ["estimate"]
