"""The poses as they are: is there one for every frame, a number each, and none that jumps?"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, failed, setting, skipped
from imodbatch.checkup.subject import Subject
from imodbatch.core.alignment import rotation_angle_rad
from imodbatch.core.errors import ImodError
from imodbatch.core.frames import invert, is_rigid
from imodbatch.core.pairs import steps_m
from imodbatch.core.trajectory import Trajectory
from imodbatch.datasets.base import NS_PER_MS, Odometry

Array = NDArray[np.float64]
Ask = Callable[[int, int], Array | None]
MOST_NAMED = 4
WINDOW_FRAMES = 15
JUMP_RATIO = 8.0
"""A step this many times larger than its neighbours' is a jump."""
LEAST_JUMP_M, LEAST_JUMP_RAD = 0.1, float(np.deg2rad(10))
MOST_ASKED = 6
GAP_RATIO = 5.0


def check_poses(subject: Subject, motion: Ask) -> Outcome:
    """The check `poses`.

    Args:
        subject: the sequence.
        motion: positions a, b → b_from_a (4, 4) by the images; None = they do not tell.
    """
    trajectory = subject.trajectory
    if trajectory is None:
        return skipped("poses", "the dataset gives none (poses.source = 'slam' or 'sfm' estimates)")
    if isinstance(trajectory, ImodError):
        return failed("poses", str(trajectory), _offset_line(subject))
    poses = trajectory.poses.world_from_cam
    known = np.isfinite(poses[:, 0, 0])
    findings = [
        *_lost(subject, known),
        *_jumps(subject, poses, motion),
        *(Finding(WARNING, text[0].upper() + text[1:] + ".") for text in trajectory.warnings),
    ]
    length = float(steps_m(poses[known]).sum())
    summary = f"{int(known.sum())} of {len(known)} frames have one; the path is {length:.2f} m long"
    return Outcome("poses", summary, tuple(findings))


def _lost(subject: Subject, known: NDArray[np.bool_]) -> list[Finding]:
    """Frames without a pose, and poses of the file that are none."""
    lost = np.flatnonzero(~known)
    broken = _broken_poses(subject)
    if len(lost) == 0 and not broken:
        return []
    parts = []
    if broken:
        parts.append(f"{broken} of the file's poses are NaN, infinite or no rigid transform")
    if len(lost):
        named = ", ".join(str(subject.files[i].frame_index) for i in lost[:MOST_NAMED])
        etc = ", …" if len(lost) > MOST_NAMED else ""
        parts.append(
            f"{len(lost)} of {len(known)} frames have no usable pose (frame {named}{etc}): their "
            "boxes get no place"
        )
    else:
        parts.append("their frames get one by interpolation")
    severity = ERROR if len(lost) > 0.5 * len(known) else WARNING
    figures = {"n_frames": float(len(lost)), "n_broken": float(broken)}
    return [Finding(severity, "; ".join(parts) + ".", figures=figures)]


def _broken_poses(subject: Subject) -> int:
    odometry = subject.odometry
    if not isinstance(odometry, Odometry):
        return 0
    return int((~is_rigid(odometry.world_from_color)).sum())


def _jumps(subject: Subject, poses: Array, motion: Ask) -> list[Finding]:
    """Steps out of proportion that the images contradict."""
    suspects = find_jumps(poses)
    real, size_m = [], 0.0
    for i in suspects[:MOST_ASKED]:
        by_images = motion(i, i + 1)
        claimed = invert(poses[i + 1]) @ poses[i]
        if by_images is not None and contradicts(claimed, by_images):
            real.append(i)
            size_m = max(size_m, float(np.linalg.norm(claimed[:3, 3])))
    if not real:
        return []
    named = ", ".join(f"{subject.files[i].frame_index}" for i in real[:MOST_NAMED])
    more = max(len(suspects) - MOST_ASKED, 0)
    seen = (
        f"The poses jump after frame {named}{' and others' if more else ''}, by up to "
        f"{size_m:.3g} m: more than {JUMP_RATIO:.0f} times the steps around, and the images show "
        "another motion. Leave those frames out, or estimate the poses "
        "(poses.source = 'slam')."
    )
    return [Finding(WARNING, seen, figures={"n_jumps": len(real) + more, "largest_m": size_m})]


def contradicts(claimed: Array, by_images: Array) -> bool:
    """Whether a step (4, 4) of the poses is mostly not what the images show."""
    difference = claimed @ invert(by_images)
    off_m = float(np.linalg.norm(difference[:3, 3]))
    off_rad = float(rotation_angle_rad(difference[:3, :3]))
    step_m = float(np.linalg.norm(claimed[:3, 3]))
    step_rad = float(rotation_angle_rad(claimed[:3, :3]))
    return bool(
        off_m > 0.5 * max(step_m, LEAST_JUMP_M) or off_rad > 0.5 * max(step_rad, LEAST_JUMP_RAD)
    )


