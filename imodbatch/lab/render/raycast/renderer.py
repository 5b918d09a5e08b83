"""Frames of a scene: colour, depth, which instance, and how much of each is in view."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.render.raycast.geometry import MISS
from imodbatch.lab.render.raycast.interface import NO_INSTANCE, Frame, RenderSettings, Scene
from imodbatch.lab.render.raycast.shading import backdrop
from imodbatch.lab.render.raycast.tone import expose
from imodbatch.lab.render.raycast.tracing import Geometry, Shot, Stopwatch, Traced, trace
from imodbatch.lab.render.raycast.visibility import view_of

DEFAULT_SETTINGS = RenderSettings()


class Renderer:
    """Renders one scene from many places; its triangles are sorted once.

    Attributes:
        scene: what is there.
        settings: what a picture costs and how it is exposed.
        seconds: how long each part of the last frame took.
    """

    def __init__(self, scene: Scene, settings: RenderSettings = DEFAULT_SETTINGS) -> None:
        self.scene, self.settings = scene, settings
        self.seconds: dict[str, float] = {}
        self._geometry = Geometry(scene.instances)
        ids = [instance.instance_id for instance in scene.instances]
        self._id_of_instance = np.array([*ids, NO_INSTANCE], np.int32)

    def render(self, camera: PinholeCamera, world_from_cam: NDArray[np.float64]) -> Frame:
        """One frame.

        Args:
            camera: size and intrinsics.
            world_from_cam: (4, 4).
        """
        watch = Stopwatch()
        shot = Shot.of(camera, world_from_cam)
        traced = trace(self._geometry, self.scene, self.settings, shot, watch)
        with watch.on("expose"):
            color = self._photograph(shot, traced)
        missed = traced.hits.face == MISS
        depth_m = np.where(missed, np.float32(np.nan), traced.hits.t).reshape(shot.shape)
        # The last entry stands for misses, whose instance is −1.
        instance = self._geometry.surfaces.instances(traced.hits.face)
        instance_ids = self._id_of_instance[instance].reshape(shot.shape)
        with watch.on("visibility"):
            views = tuple(
                view_of(item, camera, world_from_cam, instance_ids)
                for item in self.scene.instances
                if item.instance_id != NO_INSTANCE
            )
        self.seconds = watch.seconds
        return Frame(color, depth_m, instance_ids, views)

    def _photograph(self, shot: Shot, traced: Traced) -> NDArray[np.uint8]:
        """Colours (H, W, 3), with the background where rays miss."""
        light = traced.light
        open_px = np.flatnonzero(traced.coverage < 1)
        if open_px.size:
            behind = backdrop(self.scene.sky, shot.directions(shot.centers()[:, open_px]))
            light[:, open_px] += (1 - traced.coverage[open_px]) * behind
        return expose(light.T.reshape(*shot.shape, 3), self.settings.exposure)
