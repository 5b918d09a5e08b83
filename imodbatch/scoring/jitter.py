"""jitter: how fast AP falls when the poses get worse; a part of diagnose that is off by default.

Each frame's camera is shifted and turned as `core.disturbance` says; the boxes it placed go along,
fall in other voxels and bins, are fused again by the run's own rules and scored. Shifts and turns
are swept each alone, and together in pairs of equal rank. Each sequence, kind and repeat has noise
of its own, drawn from a fixed seed and only scaled by the level, so that levels are comparable and
results repeat.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from zlib import crc32

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.disturbance import KINDS, Kind, carried_along, unit_noise
from imodbatch.core.placing import place
from imodbatch.fusion.evidence import places_of
from imodbatch.scoring.rescoring import METRIC, Evidence, Meeting, camera_centers
from imodbatch.settings.config import JitterConfig
from imodbatch.tables.columns import Progress, StageResult, column
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import JITTERS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Level:
    """How wrong poses are: RMS of the shift, and of the angle of the turn."""

    translation_mm: int
    rotation_mdeg: int

    @property
    def shift_m(self) -> float:
        """RMS length of a camera's shift."""
        return self.translation_mm / 1000

    @property
    def turn_rad(self) -> float:
        """RMS angle of a camera's turn."""
        return float(np.radians(self.rotation_mdeg / 1000))


UNDISTURBED = Level(0, 0)


def levels(config: JitterConfig) -> tuple[Level, ...]:
    """None at all, shifts, turns, and pairs of equal rank; empty if nothing is asked."""
    shifts = [Level(round(1000 * shift_m), 0) for shift_m in config.shifts_m]
    turns = [Level(0, round(1000 * turn_deg)) for turn_deg in config.turns_deg]
    pairs = [
        Level(shift.translation_mm, turn.rotation_mdeg)
        for shift, turn in zip(shifts, turns, strict=False)
    ]
    asked = [*shifts, *turns, *pairs]
    return tuple(dict.fromkeys([UNDISTURBED, *asked])) if asked else ()


def run(evidence: Evidence, poses: pa.Table, progress: Progress[Any] = iter) -> StageResult:
    """Mean AP of every method at every level and kind of disturbance.

    Args:
        evidence: all boxes of the run.
        poses: poses table of all its sequences.
        progress: wraps the loop over trials.
    """
    config = evidence.pipeline.jitter
    if not levels(config):
        return StageResult({"jitters": from_rows(JITTERS, [])}, "no disturbance of poses asked")
    disturbed = Disturbed(evidence, camera_centers(evidence.frames, poses))
    values: dict[tuple[str, Kind, Level], list[float | None]] = {}
    for kind, level, repeat in progress(list(_trials(config))):
        meeting = disturbed.meeting(level, kind, repeat)
        for method, value in evidence.mean_average_precisions(meeting).items():
            values.setdefault((method, kind, level), []).append(value)
    rows = [_row(*key, found) for key, found in values.items()]
    summary = f"{len(rows)} APs at {len(levels(config))} levels of {' and '.join(KINDS)}"
    return StageResult({"jitters": from_rows(JITTERS, rows)}, summary)


def _trials(config: JitterConfig) -> Iterator[tuple[Kind, Level, int]]:
    """Kind, level and repeat; without disturbance all repeats would be the same."""
    for kind in KINDS:
        for level in levels(config):
            n_repeats = 1 if level == UNDISTURBED else config.repeats
            for repeat in range(n_repeats):
                yield kind, level, repeat


def _row(method: str, kind: Kind, level: Level, found: list[float | None]) -> dict[str, Any]:
    known = [value for value in found if value is not None]
    return {
        "method": method,
        "kind": kind,
        "translation_mm": level.translation_mm,
        "rotation_mdeg": level.rotation_mdeg,
        "metric": METRIC,
        "value": float(np.mean(known)) if known else None,
        "spread": float(np.std(known, ddof=1)) if len(known) > 1 else None,
        "n_repeats": len(found),
    }


@dataclass(frozen=True)
class Disturbed:
    """All boxes of a run, and the undisturbed camera centres (F, 3) by image number."""

    evidence: Evidence
    camera_world: Array

    @cached_property
    def rows(self) -> Ints:
        """(P,) the boxes that have a place; one too steep for fusion may not stay so."""
        observations = self.evidence.observations
        status = column(observations, "status").astype(str)
        near = column(observations, "depth_m") <= self.evidence.pipeline.lift.max_depth_m
        return np.flatnonzero(np.isin(status, ("placed", "out_of_range")) & near)

    @cached_property
    def xyz_world(self) -> Array:
        """(P, 3) their undisturbed places."""
        return places_of(self.evidence.observations)[self.rows]

    @cached_property
    def sequence_id(self) -> NDArray[np.str_]:
        """(F,) by image number."""
        return column(self.evidence.frames, "sequence_id").astype(str)

    def meeting(self, level: Level, kind: Kind, repeat: int) -> Meeting:
        """Place the boxes as `lift` does, by cameras that are shifted and turned."""
        image = self.evidence.image[self.rows]
        shift, turn = self.unit_noise(kind, repeat)[:, image]
        shift_m, turn_rad = level.shift_m * shift, level.turn_rad * turn
        camera_world = self.camera_world[image]
        xyz_world = carried_along(self.xyz_world, camera_world, shift_m, turn_rad)
        viewpoint, lift = self.evidence.pipeline.viewpoint, self.evidence.pipeline.lift
        places = place(xyz_world, camera_world + shift_m, viewpoint.grid(), lift.voxel_size_m)
        inside = ~places.is_too_steep(viewpoint.elevation_margin_deg)
        rows = self.rows[inside]
        return Meeting(
            rows,
            self.evidence.number_voxels(rows, places.voxel[inside]),
            places.azimuth_bin[inside],
            places.elevation_bin[inside],
        )

    def unit_noise(self, kind: Kind, repeat: int) -> Array:
        """Noise (2, F, 3) of level 1 by image number: of shifts, and of turns."""
        noise = np.empty((2, len(self.sequence_id), 3))
        for name in np.unique(self.sequence_id):
            rng = np.random.default_rng([crc32(name.encode()), KINDS.index(kind), repeat])
            images = np.flatnonzero(self.sequence_id == name)
            noise[:, images] = [unit_noise(len(images), kind, rng) for _ in range(2)]
        return noise
