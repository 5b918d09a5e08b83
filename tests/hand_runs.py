"""Finished runs made by hand, in memory: what a comparison reads of a run folder."""

from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
from hand_tables import table

from imodbatch.reporting.results import Results
from imodbatch.reporting.run_folder import DetectorGrid, FinishedRun


@dataclass(frozen=True, eq=False)
class HandRun(FinishedRun):
    """A run whose detections are given, not read."""

    of_sequence: dict[str, pa.Table] = field(default_factory=dict)

    def detections(self, sequence_id):
        return self.of_sequence[sequence_id]


def hand_run(name, grid, classes, annotations, matches, detections=(), sequence_ids=("s", "t")):
    """A run with rows of annotations, matches and detections; `grid` is (elevations, azimuths)."""
    tables = {
        "annotations": table("annotations", annotations),
        "matches": table("matches", matches),
        "metrics": table("metrics", []),
    }
    of_sequence = {
        s: table("detections", [row for row in detections if row["sequence_id"] == s])
        for s in sequence_ids
    }
    results = Results(tables, sequence_ids)
    return HandRun(Path(name), classes, DetectorGrid(*grid), 0.01, results, of_sequence)
