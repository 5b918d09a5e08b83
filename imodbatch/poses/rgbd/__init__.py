"""What RGB-D frames offer and how one is held against another: the kit of all who ask for poses.

- `frames`, `gray`: the frames of a sequence and their grey images.
- `features`, `matching`, `flow`, `measurement`: what a frame offers, found again in another.
- `resection`, `surfaces`, `registration`: one pose from features, from surfaces, from both.
- `motion`: how the camera moved between two frames.
- `adjustment`: many poses and points at once.
"""

from imodbatch.poses.rgbd.frames import RgbdFrames

__all__ = ["RgbdFrames"]
