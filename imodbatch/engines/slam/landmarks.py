"""The map: points of the world, the keyframes that saw them, and who sees what together."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.frames import apply, invert
from imodbatch.engines.slam.features import SCALE_FACTOR, Features
from imodbatch.engines.slam.matching import Expected

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
NO_POINT = -1
MIN_SHARED = 15
MAX_NEIGHBOURS = 12
MAX_VIEW_ANGLE_COS = 0.5


@dataclass
class Keyframe:
    """A frame that the map is built from.

    Attributes:
        position: of the frame in the sequence.
        features: its features.
        cam_from_world: (4, 4), changed by refinement.
        point_ids: (N,) map point of each feature, `NO_POINT` = none.
        part: which connected part of the map it belongs to.
        neighbours: keyframes that see at least `MIN_SHARED` of its points, most first.
    """

    position: int
    features: Features
    cam_from_world: Array
    point_ids: Indices
    part: int
    neighbours: list[int] = field(default_factory=list)

    @property
    def seen(self) -> Indices:
        """Map points it sees."""
        return self.point_ids[self.point_ids != NO_POINT]


class Landmarks:
    """Map points as arrays that grow, and keyframes as a list."""

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self.n_points = 0
        self._positions = np.zeros((1024, 3))
        self._descriptors = np.zeros((1024, 4), dtype=np.uint64)
        self._octave = np.zeros(1024, dtype=np.int64)
        self._distance = np.zeros(1024)
        self._direction = np.zeros((1024, 3))
        self._anchor = np.zeros(1024, dtype=np.int64)

    @property
    def positions(self) -> Array:
        """Places (P, 3) in the world, to be written to by refinement."""
        return self._positions[: self.n_points]

    @property
    def anchor(self) -> Indices:
        """(P,) the keyframe that made each point."""
        return self._anchor[: self.n_points]

    def add_keyframe(self, keyframe: Keyframe) -> int:
        """Append a keyframe, make points of its features that have depth and no point yet."""
        number = len(self.keyframes)
        self.keyframes.append(keyframe)
        fresh = np.flatnonzero((keyframe.point_ids == NO_POINT) & keyframe.features.has_depth)
        keyframe.point_ids[fresh] = self._add_points(number, keyframe, fresh)
        self.update_neighbours(number)
        return number

    def _add_points(self, number: int, keyframe: Keyframe, rows: Indices) -> Indices:
        ids = np.arange(self.n_points, self.n_points + len(rows))
        self.n_points += len(rows)
        self._reserve(self.n_points)
        points_cam = keyframe.features.points_cam[rows]
        world_from_cam = invert(keyframe.cam_from_world)
        distance = np.linalg.norm(points_cam, axis=1)
        self._positions[ids] = apply(world_from_cam, points_cam)
        self._descriptors[ids] = keyframe.features.descriptors[rows]
        self._octave[ids] = keyframe.features.octave[rows]
        self._distance[ids] = distance
        self._direction[ids] = (points_cam / distance[:, None]) @ world_from_cam[:3, :3].T
        self._anchor[ids] = number
        return ids

    def _reserve(self, n: int) -> None:
        while len(self._anchor) < n:
            for name in (
                "_positions", "_descriptors", "_octave", "_distance", "_direction", "_anchor"
            ):  # fmt: skip
                array = getattr(self, name)
                setattr(self, name, np.concatenate([array, np.zeros_like(array)]))

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
        points_cam = apply(cam_from_world, self._positions[ids])
        distance = np.linalg.norm(points_cam, axis=1)
        view = points_cam @ cam_from_world[:3, :3]
        alike = (view * self._direction[ids]).sum(axis=1) > MAX_VIEW_ANGLE_COS * distance
        kept = np.flatnonzero((points_cam[:, 2] > 0.1) & alike)
        ids = ids[kept]
        nearer = np.log(self._distance[ids] / distance[kept]) / np.log(SCALE_FACTOR)
        octave = self._octave[ids] + nearer
        return ids, points_cam[kept], Expected(np.zeros((0, 2)), octave, self._descriptors[ids])

    def carry(self, ids: Indices, new_from_old: Array) -> None:
        """Move points (P,), and the sides they are seen from, by a transform (4, 4)."""
        self._positions[ids] = apply(new_from_old, self._positions[ids])
        self._direction[ids] = self._direction[ids] @ new_from_old[:3, :3].T

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
