"""The rooms of the package and the arrows between them, read off its imports.

    python tests/benchmarks/rooms.py

A line per room, with its lines of Python and the rooms it imports; then the sums, and the lines of
the pipeline, which is all but the lab.
"""

import ast
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
FACE = "imodbatch"


def room(module: str) -> str:
    """The folder of the package that a module lies in; the package's own file is its face."""
    return [*module.split("."), FACE][1]


def imported(text: str) -> set[str]:
    """Names of the package that a file imports, wherever the import stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.split(".")[0] == FACE}


def main() -> None:
    """Print rooms, arrows and lines."""
    lines: Counter[str] = Counter()
    arrows: defaultdict[str, set[str]] = defaultdict(set)
    folders = {path.name for path in (ROOT / FACE).iterdir() if path.is_dir()}
    for path in sorted((ROOT / FACE).rglob("*.py")):
        here = room(".".join(path.relative_to(ROOT).parts[:-1]))
        text = path.read_text(encoding="utf-8")
        lines[here] += text.count("\n")
        targets = {room(name) for name in imported(text)}
        arrows[here] |= {t if t in folders else FACE for t in targets} - {here}
    for name, count in lines.most_common():
        print(f"{count:7,} {name:10} → {', '.join(sorted(arrows[name]))}")
    print(f"{len(lines)} rooms, {sum(map(len, arrows.values()))} arrows")
    n_all, n_lab = lines.total(), lines["lab"]
    print(f"{n_all:,} lines = {n_all - n_lab:,} pipeline + {n_lab:,} lab")


if __name__ == "__main__":
    main()
