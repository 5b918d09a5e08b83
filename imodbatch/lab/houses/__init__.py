"""Houses: a robot with an RGB-D camera drives through furnished rooms; everything is procedural.

patterns   noise without a seam, and colours of a palette
textures   surfaces drawn from random numbers: wood, tiles, carpet, wallpaper, stone
styles     what differs between training, validation and test houses: nothing is shared
solids     boxes and turned pieces → one mesh per material
furniture  tables, shelves, sofas, beds …, and on which levels things may stand
clutter    things that stand about and are no target
shell      the empty room: walls, windows, door, pictures
floorplan  layouts, and furniture that keeps apart
arranging  targets and clutter put down, nothing touching
world      `make_house`: room, furniture, what stands on it, light
planner    where the robot can drive, and a smooth way
drive      towards things, round them, waiting, touring; where the head looks
odometry   what the wheels make of it
sensor     faults of depth and colour
sequence   frames: what is true and what is measured
files      how a drive lies on disk
manifests  the dataset described to the pipeline
dataset    `write_house_dataset`: everything on disk, resumable
backgrounds  pictures without targets, for composing training images, resumable
"""

from imodbatch.lab.houses.backgrounds import write_backgrounds
from imodbatch.lab.houses.dataset import write_house_dataset

__all__ = ["write_backgrounds", "write_house_dataset"]
