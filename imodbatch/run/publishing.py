"""From a finished run to its report: gathers what stands in no table and calls the report stage."""

import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from imodbatch.core.version import __version__
from imodbatch.reporting import report
from imodbatch.reporting.run_info import RunInfo
from imodbatch.run.plan import Plan
from imodbatch.run.states import states
from imodbatch.run.steps import STEPS, stages_of
from imodbatch.run.stored import load
from imodbatch.tables.schemas import TABLES

REPORT_FOLDER = "report"
PACKAGES = ("numpy", "pandas", "pyarrow", "torch", "torchvision", "open3d", "faster-coco-eval")
HEAVY_COLUMNS = {"view_scores"}


def write_report(plan: Plan) -> Path:
    """Write the report of a run and return its path.

    Raises:
        TableError: a stage has not run yet.
    """
    stages = stages_of(plan)
    shown = {name for step in STEPS if step.stage in stages for name in step.writes}
    tables = {
        name: load(plan, name, [n for n in spec.schema.names if n not in HEAVY_COLUMNS])
        for name, spec in TABLES.items()
        if name in shown
    }
    manifest, pipeline = plan.manifest, plan.pipeline
    info = RunInfo(
        title=manifest.name,
        description=manifest.description,
        pipeline_name=plan.pipeline_name,
        classes=manifest.classes,
        versions=_versions(),
        settings=pipeline.model_dump(mode="json"),
        summaries=tuple(
            (outcome.title, outcome.label, outcome.message) for outcome in states(plan)
        ),
        created=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )
    out_dir = plan.run_dir / REPORT_FOLDER
    return report.run(info, tables, plan.read_color, pipeline.report, out_dir)


def _versions() -> dict[str, str]:
    found = {"imodbatch": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
