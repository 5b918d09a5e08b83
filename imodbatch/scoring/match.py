"""match: the fused boxes of one sequence held against its annotations → what became of each."""

from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from imodbatch.core.matching import OUTCOME_NAMES
from imodbatch.core.scoring import match_all
from imodbatch.settings.config import MatchingConfig
from imodbatch.tables.columns import StageResult, candidates_of, column, tally, truth_of
from imodbatch.tables.parquet import empty, from_columns
from imodbatch.tables.schemas import FUSED, MATCHES


def run(
    fused: pa.Table, detections: pa.Table, annotations: pa.Table, config: MatchingConfig
) -> StageResult:
    """Match the boxes of one sequence under every method and IoU."""
    truth = truth_of(annotations, column(annotations, "frame_index"))
    own_index = column(annotations, "annotation_index")
    parts = []
    for name in pc.unique(fused["method"]).to_pylist():
        rows = fused.filter(pc.equal(fused["method"], name))
        candidates = candidates_of(rows, detections, column(rows, "frame_index"))
        scores = column(rows, "score").astype(np.float64)
        for iou_percent in config.iou_percents:
            found = match_all(candidates, scores, truth, iou_percent / 100, config.rule)
            hit = found.annotation_index >= 0
            index = np.zeros(len(hit), dtype=np.int64)
            index[hit] = own_index[found.annotation_index[hit]]
            columns = {
                **{key: rows[key] for key in FUSED.key},
                "iou_percent": [iou_percent] * len(hit),
                "score": rows["score"],
                "outcome": np.array(OUTCOME_NAMES)[found.outcome].tolist(),
                "annotation_index": pa.array(index, mask=~hit),
                "iou": pa.array(found.iou, mask=np.isnan(found.iou)),
            }
            parts.append(from_columns(MATCHES, columns))
    table = pa.concat_tables(parts) if parts else empty(MATCHES)
    found_of = Counter(table["outcome"].to_pylist())
    counts = {name: found_of[name] for name in OUTCOME_NAMES}
    return StageResult({"matches": table}, tally(table.num_rows, "matches", counts))
