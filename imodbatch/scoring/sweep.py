"""sweep: how much the voxel size matters; a part of diagnose, which feeds back into no result."""

from dataclasses import replace

from imodbatch.scoring.rescoring import METRIC, Evidence
from imodbatch.tables.columns import Progress, StageResult
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import SWEEPS


def run(evidence: Evidence, progress: Progress[float] = iter) -> StageResult:
    """Mean AP of every method at every voxel size asked, fused again from the places of `lift`."""
    sizes_m = evidence.pipeline.sweep.voxel_sizes_m
    rows = []
    for size_m in progress(sizes_m):
        meeting = replace(evidence.own_meeting, voxel=evidence.voxel_numbers(size_m))
        values = evidence.mean_average_precisions(meeting)
        rows += [
            {"method": method, "voxel_mm": round(1000 * size_m), "metric": METRIC, "value": value}
            for method, value in values.items()
        ]
    summary = f"{len(rows)} APs at {len(sizes_m)} voxel sizes"
    return StageResult({"sweeps": from_rows(SWEEPS, rows)}, summary)
