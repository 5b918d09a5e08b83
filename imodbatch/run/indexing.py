"""The index of a sequence as a step: which files and settings it depends on."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imodbatch.datasets import index
from imodbatch.datasets.annotations import annotation_files
from imodbatch.datasets.registry import annotated, layout_of
from imodbatch.run.plan import Plan
from imodbatch.run.step import Tables, dump, sections
from imodbatch.tables.columns import Progress, StageResult


def index_step(part: Plan, tables: Tables, progress: Progress[Any]) -> StageResult:
    """Frames and annotations of a sequence."""
    del tables
    return index.run(part.manifest, part.sequence, progress)


def index_files(part: Plan) -> Iterable[Path]:
    """Images, and whatever else the dataset says of them."""
    manifest, sequence = part.manifest, part.sequence
    return [
        *index.image_files(manifest, sequence),
        *layout_of(manifest).other_files(manifest, sequence),
        *annotation_files(annotated(manifest, sequence), sequence),
    ]


def index_settings(part: Plan) -> dict[str, Any]:
    """What the manifest says of files, classes and cameras."""
    names = ("@adapter", "@root", "@classes", "@camera", "@images", "@annotations")
    return {**sections(*names)(part), "sequence": dump(part.sequence)}
