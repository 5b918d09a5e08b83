"""The way of one frame: found, given up or a new start; now and then it becomes a keyframe."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import apply, invert, orthonormal, twist_between
from imodbatch.core.trajectory import DENSE, TRACKED
from imodbatch.poses.rgbd.features import FeatureExtractor
from imodbatch.poses.rgbd.gray import Gray
from imodbatch.poses.rgbd.registration import bind, settle
from imodbatch.poses.rgbd.surfaces import SOURCE_STEP, surface
from imodbatch.poses.slam import loops
from imodbatch.poses.slam.dense import dense_motion
from imodbatch.poses.slam.frame import Frame, Seen
from imodbatch.poses.slam.landmarks import NO_POINT, Keyframe, Landmarks
from imodbatch.poses.slam.places import Places
from imodbatch.poses.slam.refinement import refine_all, refine_around
from imodbatch.poses.slam.tracking import Located, better, follow, recognise

Array = NDArray[np.float64]
MIN_TO_START = 100
MIN_DEPTH_SHARE = 0.2
FRAMES_BEFORE_RESTART = 3
N_RECOGNISED = 3
DOUBTFUL_SHARE = 0.6
NEW_KEYFRAME_SHARE = 0.7
MAX_SHIFT_SHARE, MAX_TURN_RAD = 0.12, np.radians(10.0)
N_TARGETS, N_TIES, N_LATE_TIES = 2, 3, 4
CLEAR_LOOP_M, CLEAR_LOOP_RAD = 0.03, np.radians(1.5)


@dataclass(frozen=True)
class Record:
    """Where a frame was found: relative to a keyframe, so that it follows its corrections."""

    keyframe: int
    cam_from_keyframe: Array
    status: str


@dataclass
class Mapper:
    """Tracks the camera of a sequence and maps what it sees.

    Frames must come in order. `records` has an entry for every frame, None = lost.
    """

    camera: PinholeCamera
    n_features: int
    landmarks: Landmarks = field(default_factory=Landmarks)
    records: list[Record | None] = field(default_factory=list)
    n_loops: int = 0
    n_relocalised: int = 0
    largest_correction_m: float = 0.0

    def __post_init__(self) -> None:
        self._extractor = FeatureExtractor(self.camera, self.n_features)
        self._places = Places()
        self._reference = -1
        self._local = self._recent = np.zeros(0, dtype=np.int64)
        self._last: Seen | None = None
        self._pose, self._motion = np.eye(4), np.eye(4)
        self._n_fitting = self._most_fitting = 0
        self._n_failed = 0
        self._n_parts = 0

    def add(self, gray: Gray | None, depth_m: DepthImage | None) -> None:
        """Locate the next frame; None = no such image."""
        if gray is None or depth_m is None:
            self._give_up(None)
            return
        features = self._extractor.extract(gray, depth_m)
        frame = Frame(features, surface(depth_m, self.camera), self.camera)
        seen = Seen(gray, depth_m, frame)
        if self._last is None:
            located = self._relocalise(frame)
            self.n_relocalised += located is not None
        else:
            located = self._follow(frame)
        if located is not None:
            self._accept(seen, located)
        elif not self._go_on_densely(seen):
            self._give_up(seen)

    def finish(self) -> None:
        """Refine each part of the map as a whole."""
        self._bind_what_overlaps()
        for part in sorted({k.part for k in self.landmarks.keyframes}):
            refine_all(self.landmarks, part)

    def _bind_what_overlaps(self) -> None:
        """Tie keyframes that look at the same side from nearby and share few points or none."""
        bound = {(min(t.first, t.second), max(t.first, t.second)) for t in self.landmarks.ties}
        for number, keyframe in enumerate(self.landmarks.keyframes):
            near = loops.nearest(self.landmarks, number)
            strangers = [k for k in near if k not in keyframe.neighbours]
            for other in strangers[:N_LATE_TIES]:
                pair = (min(number, other), max(number, other))
                if pair not in bound:
                    bound.add(pair)
                    self._bind(*pair)

    def _follow(self, frame: Frame) -> Located | None:
        """Near where the camera should be by its motion, or as seen from the reference."""
        guesses = [self._motion @ self._pose, self._pose]
        enough = int(DOUBTFUL_SHARE * self._n_fitting)
        located = follow(frame, self.landmarks, self._recent, self._local, guesses, enough)
        if located is None or len(located.rows) < enough:
            keyframe = self.landmarks.keyframes[self._reference]
            located = better(located, recognise(frame, self.landmarks, keyframe, self._local))
        return located

    def _relocalise(self, frame: Frame) -> Located | None:
        """Somewhere in the map, by places that look alike."""
        scores = self._places.scores(frame.features.descriptors)
        for k in np.argsort(-scores)[:N_RECOGNISED]:
            keyframe = self.landmarks.keyframes[k]
            nearby = self.landmarks.points_of(self.landmarks.surroundings(int(k)))
            located = recognise(frame, self.landmarks, keyframe, nearby)
            if located is not None:
                self._refer_to(int(k))
                return located
        return None

    def _accept(self, seen: Seen, located: Located) -> None:
        """Settle a located frame on the surfaces too, and keep it as a keyframe if it is new."""
        keyframes, frame = self.landmarks.keyframes, seen.frame
        around = [keyframes[k] for k in self.landmarks.surroundings(self._reference)[:N_TARGETS]]
        settled = settle(
            self.camera,
            located.cam_from_world,
            frame.sightings(self.landmarks.positions[located.point_ids], located.rows),
            frame.surface.samples,
            [(keyframe.frame.surface, keyframe.cam_from_world) for keyframe in around],
        )
        self._move_to(seen, settled.cam_from_world)
        self._recent = located.point_ids
        self._n_fitting = len(located.rows)
        self._most_fitting = max(self._most_fitting, self._n_fitting)
        if self._is_new():
            point_ids = np.full(len(frame.features), NO_POINT, dtype=np.int64)
            point_ids[located.rows] = located.point_ids
            self._keep(frame, point_ids, keyframes[self._reference].part)
            self._refine_and_close()
            self._pose = keyframes[self._reference].cam_from_world
            self.records.append(Record(self._reference, np.eye(4), TRACKED))
        else:
            self._record(TRACKED)

    def _is_new(self) -> bool:
        """Whether the view has changed enough since the reference keyframe."""
        if self._n_fitting < NEW_KEYFRAME_SHARE * self._most_fitting:
            return True
        keyframe = self.landmarks.keyframes[self._reference]
        away = twist_between(self._pose, keyframe.cam_from_world)
        distance = np.median(apply(self._pose, self.landmarks.positions[self._recent])[:, 2])
        shift, turn = np.linalg.norm(away[:3]), np.linalg.norm(away[3:])
        return bool(shift > MAX_SHIFT_SHARE * distance or turn > MAX_TURN_RAD)

    def _keep(self, frame: Frame, point_ids: NDArray[np.int64], part: int) -> None:
        keyframe = Keyframe(len(self.records), frame, self._pose, point_ids, part)
        number = self.landmarks.add_keyframe(keyframe)
        self._places.add(frame.features.descriptors)
        for other in keyframe.neighbours[:N_TIES]:
            self._bind(other, number)
        self._refer_to(number)

    def _bind(self, first: int, second: int) -> None:
        """Tie two keyframes by their surfaces, where these overlap."""
        surfaces = [k.frame.surface for k in self.landmarks.keyframes]
        found = bind(surfaces, self.landmarks.cam_from_world, first, second)
        if found is not None:
            self.landmarks.ties.append(found)

    def _refine_and_close(self) -> None:
        """Refine the window of the newest keyframe; pull a loop together if it closes one."""
        number = self._reference
        refine_around(self.landmarks, number)
        loop = loops.find_loop(self.landmarks, self._places, number)
        if loop is None:
            return
        self.n_loops += 1
        keyframes = self.landmarks.keyframes
        if keyframes[loop.old].part != keyframes[loop.new].part:
            loops.join_parts(self.landmarks, loop)
        else:
            self.largest_correction_m = max(self.largest_correction_m, loop.correction_m)
            if loop.correction_m > CLEAR_LOOP_M or loop.correction_rad > CLEAR_LOOP_RAD:
                loops.spread_correction(self.landmarks, loop)
        loops.fuse_points(self.landmarks, loop)
        self.landmarks.update_neighbours(number)
        self._bind(loop.old, number)
        refine_around(self.landmarks, number)
        self._refer_to(number)

    def _refer_to(self, number: int) -> None:
        """Track against a keyframe and its surroundings from now on."""
        self._reference = number
        self._local = self.landmarks.points_of(self.landmarks.surroundings(number))
        self._recent = self.landmarks.keyframes[number].seen
        self._most_fitting = 0

    def _move_to(self, seen: Seen, cam_from_world: Array) -> None:
        was_lost = self._last is None
        self._motion = np.eye(4) if was_lost else orthonormal(cam_from_world @ invert(self._pose))
        self._pose = cam_from_world
        self._last = seen
        self._n_failed = 0

    def _record(self, status: str) -> None:
        keyframe = self.landmarks.keyframes[self._reference]
        cam_from_keyframe = orthonormal(self._pose @ invert(keyframe.cam_from_world))
        self.records.append(Record(self._reference, cam_from_keyframe, status))

    def _go_on_densely(self, seen: Seen) -> bool:
        """From the last frame by brightness and depth as a whole, where features do not suffice."""
        last = self._last
        if last is None or not _has_depth(seen):
            return False
        new_from_last = dense_motion(last, seen)
        if new_from_last is None:
            return False
        self._move_to(seen, new_from_last @ self._pose)
        self._n_fitting = 0
        self._record(DENSE)
        return True

    def _give_up(self, seen: Seen | None) -> None:
        """The frame is lost; after a while without success a new part of the map begins."""
        self._last = None
        if seen is not None and _has_depth(seen):
            self._n_failed += 1
            if not self.landmarks.keyframes or self._n_failed > FRAMES_BEFORE_RESTART:
                self._start(seen)
                return
        self.records.append(None)

    def _start(self, seen: Seen) -> None:
        self._pose = np.eye(4)
        self._move_to(seen, np.eye(4))
        features = seen.frame.features
        self._keep(seen.frame, np.full(len(features), NO_POINT, dtype=np.int64), self._n_parts)
        self._n_parts += 1
        self._n_fitting = 0
        has_features = features.has_depth.sum() >= MIN_TO_START
        self._record(TRACKED if has_features else DENSE)


def _has_depth(seen: Seen) -> bool:
    n_samples = seen.gray.size / SOURCE_STEP**2
    return len(seen.frame.surface.samples) >= MIN_DEPTH_SHARE * n_samples
