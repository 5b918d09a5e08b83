"""Where is this frame? By points near where they should appear, or from a place seen before."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.rgbd.matching import Expected, mutual_matches, projection_matches
from imodbatch.poses.rgbd.resection import MIN_FITTING, ransac, refine
from imodbatch.poses.slam.frame import Frame
from imodbatch.poses.slam.landmarks import NO_POINT, Keyframe, Landmarks

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
NEAR_PX, WIDE_PX, CLOSE_PX = 12.0, 36.0, 5.0
MIN_MATCHES_TO_START = 12


@dataclass(frozen=True)
class Located:
    """A frame's pose and what it rests on.

    Attributes:
        cam_from_world: (4, 4).
        point_ids: (M,) map points that it sees and that fit.
        rows: (M,) the features that see them.
    """

    cam_from_world: Array
    point_ids: Indices
    rows: Indices


def follow(
    frame: Frame,
    landmarks: Landmarks,
    recent: Indices,
    local: Indices,
    guesses: list[Array],
    enough: int,
) -> Located | None:
    """Find the frame near one of several guessed poses (4, 4) among map points; None = not there.

    Guesses are tried in turn, with the `recent` points looked for in a wider and wider circle,
    until `enough` sightings fit; else the best try counts. Then all `local` points are looked for
    close to where they should be by the pose so found.
    """
    best: Located | None = None
    for guess, radius_px in zip(guesses, (NEAR_PX, WIDE_PX), strict=False):
        best = better(best, _fit(frame, landmarks, recent, guess, radius_px))
        if best is not None and len(best.rows) >= enough:
            break
    if best is None:
        return None
    return better(best, _fit(frame, landmarks, local, best.cam_from_world, CLOSE_PX))


def better(a: Located | None, b: Located | None) -> Located | None:
    """The one that more sightings fit."""
    if a is None or (b is not None and len(b.rows) > len(a.rows)):
        return b
    return a


def _fit(
    frame: Frame, landmarks: Landmarks, ids: Indices, cam_from_world: Array, radius_px: float
) -> Located | None:
    camera = frame.camera
    ids, points_cam, expected = landmarks.expected(ids, cam_from_world)
    pixels = camera.project(points_cam)
    inside = (pixels >= 0).all(axis=1) & (pixels < (camera.width_px, camera.height_px)).all(axis=1)
    ids = ids[inside]
    if len(ids) < MIN_FITTING:
        return None
    there = Expected(pixels[inside], expected.octave[inside], expected.descriptors[inside])
    point, row = projection_matches(there, frame.features, radius_px)
    ids = ids[point]
    if len(ids) < MIN_FITTING:
        return None
    pose, good = refine(camera, cam_from_world, frame.sightings(landmarks.positions[ids], row))
    if good.sum() < MIN_FITTING:
        return None
    return Located(pose, ids[good], row[good])


def recognise(
    frame: Frame, landmarks: Landmarks, keyframe: Keyframe, nearby: Indices
) -> Located | None:
    """Find the frame from what a keyframe saw, without any guess; None = not the same place.

    Args:
        frame: to be located.
        landmarks: the map.
        keyframe: what it might look like.
        nearby: points that the keyframe and its neighbours see; the pose must explain enough of
            them.
    """
    usable = np.flatnonzero(keyframe.point_ids != NO_POINT)
    a, b = mutual_matches(keyframe.frame.features.descriptors[usable], frame.features.descriptors)
    if len(a) < MIN_MATCHES_TO_START:
        return None
    ids = keyframe.point_ids[usable[a]]
    points = landmarks.positions[ids]
    start = ransac(frame.camera, points, frame.features.pixels[b])
    if start is None or start[1].sum() < MIN_MATCHES_TO_START:
        return None
    cam_from_world, agrees = start
    seen = frame.sightings(points[agrees], b[agrees])
    cam_from_world, good = refine(frame.camera, cam_from_world, seen)
    if good.sum() < MIN_MATCHES_TO_START:
        return None
    return _fit(frame, landmarks, nearby, cam_from_world, CLOSE_PX)
