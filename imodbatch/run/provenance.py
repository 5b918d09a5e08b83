"""What a table depends on: the same as when it was made, and it is up to date.

A table's provenance names everything its content depends on: package and schema versions, the
settings of its step, the identity of its input tables, and the files outside. Where the provenance
on disk equals the one expected, nothing is done; else the step is done again and its tables
replaced. Whatever reads them then differs in its own provenance, and so on down the pipeline.
"""

from typing import Any

from imodbatch.core.version import __version__
from imodbatch.run.plan import Plan
from imodbatch.run.step import Step
from imodbatch.run.stored import Identities, input_identities, output_paths
from imodbatch.tables.parquet import digest, read_info
from imodbatch.tables.schemas import TABLES


def is_up_to_date(part: Plan, step: Step) -> bool:
    """Whether all tables of a step are there, and of the provenance expected.

    Raises:
        TableError: a table is there, and one that it was made from is not.
    """
    infos = [read_info(path) for path in output_paths(part, step)]
    if any(info is None for info in infos):
        return False
    inputs, files = input_identities(part, step), files_digest(part, step)
    expected = digest(provenance(part, step, inputs, files))
    return all(
        info is not None
        and info.version == TABLES[name].version
        and digest(info.provenance) == expected
        for name, info in zip(step.writes, infos, strict=True)
    )


def provenance(part: Plan, step: Step, inputs: Identities, files: str) -> dict[str, Any]:
    """Everything that the tables of a step depend on.

    Args:
        part: what it is done for.
        step: of the run.
        inputs: identities of the tables it reads.
        files: digest of the files outside that it reads.
    """
    return {
        "imodbatch": __version__,
        "stage": step.stage,
        "settings": step.depends_on(part),
        "inputs": inputs,
        "files": files,
    }


def files_digest(part: Plan, step: Step) -> str:
    """Digest of paths, sizes and modification times; a missing file is a state of its own."""
    root = part.manifest.root_path
    facts: list[tuple[str, int, int]] = []
    for path in step.files(part):
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else str(path)
        try:
            stat = path.stat()
            facts.append((name, stat.st_size, stat.st_mtime_ns))
        except OSError:
            facts.append((name, -1, -1))
    return digest(sorted(facts))
