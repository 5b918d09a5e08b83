"""True boxes on paper: do they lie in their images, and have they a size?

Four numbers can be corners, or a corner and a size. Read the wrong way, many boxes stick out of
their image or have no area; the reading under which nearly all are sound is the right one.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, failed, setting, skipped
from imodbatch.checkup.subject import Subject
from imodbatch.core.errors import ImodError
from imodbatch.datasets.annotations import read_entries as annotated_boxes
from imodbatch.datasets.annotations.entries import Entry
from imodbatch.datasets.base import Footage
from imodbatch.settings.toml import did_you_mean

Array = NDArray[np.float64]
OUTSIDE_PX = 2.0
FEW_UNSOUND, MANY_UNSOUND = 0.01, 0.05
MUCH_SOUNDER = 0.3
"""Share of the unsound boxes that another reading may keep."""
FEWEST_AT_BORDER = 5
FEW_FRAMES = 0.1
"""Share of annotated frames below which the rest may just not have been looked at."""


def read_entries(subject: Subject) -> list[Entry] | ImodError:
    """The annotated boxes as the files have them; the error if they cannot be read."""
    size_px = subject.cameras.color.width_px, subject.cameras.color.height_px
    try:
        return list(
            annotated_boxes(Footage(subject.manifest, subject.sequence, subject.files, size_px))
        )
    except ImodError as error:
        return error


def check_boxes(subject: Subject, entries: list[Entry] | ImodError) -> Outcome:
    """The check `boxes`."""
    if subject.manifest.annotations.format == "none":
        return skipped("boxes", "no annotations")
    if isinstance(entries, ImodError):
        return failed("boxes", str(entries))
    own = [e for e in entries if e.frame_index is not None and not e.left_out]
    if not own:
        seen = (
            f"None of {len(entries)} annotations is of a frame of this sequence. Check "
            "annotations.path, the file names in it, and the sequence's frames."
        )
        return failed("boxes", seen)
    boxes = np.array([entry.box for entry in own], dtype=np.float64).reshape(-1, 4)
    findings = [
        *_unsound(boxes, subject, own),
        *_one_based(boxes, subject),
        *_unknown_classes(subject, own),
    ]
    n_frames = len({entry.frame_index for entry in own})
    if n_frames < FEW_FRAMES * len(subject.files):
        seen = (
            f"Only {n_frames} of {len(subject.files)} frames have annotations: boxes found in the "
            "others count as false. Narrow sequences.frames to the annotated ones."
        )
        findings.append(Finding(WARNING, seen, figures={"n_frames": n_frames}))
    summary = f"{len(own)} boxes in {n_frames} of {len(subject.files)} frames"
    return Outcome("boxes", summary, tuple(findings))


def is_sound(boxes: Array, width_px: float, height_px: float) -> NDArray[np.bool_]:
    """Which boxes (n, 4) have an area and stay within two pixels of the image."""
    with np.errstate(invalid="ignore"):
        has_area = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
        inside = (boxes[:, :2] >= -OUTSIDE_PX).all(axis=1)
        inside &= (boxes[:, 2:] <= np.array([width_px, height_px]) + OUTSIDE_PX).all(axis=1)
    return np.asarray(has_area & inside)


def other_readings(boxes: Array) -> dict[str, Array]:
    """What the boxes (n, 4) would be, had their numbers been meant otherwise."""
    corner, other = boxes[:, :2], boxes[:, 2:]
    return {
        "their last two numbers are width and height, read as a corner": np.hstack(
            [corner, corner + other]
        ),
        "their last two numbers are a corner, read as width and height": np.hstack(
            [corner, other - corner]
        ),
        "x and y are swapped": boxes[:, [1, 0, 3, 2]],
        "their first two numbers are the centre, read as a corner": np.hstack(
            [corner - (other - corner) / 2, other - (other - corner) / 2]
        ),
    }


def _unsound(boxes: Array, subject: Subject, own: Sequence[Entry]) -> list[Finding]:
    size = subject.cameras.color.width_px, subject.cameras.color.height_px
    sound = is_sound(boxes, *size)
    share = 1 - float(sound.mean())
    if share == 0:
        return []
    flat = (boxes[:, 2] <= boxes[:, 0]) | (boxes[:, 3] <= boxes[:, 1])
    first = own[int(np.argmin(sound))]
    seen = (
        f"{int((~sound).sum())} of {len(boxes)} boxes are unsound ({int(flat.sum())} without area, "
        f"{int((~sound & ~flat).sum())} beyond the image), such as {first.where}: "
        f"{[round(v, 1) for v in first.box]} (x0 y0 x1 y1)."
    )
    unsound = {
        name: 1 - float(is_sound(other, *size).mean())
        for name, other in other_readings(boxes).items()
    }
    name = min(unsound, key=lambda n: unsound[n])
    figures = {"unsound_share": share, "best_unsound_share": unsound[name]}
    if share > MANY_UNSOUND and unsound[name] <= MUCH_SOUNDER * share:
        seen += f" With another reading {100 * unsound[name]:.0f} % are: {name}. "
        seen += "Convert the file, or correct annotations.format."
        return [Finding(ERROR, seen, figures=figures)]
    if share <= FEW_UNSOUND and not flat.any():
        return []
    return [Finding(WARNING, seen, figures=figures)]


def _one_based(boxes: Array, subject: Subject) -> list[Finding]:
    """Boxes that touch the border at pixel 1 and never at 0, or at the width plus one."""
    width, height = subject.cameras.color.width_px, subject.cameras.color.height_px
    low, high = boxes[:, :2], boxes[:, 2:] - [width, height]
    starts_at_one = int((low == 1.0).sum()) >= FEWEST_AT_BORDER and not (low < 1.0).any()
    ends_beyond = int((high == 1.0).sum()) >= FEWEST_AT_BORDER and not (high > 1.0).any()
    ends_at_border = int((high == 0.0).sum()) >= FEWEST_AT_BORDER
    if not (ends_beyond or (starts_at_one and ends_at_border)):
        return []
    seen = (
        "Boxes at the image's border start at pixel 1 and never at 0"
        if starts_at_one
        else "Boxes at the image's border end one pixel beyond it"
    )
    seen += ": they seem to count pixels from 1. Subtract 1 from their first corner."
    return [Finding(WARNING, seen)]


def _unknown_classes(subject: Subject, own: Sequence[Entry]) -> list[Finding]:
    """Nothing left because no name in the file is a class of the manifest."""
    manifest = subject.manifest
    names = Counter(entry.class_name for entry in own)
    rename = manifest.annotations.rename
    if any(rename.get(name, name) in manifest.classes for name in names):
        return []
    name = names.most_common(1)[0][0]
    seen = (
        f"None of the annotated classes ({', '.join(sorted(names)[:6])}) is one of the manifest's "
        f"({', '.join(manifest.classes[:6])}).{did_you_mean(name, list(manifest.classes))}"
    )
    line = setting("annotations", "rename", {name: manifest.classes[0]})
    return [Finding(ERROR, seen, (line,) if len(manifest.classes) == 1 else ())]


def check_classes(classes: Sequence[str], counts: Counter[str]) -> Outcome:
    """The check `classes` of all sequences: which never occur.

    Args:
        classes: the manifest's.
        counts: boxes by class, of the annotations of all sequences.
    """
    absent = [name for name in classes if counts[name] == 0]
    summary = f"{len(classes) - len(absent)} of {len(classes)} classes are annotated"
    if not absent or len(absent) == len(classes):
        return Outcome("classes", summary)
    named_few = ", ".join(absent[:6]) + (", …" if len(absent) > 6 else "")
    seen = f"{len(absent)} of {len(classes)} classes are never annotated: {named_few}."
    return Outcome("classes", summary, (Finding(WARNING, seen, figures={"n": len(absent)}),))
