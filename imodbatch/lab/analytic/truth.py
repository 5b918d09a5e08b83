"""What is true of every object in a frame: its box, how much of it shows, from where it is seen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.viewpoint import FULL_TURN_RAD, view_angles
from imodbatch.lab.analytic.render import Trace
from imodbatch.lab.analytic.world import World
from imodbatch.lab.masks import bounds_of

MIN_VISIBLE_FRACTION = 0.4
"""An object of which less shows is annotated as ignored."""


@dataclass(frozen=True)
class TrueObject:
    """One object in one frame, of which at least one pixel shows.

    Attributes:
        object_index: ordinal in the world.
        class_id: ordinal in the catalogue.
        instance_id: the object's name.
        box_px: (x0, y0, x1, y1) of its visible pixels, continuous pixels: the outer edges of the
            outermost pixels.
        n_pixels: how many pixels show.
        visible_fraction: the share of its silhouette within the image that nothing hides.
        is_cut: its silhouette touches the image's border.
        azimuth_rad: from where it is seen in the object's own frame, [0, 2π).
        elevation_rad: above the horizon.
    """

    object_index: int
    class_id: int
    instance_id: str
    box_px: tuple[float, float, float, float]
    n_pixels: int
    visible_fraction: float
    is_cut: bool
    azimuth_rad: float
    elevation_rad: float

    @property
    def is_ignored(self) -> bool:
        """Too hidden or cut off to count."""
        return self.is_cut or self.visible_fraction < MIN_VISIBLE_FRACTION


def true_objects(
    world: World, world_from_cam: NDArray[np.float64], traced: Trace
) -> list[TrueObject]:
    """The objects that show in a frame, in the world's order."""
    found = []
    for index, placed in enumerate(world.objects):
        visible, alone = traced.owner == index, traced.alone[index]
        bounds = bounds_of(visible)
        if bounds is None:
            continue
        left, top, right, bottom = map(float, bounds)
        azimuth, elevation = view_angles(placed.xyz_world, world_from_cam[:3, 3])
        edges = np.r_[alone[0], alone[-1], alone[:, 0], alone[:, -1]]
        found.append(
            TrueObject(
                object_index=index,
                class_id=placed.class_id,
                instance_id=placed.instance_id,
                box_px=(left, top, right, bottom),
                n_pixels=int(visible.sum()),
                visible_fraction=float(visible.sum() / alone.sum()),
                is_cut=bool(edges.any()),
                azimuth_rad=float((azimuth - placed.yaw_rad) % FULL_TURN_RAD),
                elevation_rad=float(elevation),
            )
        )
    return found
