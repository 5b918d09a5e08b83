"""All checks of a sequence in order: what is wrong with the files first, what needs them after.

A check that rests on what another found to be wrong is not made: with the unit of depth wrong,
boxes lifted by depth would only seem to be wrong, too.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup import claims, reading
from imodbatch.checkup.boxes import check_boxes, check_classes, read_entries
from imodbatch.checkup.cameras import (
    check_focal,
    check_registration,
    square_candidates,
    unsquare_finding,
)
from imodbatch.checkup.depth_values import check_depth_values, median_depth_m
from imodbatch.checkup.edges import fit_edges
from imodbatch.checkup.files import check_files
from imodbatch.checkup.finding import Outcome, failed, skipped
from imodbatch.checkup.focal import camera_costs, fit_focal
from imodbatch.checkup.lifted import box_frames, check_lifted
from imodbatch.checkup.motions import Motions, measure
from imodbatch.checkup.subject import Subject
from imodbatch.checkup.trajectory import check_poses, check_stamps
from imodbatch.checkup.upright import check_up
from imodbatch.checkup.views import Sample, View, draw, evenly, reader
from imodbatch.core.depth import DepthImage
from imodbatch.core.errors import ImodError
from imodbatch.datasets.annotations.entries import Entry
from imodbatch.poses.rgbd.motion import motion_between
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import AnnotationsSection

Progress = Callable[[Iterable[Any], str], Iterable[Any]]
N_FRAMES = 40
MOST_EDGE_VIEWS = 16
BEFORE_UP = ("image_size", "units", "poses", "pose_convention")
UNTIL = "not judged until the errors above are mended"


@dataclass(frozen=True)
class Examined:
    """The outcomes of one sequence, the frames they rest on, and its annotated names."""

    sequence_id: str
    outcomes: tuple[Outcome, ...]
    n_frames: int = 0
    names: Counter[str] | None = None


def examine(
    manifest: Manifest,
    sequences: Iterable[SequenceSection],
    n_frames: int = N_FRAMES,
    progress: Progress = lambda items, _: items,
) -> list[Examined]:
    """Every check of the sequences, and at last those of all of them together.

    Args:
        manifest: the split.
        sequences: those of its sequences to look at.
        n_frames: how many frames of each to sample.
        progress: wraps what is gone through, with a name for it.
    """
    chosen = list(sequences)
    examined = [_examine(manifest, sequence, n_frames, progress) for sequence in chosen]
    names = [e.names for e in examined if e.names is not None]
    if len(names) == len(manifest.sequences) and any(names):
        outcome = check_classes(manifest.classes, sum(names, Counter[str]()))
        examined.append(Examined("all sequences", (outcome,)))
    return examined


def _examine(
    manifest: Manifest, sequence: SequenceSection, n_frames: int, progress: Progress
) -> Examined:
    try:
        subject = Subject.of(manifest, sequence)
    except ImodError as error:
        return _only_error(sequence, str(error))
    if not subject.files:
        folder = manifest.root_path / sequence.path
        return _only_error(
            sequence,
            f"{folder}: no frame. Check root, sequences.path, sequences.frames and the file names "
            f"that the adapter {manifest.adapter!r} expects.",
        )
    outcomes = list(check_files(subject, lambda items: progress(items, "headers")))
    read = reader(manifest, subject.files, subject.cameras)
    sample = draw(len(subject.files), n_frames, read, lambda items: progress(items, "frames"))
    views = list(sample.views.values())
    outcomes += [check_depth_values(subject.cameras, views), check_stamps(subject)]
    outcomes.append(check_poses(subject, lambda a, b: _motion(read, subject, a, b)))
    motions = measure(sample, subject.cameras.color)
    verdict = _verdict(subject, motions)
    outcomes += _of_poses(subject, motions, verdict, views)
    outcomes += _of_cameras(subject, motions, verdict, sample)
    has_size = not any(o.has_error for o in outcomes if o.check == "image_size")
    entries = read_entries(subject)
    outcomes.append(check_boxes(subject, entries) if has_size else _until("boxes"))
    is_sound = not any(outcome.has_error for outcome in outcomes if outcome.check != "files")
    outcomes.append(
        _boxes_in_world(subject, entries, read) if is_sound else _until("boxes_in_world")
    )
    outcomes.append(_up(subject, views, outcomes))
    names = _names(entries, subject.manifest.annotations)
    return Examined(sequence.id, tuple(outcomes), len(views), names)


def _only_error(sequence: SequenceSection, message: str) -> Examined:
    return Examined(sequence.id, (failed("files", message),))


def _until(check: str) -> Outcome:
    return skipped(check, UNTIL)


def _verdict(subject: Subject, motions: Motions) -> claims.Verdict | None:
    poses, section = subject.world_from_cam, subject.odometry_section
    if poses is None:
        return None
    convention = "world_from_cam" if section is None else section.convention
    return claims.judge(motions, poses, convention, reading.order_of(section))


def _of_poses(
    subject: Subject, motions: Motions, verdict: claims.Verdict | None, views: list[View]
) -> list[Outcome]:
    depth_m = median_depth_m(views)
    units = (
        reading.check_units(subject, verdict, depth_m)
        if np.isfinite(depth_m)
        else skipped("units", "no frame with readable depth")
    )
    if verdict is not None:
        convention = reading.check_convention(subject, verdict, motions)
        return [units, convention, reading.check_timing(subject, verdict)]
    why = (
        "no poses to hold against the images"
        if subject.world_from_cam is None
        else f"{len(motions)} of the sampled pairs of views tell a motion"
    )
    return [units, skipped("pose_convention", why), skipped("pose_timing", why)]


def _of_cameras(
    subject: Subject, motions: Motions, verdict: claims.Verdict | None, sample: Sample
) -> list[Outcome]:
    model, views = subject.cameras, list(sample.views.values())
    b_from_a = None if verdict is None else verdict.best.b_from_a
    candidates = square_candidates(model.color)
    if candidates:
        costs: dict[str, float] = {}
        as_given = 0.0
        if len(motions):
            cameras = [model.color, *candidates.values()]
            as_given, *others = camera_costs(motions, b_from_a, cameras)
            costs = dict(zip(candidates, others, strict=True))
        unsquare = unsquare_finding(model.color, costs, as_given)
        return [_until("registration"), check_focal(model, None, None, unsquare)]
    edges = fit_edges(evenly(views, MOST_EDGE_VIEWS))
    focal = fit_focal(motions, b_from_a)
    return [check_registration(model, edges, focal), check_focal(model, edges, focal, None)]


def _boxes_in_world(
    subject: Subject, entries: list[Entry] | ImodError, read: Callable[[int], View | None]
) -> Outcome:
    poses = subject.world_from_cam
    if subject.manifest.annotations.format == "none" or isinstance(entries, ImodError):
        return skipped("boxes_in_world", "no annotations")
    if poses is None:
        return skipped("boxes_in_world", "no poses")

    def depth(position: int) -> DepthImage | None:
        view = read(position)
        return None if view is None else view.registered_m

    position_of = {file.frame_index: i for i, file in enumerate(subject.files)}
    return check_lifted(box_frames(entries, position_of, poses, depth), subject.cameras.color)


def _up(subject: Subject, views: list[View], outcomes: list[Outcome]) -> Outcome:
    poses = subject.world_from_cam
    if poses is None:
        return skipped("up", "no poses")
    if any(o.has_error for o in outcomes if o.check in BEFORE_UP):
        return _until("up")
    return check_up(subject.manifest.world, views, poses, subject.sequence.id)


def _motion(
    read: Callable[[int], View | None], subject: Subject, a: int, b: int
) -> NDArray[np.float64] | None:
    """b_from_a (4, 4) of two frames by their images."""
    first, second = read(a), read(b)
    if first is None or second is None:
        return None
    found = motion_between(first.features, second.features, subject.cameras.color)
    return None if found is None else found.b_from_a


def _names(entries: list[Entry] | ImodError, section: AnnotationsSection) -> Counter[str] | None:
    """Boxes by class; None = there are no annotations to read."""
    if section.format == "none" or isinstance(entries, ImodError):
        return None
    own = [e.class_name for e in entries if e.frame_index is not None and not e.left_out]
    return Counter(section.rename.get(name, name) for name in own)
