"""Training images: viewpoint renders of objects, cut out and pasted on backgrounds (Sec. 3.3).

cutouts      an object seen from many viewpoints: RGBA pictures with their angles, on disk
lighting     light as it may be in some room
views        object model → cutouts, every bin of a view grid in several variants
turntable    UW RGB-D Object pictures → cutouts
backgrounds  a folder of pictures → random crops of them
placing      how large and where, and how much two objects may overlap
blending     Gaussian edge, Poisson, motion blur; a shadow where the object stands
photometry   what a cheap camera does to a picture
settings     `ComposeSettings`: what pictures are like
composition  `Composer`: index → picture with labels, on the fly
dataset      pictures and COCO labels on disk: parallel, resumable
sources      what a user asks for by name or folder → objects and backgrounds
"""

from imodbatch.lab.pictures.composition import Composer, Picture, Recipe
from imodbatch.lab.pictures.cutouts import Cutouts, load_cutouts
from imodbatch.lab.pictures.dataset import Summary, write_dataset
from imodbatch.lab.pictures.settings import ComposeSettings
from imodbatch.lab.pictures.turntable import read_turntable
from imodbatch.lab.pictures.views import ViewSettings, prepare_views

__all__ = [
    "ComposeSettings",
    "Composer",
    "Cutouts",
    "Picture",
    "Recipe",
    "Summary",
    "ViewSettings",
    "load_cutouts",
    "prepare_views",
    "read_turntable",
    "write_dataset",
]
