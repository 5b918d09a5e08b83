"""The map: points of the world, the keyframes that saw them, and who sees what together."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import apply, invert
from imodbatch.poses.rgbd.adjustment import Tie
from imodbatch.poses.rgbd.features import SCALE_FACTOR
from imodbatch.poses.rgbd.matching import Expected
from imodbatch.poses.slam.frame import Frame

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
NO_POINT = -1
MIN_SHARED = 15
MAX_NEIGHBOURS = 12
MAX_VIEW_ANGLE_COS = 0.5
POINT = np.dtype(
    [
        ("position", np.float64, 3),  # in the world
        ("descriptor", np.uint64, 4),
        ("octave", np.int64),
        ("distance", np.float64),  # from which the keyframe that made it saw it
        ("direction", np.float64, 3),  # from there to here, of length 1
        ("anchor", np.int64),  # that keyframe
    ]
)


@dataclass
class Keyframe:
    """A frame that the map is built from.

    Attributes:
        position: of the frame in the sequence.
        frame: what it offers.
        cam_from_world: (4, 4), changed by refinement.
        point_ids: (N,) map point of each feature, `NO_POINT` = none.
        part: which connected part of the map it belongs to.
        neighbours: keyframes that see at least `MIN_SHARED` of its points, most first.
    """

    position: int
    frame: Frame
    cam_from_world: Array
    point_ids: Indices
    part: int
    neighbours: list[int] = field(default_factory=list)

    @property
    def seen(self) -> Indices:
        """Map points it sees."""
        return self.point_ids[self.point_ids != NO_POINT]


class Landmarks:
    """Map points as an array that grows, keyframes and the ties between them as lists."""

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self.ties: list[Tie] = []
        self.n_points = 0
        self._points = np.zeros(1024, POINT)

    @property
    def positions(self) -> Array:
        """Places (P, 3) in the world, to be written to by refinement."""
        return self._points["position"][: self.n_points]

    @property
    def anchor(self) -> Indices:
        """(P,) the keyframe that made each point."""
        return self._points["anchor"][: self.n_points]

    @property
    def cam_from_world(self) -> Array:
        """Poses (K, 4, 4) of the keyframes."""
        return np.stack([k.cam_from_world for k in self.keyframes])

    def part(self, number: int) -> list[int]:
        """The keyframes of a connected part of the map."""
        return [k for k, keyframe in enumerate(self.keyframes) if keyframe.part == number]

    def add_keyframe(self, keyframe: Keyframe) -> int:
        """Append a keyframe, make points of its features that have depth and no point yet."""
        number = len(self.keyframes)
        self.keyframes.append(keyframe)
        fresh = np.flatnonzero((keyframe.point_ids == NO_POINT) & keyframe.frame.features.has_depth)
        keyframe.point_ids[fresh] = self._add_points(number, keyframe, fresh)
        self.update_neighbours(number)
        return number

    def _add_points(self, number: int, keyframe: Keyframe, rows: Indices) -> Indices:
        ids = np.arange(self.n_points, self.n_points + len(rows))
        self.n_points += len(rows)
        while len(self._points) < self.n_points:
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
        features, world_from_cam = keyframe.frame.features, invert(keyframe.cam_from_world)
        points_cam = features.points_cam[rows]
        distance = np.linalg.norm(points_cam, axis=1)
        self._points["position"][ids] = apply(world_from_cam, points_cam)
        self._points["descriptor"][ids] = features.descriptors[rows]
        self._points["octave"][ids] = features.octave[rows]
        self._points["distance"][ids] = distance
        self._points["direction"][ids] = points_cam / distance[:, None] @ world_from_cam[:3, :3].T
        self._points["anchor"][ids] = number
        return ids

    def mask(self, ids: Indices) -> NDArray[np.bool_]:
        """(P,) True for these points."""
        found = np.zeros(self.n_points, dtype=np.bool_)
        found[ids] = True
        return found

    def n_shared(self, ids: Indices) -> Indices:
        """(K,) how many of these points each keyframe sees."""
        wanted = self.mask(ids)
        return np.array([int(wanted[k.seen].sum()) for k in self.keyframes], dtype=np.int64)

    def update_neighbours(self, number: int) -> None:
        """Find the keyframes that see much of what this one sees."""
        shared = self.n_shared(self.keyframes[number].seen)
        shared[number] = 0
        order = np.argsort(-shared, kind="stable")[:MAX_NEIGHBOURS]
        self.keyframes[number].neighbours = [int(k) for k in order if shared[k] >= MIN_SHARED]

    def surroundings(self, number: int) -> list[int]:
        """A keyframe and its neighbours."""
        return [number, *self.keyframes[number].neighbours]

    def points_of(self, numbers: list[int]) -> Indices:
        """Points that any of these keyframes sees."""
        return np.unique(np.concatenate([self.keyframes[k].seen for k in numbers]))

    def expected(self, ids: Indices, cam_from_world: Array) -> tuple[Indices, Array, Expected]:
        """What a camera should see of these points, were none hidden.

        Returns:
            the points that lie in front of it and are seen from a like side, their places in the
            camera, and how they should appear. Pixels may lie outside the image.
        """
        points = self._points[ids]
        points_cam = apply(cam_from_world, points["position"])
        distance = np.linalg.norm(points_cam, axis=1)
        view = points_cam @ cam_from_world[:3, :3]
        alike = (view * points["direction"]).sum(axis=1) > MAX_VIEW_ANGLE_COS * distance
        kept = np.flatnonzero((points_cam[:, 2] > 0.1) & alike)
        points = points[kept]
        octave = points["octave"] + np.log(points["distance"] / distance[kept]) / np.log(
            SCALE_FACTOR
        )
        expected = Expected(np.zeros((0, 2)), octave, points["descriptor"])
        return ids[kept], points_cam[kept], expected

    def carry(self, ids: Indices, new_from_old: Array) -> None:
        """Move points (P,), and the sides they are seen from, by a transform (4, 4)."""
        position, direction = self._points["position"], self._points["direction"]
        position[ids] = apply(new_from_old, position[ids])
        direction[ids] = direction[ids] @ new_from_old[:3, :3].T

    def merge(self, kept: Indices, dropped: Indices) -> None:
        """Make one point of two, pair by pair; what saw the second now sees the first."""
        becomes = np.arange(self.n_points + 1)
        becomes[dropped] = kept
        becomes[-1] = NO_POINT
        for keyframe in self.keyframes:
            ids = becomes[keyframe.point_ids]
            _, first = np.unique(ids, return_index=True)
            repeated = np.ones(len(ids), dtype=np.bool_)
            repeated[first] = False
            ids[repeated] = NO_POINT  # a keyframe sees a point once
            keyframe.point_ids = ids
