"""One walk through one house, frame by frame: what is true, and what is measured."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import apply, invert
from imodbatch.core.viewpoint import FULL_TURN_RAD, ViewGrid, view_angles
from imodbatch.lab.houses.arranging import Target
from imodbatch.lab.houses.sensor import ColorCamera, measure_depth
from imodbatch.lab.houses.world import SENSOR_STREAM, House
from imodbatch.lab.mesh import TexturedMesh
from imodbatch.lab.render.raycast import InstanceView, RenderSettings

Array = NDArray[np.float64]
CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)
ELEVATIONS_RAD = (np.deg2rad(10.0), np.deg2rad(30.0), np.deg2rad(50.0))
GRID_16, GRID_8 = ViewGrid(16, ELEVATIONS_RAD), ViewGrid(8, ELEVATIONS_RAD)
SETTINGS = RenderSettings(exposure=None, shadow_rays=2, ambient_rays=2, light_stride=3)
LEAST_VISIBLE = 0.4
"""An object of which less shows is annotated as ignored."""
LEAST_SIDE_PX = 12.0
"""A box with a side shorter than this is ignored."""
SHUTTER = 0.1
"""Share of the time between frames in which the shutter is open."""
SHINY = 0.2
"""Surfaces that reflect more than this lose depth in patches."""


@dataclass(frozen=True)
class SeenTarget:
    """A target of which at least one pixel shows.

    The box encloses the target's whole outline within the image, hidden parts included: a network
    completes what a plant hides. If too little shows it is ignored, and so are outlines that the
    image's border cuts and small ones.

    Attributes:
        target: which.
        box_px: (x0, y0, x1, y1) continuous pixels.
        n_pixels: that show it.
        visibility: share of its outline within the image that nothing hides.
        is_cut: the image's border cuts it.
        inside: share of its whole outline that lies within the image.
        azimuth_rad: of the camera in the object's frame, [0, 2π).
        elevation_rad: of the camera above the object's horizon.
    """

    target: Target
    box_px: tuple[float, float, float, float]
    n_pixels: int
    visibility: float
    is_cut: bool
    inside: float
    azimuth_rad: float
    elevation_rad: float

    @property
    def is_ignored(self) -> bool:
        """Too hidden, cut or small to count."""
        x0, y0, x1, y1 = self.box_px
        is_small = min(x1 - x0, y1 - y0) < LEAST_SIDE_PX
        return self.is_cut or is_small or self.visibility < LEAST_VISIBLE


@dataclass(frozen=True, eq=False)
class HouseFrame:
    """One frame.

    Attributes:
        color: (H, W, 3) uint8 as photographed.
        exact_depth_m: (H, W) NaN where no surface is.
        measured_depth_m: (H, W) as the sensor gives it.
        instance_ids: (H, W) ordinal of the target, −1 = none.
        seen: targets that show.
    """

    color: NDArray[np.uint8]
    exact_depth_m: NDArray[np.floating]
    measured_depth_m: NDArray[np.float32]
    instance_ids: NDArray[np.int32]
    seen: list[SeenTarget]


def frames(
    house: House,
    walk_world_from_cam: Array,
    camera: PinholeCamera = CAMERA,
    shutter: float = SHUTTER,
    noise: float = 1.0,
) -> Iterator[HouseFrame]:
    """The frames of a walk (F, 4, 4) through a house, in order.

    Args:
        house: what is seen.
        walk_world_from_cam: (F, 4, 4) true poses.
        camera: intrinsics of colour and depth.
        shutter: share of the time between frames in which the shutter is open.
        noise: of colour, as a multiple of the robot's.
    """
    renderer = house.renderer(SETTINGS)
    color_rng, depth_rng = (house.random(SENSOR_STREAM + k) for k in (0, 1))
    photographer = ColorCamera(color_rng, noise)
    shininess = {
        number: 0.7 * share
        for number, target in enumerate(house.targets)
        if (share := _shiny_share(target.model.mesh)) > 0
    }
    before = walk_world_from_cam[0]
    for world_from_cam in walk_world_from_cam:
        rendered = renderer.render(camera, world_from_cam)
        motion = _motion_px(camera, before, world_from_cam, shutter)
        before = world_from_cam
        yield HouseFrame(
            photographer.photograph(rendered.color, motion),
            rendered.depth_m,
            measure_depth(rendered, camera, shininess, depth_rng),
            rendered.instance_ids,
            [
                _seen(house.targets[view.instance_id], view, world_from_cam)
                for view in rendered.views
                if view.n_visible_px and view.outline_box_px is not None
            ],
        )


def _seen(target: Target, view: InstanceView, world_from_cam: Array) -> SeenTarget:
    azimuth, elevation = view_angles(target.middle_world, world_from_cam[:3, 3])
    assert view.outline_box_px is not None
    return SeenTarget(
        target,
        view.outline_box_px,
        view.n_visible_px,
        view.visible_fraction,
        view.is_cut,
        view.inside_fraction,
        float((azimuth - target.yaw_rad) % FULL_TURN_RAD),
        float(elevation),
    )


def _motion_px(
    camera: PinholeCamera, before: Array, after: Array, shutter: float, distance_m: float = 1.5
) -> tuple[float, float]:
    """How far what lies ahead moves in the picture while the shutter is open."""
    ahead = apply(after, np.array([0.0, 0.0, distance_m]))
    u, v = camera.project(apply(invert(before), ahead))
    return float(u - camera.cx_px) * shutter, float(v - camera.cy_px) * shutter


def _shiny_share(mesh: TexturedMesh) -> float:
    """Share of a mesh's faces that reflect strongly."""
    specular = np.array([surface.specular for surface in mesh.surfaces])
    return float((specular[mesh.face_surface] > SHINY).mean())