def find_jumps(world_from_cam: Array) -> list[int]:
    """Positions i whose step to i + 1 is out of all proportion to those around it.

    Args:
        world_from_cam: (F, 4, 4), NaN = lost.
    """
    with np.errstate(invalid="ignore"):
        motion = invert(world_from_cam[:-1]) @ world_from_cam[1:]
    step_m = np.linalg.norm(motion[:, :3, 3], axis=-1)
    angle = rotation_angle_rad(motion[:, :3, :3])
    found = _out_of_proportion(step_m, LEAST_JUMP_M) | _out_of_proportion(angle, LEAST_JUMP_RAD)
    return np.flatnonzero(found).tolist()


def _out_of_proportion(steps: Array, least: float) -> NDArray[np.bool_]:
    """Which steps exceed the larger of their neighbourhood's median and the upper quartile."""
    found = np.zeros(len(steps), dtype=np.bool_)
    finite = np.isfinite(steps)
    if finite.sum() < 4:
        return found
    usual = float(np.percentile(steps[finite], 75))
    for i in np.flatnonzero(finite & (steps > np.maximum(least, JUMP_RATIO * usual))):
        around = steps[max(i - WINDOW_FRAMES, 0) : i + WINDOW_FRAMES + 1]
        around = around[np.isfinite(around)]
        found[i] = steps[i] > JUMP_RATIO * np.median(around)
    return found


def _offset_line(subject: Subject) -> tuple[str, ...]:
    """`clock_offset_ms` that lets frames and trajectory start together, if their times differ."""
    odometry, stamps = subject.odometry, subject.timestamp_ns
    section = subject.odometry_section
    if not isinstance(odometry, Odometry) or odometry.timestamp_ns is None or stamps is None:
        return ()
    given = odometry.timestamp_ns[is_rigid(odometry.world_from_color)]
    if len(given) == 0 or (stamps.min() <= given.max() and given.min() <= stamps.max()):
        return ()
    offset_ms = (int(stamps.min()) - int(given.min())) / NS_PER_MS
    before = 0.0 if section is None else section.clock_offset_ms
    return (setting("odometry", "clock_offset_ms", before + offset_ms),)


def check_stamps(subject: Subject) -> Outcome:
    """The check `stamps`: rising, without holes, and near those of the poses."""
    stamps = subject.timestamp_ns
    if stamps is None:
        return skipped("stamps", "frames have no timestamps")
    steps = np.diff(stamps) / NS_PER_MS
    if len(steps) == 0:
        return skipped("stamps", "one frame")
    usual_ms = float(np.median(steps))
    findings = []
    if (steps <= 0).any():
        after = int(np.argmax(steps <= 0))
        seen = (
            f"{int((steps <= 0).sum())} of {len(steps)} timestamps do not rise, the first after "
            f"{subject.name_of(after)}. Check images.timestamps."
        )
        findings.append(Finding(ERROR, seen, figures={"n_frames": int((steps <= 0).sum())}))
    holes = steps > GAP_RATIO * max(usual_ms, 1e-6)
    if holes.any() and usual_ms > 0:
        after = int(np.argmax(steps))
        seen = (
            f"{int(holes.sum())} holes in the frames' timestamps, the longest of "
            f"{steps.max():.0f} ms after {subject.name_of(after)} (usual: {usual_ms:.0f} ms)."
        )
        findings.append(Finding(WARNING, seen, figures={"longest_ms": float(steps.max())}))
    summary = f"a frame every {usual_ms:.1f} ms"
    gap_ms = _association_gap_ms(subject)
    if gap_ms is not None:
        summary += f"; poses {gap_ms:.1f} ms away (median)"
    return Outcome("stamps", summary, tuple(findings))


def _association_gap_ms(subject: Subject) -> float | None:
    """Median distance of the frames' stamps from the nearest pose's."""
    odometry, stamps = subject.odometry, subject.timestamp_ns
    if not isinstance(odometry, Odometry) or odometry.timestamp_ns is None or stamps is None:
        return None
    if not isinstance(subject.trajectory, Trajectory):
        return None
    given = np.unique(odometry.timestamp_ns)
    after = np.searchsorted(given, stamps).clip(1, max(len(given) - 1, 1))
    near = np.stack([given[after - 1], given[np.minimum(after, len(given) - 1)]])
    return float(np.median(np.abs(near - stamps).min(axis=0)) / NS_PER_MS)
