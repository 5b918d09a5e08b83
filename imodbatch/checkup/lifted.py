"""True boxes in the world: an object that stands still must be where every frame says it is.

The middle of each box gets a place by the depth behind it and the pose of its frame. Two frames'
boxes of one class (or one object) should meet at one place. Boxes that are mirrored or upside down
lift to whatever lies there, and do not meet; the reading under which they meet best is the right
one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.finding import WARNING, Finding, Outcome, failed, skipped
from imodbatch.checkup.views import evenly
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage, box_depth
from imodbatch.core.frames import apply, invert
from imodbatch.datasets.annotations.entries import Entry

Array = NDArray[np.float64]
N_FRAMES = 24
MOST_APART = 4
"""Frames of the sample that are held against each other: odometry drifts."""
CENTRE_FIRST = "shifted by half their size: the first two numbers are the centre"
WINDOW = 0.4
BORDER_PX = 3.0
FEWEST_PAIRS = 10
CLEARLY_BETTER, MOST_BETTER = 0.5, 0.65
LEAST_GAIN_M = 0.03
FAR_APART_SHARE = 0.15
"""Of the depth: boxes that meet no better than this on average deserve a look."""


@dataclass(frozen=True, eq=False)
class BoxFrame:
    """A frame with its true boxes.

    Attributes:
        depth_m: (H, W) in the colour camera.
        world_from_cam: (4, 4).
        boxes: (n, 4).
        names: n names: of the object where it is known, else of the class.
    """

    depth_m: DepthImage
    world_from_cam: Array
    boxes: Array
    names: tuple[str, ...]


def mirrored(boxes: Array, width_px: int, height_px: int) -> dict[str, Array]:
    """Boxes (n, 4) as they would be under other readings, by what is wrong with them."""
    left, top, right, bottom = boxes.T
    width, height = right - left, bottom - top
    from_right, from_left = width_px - right, width_px - left
    from_bottom, from_top = height_px - bottom, height_px - top
    x, y = left - width / 2, top - height / 2
    readings = {
        "mirrored (x counts from the right)": (from_right, top, from_left, bottom),
        "upside down (y counts from the bottom)": (left, from_bottom, right, from_top),
        "turned by 180°": (from_right, from_bottom, from_left, from_top),
        CENTRE_FIRST: (x, y, x + width, y + height),
        "given with x and y swapped": (top, left, bottom, right),
        "width and height read as a corner": (left, top, left + right, top + bottom),
        "a corner read as width and height": (left, top, width, height),
        "of images of half the size": (2 * left, 2 * top, 2 * right, 2 * bottom),
        "of images of twice the size": (left / 2, top / 2, right / 2, bottom / 2),
    }
    return {name: np.stack(sides, axis=-1) for name, sides in readings.items()}


def box_frames(
    entries: list[Entry],
    position_of: dict[int, int],
    world_from_cam: Array,
    read_depth: Callable[[int], DepthImage | None],
) -> list[BoxFrame]:
    """About 24 annotated frames with pose and depth, evenly over the sequence.

    Args:
        entries: of the sequence.
        position_of: frame number → position.
        world_from_cam: (F, 4, 4), NaN = lost.
        read_depth: position → depth in the colour camera, None = unreadable.
    """
    of_frame: dict[int, list[Entry]] = {}
    for entry in entries:
        is_box = not (entry.is_crowd or entry.left_out) and np.isfinite(entry.box).all()
        if is_box and entry.frame_index in position_of:
            of_frame.setdefault(position_of[entry.frame_index], []).append(entry)
    usable = [p for p in sorted(of_frame) if np.isfinite(world_from_cam[p, 0, 0])]
    frames = []
    for position in evenly(usable, N_FRAMES):
        depth_m = read_depth(position)
        if depth_m is None:
            continue
        own = of_frame[position]
        frames.append(
            BoxFrame(
                depth_m,
                world_from_cam[position],
                np.array([e.box for e in own], dtype=np.float64),
                tuple(e.instance_id or e.class_name for e in own),
            )
        )
    return frames


def check_lifted(frames: list[BoxFrame], camera: PinholeCamera) -> Outcome:
    """The check `boxes_in_world`."""
    check = "boxes_in_world"
    given = distances(frames, camera, [frame.boxes for frame in frames])
    known = np.isfinite(given)
    n_found = int(known.sum())
    best_name, best_m, given_m = "", np.inf, np.inf
    for name in mirrored(np.zeros((1, 4)), 1, 1):
        boxes = [mirrored(f.boxes, camera.width_px, camera.height_px)[name] for f in frames]
        other = distances(frames, camera, boxes)
        with np.errstate(invalid="ignore"):
            both = known & np.isfinite(other)
        if both.sum() < max(FEWEST_PAIRS, 0.4 * n_found):
            continue
        ours, theirs = float(np.median(other[both])), float(np.median(given[both]))
        is_mostly = float((other[both] < given[both]).mean()) >= MOST_BETTER
        is_clear = ours <= CLEARLY_BETTER * theirs and theirs - ours >= LEAST_GAIN_M
        if is_clear and is_mostly and ours < best_m:
            best_name, best_m, given_m = name, ours, theirs
    if best_name:
        seen = (
            f"The boxes seem to be {best_name}: the same object's places, lifted from two frames, "
            f"lie {given_m:.2f} m apart (median), {best_m:.2f} m if the boxes are turned back. "
            "Correct the annotation file."
        )
        return failed(check, seen, apart_m=given_m, best_apart_m=best_m)
    if n_found < FEWEST_PAIRS:
        return skipped(check, f"{n_found} pairs of boxes in two views, {FEWEST_PAIRS} needed")
    apart_m = float(np.median(given[known]))
    summary = f"one object's places lie {apart_m:.3f} m apart (median of {n_found} pairs of boxes)"
    known_m = [frame.depth_m[np.isfinite(frame.depth_m)] for frame in frames]
    usual_m = float(np.median([np.median(d) for d in known_m if len(d)]))
    if apart_m > FAR_APART_SHARE * usual_m:
        seen = (
            f"The same object's places, lifted from two frames, lie {apart_m:.2f} m apart (median "
            f"of {n_found} pairs). Boxes of other frames, moving objects, or poses that drift?"
        )
        return Outcome(check, summary, (Finding(WARNING, seen, figures={"apart_m": apart_m}),))
    return Outcome(check, summary)


def distances(frames: list[BoxFrame], camera: PinholeCamera, boxes: list[Array]) -> Array:
    """How far apart boxes of one name lift, for every box and later frame that should see it.

    Returns:
        (n,) metres, in an order that does not depend on the boxes; NaN where a box has no depth,
        the other frame does not see its place, or shows no box of that name.
    """
    places = [_places(f, b, camera) for f, b in zip(frames, boxes, strict=True)]
    result = []
    for i, frame in enumerate(frames):
        for j in range(i + 1, min(i + 1 + MOST_APART, len(frames))):
            other = frames[j]
            seen = camera.project(apply(invert(other.world_from_cam), places[i]))
            for row, name in enumerate(frame.names):
                rows = [k for k, n in enumerate(other.names) if n == name]
                if not rows:
                    continue
                apart = np.linalg.norm(places[j][rows] - places[i][row], axis=-1)
                is_seen = _inside(seen[row], camera) and np.isfinite(apart).any()
                result.append(float(np.nanmin(apart)) if is_seen else np.nan)
    return np.array(result, dtype=np.float64)


def _places(frame: BoxFrame, boxes: Array, camera: PinholeCamera) -> Array:
    """Places (n, 3) of the middles of boxes (n, 4); NaN without depth or where the border cuts."""
    depth = np.array([box_depth(frame.depth_m, box, "window_median", WINDOW) for box in boxes])
    limit = np.array([camera.width_px, camera.height_px]) - BORDER_PX
    whole = (boxes[:, :2] >= BORDER_PX).all(axis=1) & (boxes[:, 2:] <= limit).all(axis=1)
    whole &= (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    points = camera.unproject(middle, np.where(whole, depth, np.nan))
    return apply(frame.world_from_cam, points)


def _inside(pixel: Array, camera: PinholeCamera) -> bool:
    return bool(0 <= pixel[0] < camera.width_px and 0 <= pixel[1] < camera.height_px)
