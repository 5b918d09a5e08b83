"""Tables and desks seen by a hand-held RGB-D camera, in the layout of the UW RGB-D Scenes.

world    a room whose table bears bowls, caps, cereal boxes, mugs, cans, and other things
walk     how a person carries the camera about the table
files    the v1 layout: images, ``.mat`` boxes; and, apart from it, what is true
manifest the dataset described to the pipeline
dataset  `write_scenes`: everything on disk, resumable
"""

from imodbatch.lab.tabletop.dataset import write_scenes

__all__ = ["write_scenes"]
