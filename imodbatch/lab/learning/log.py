"""The record of a training: losses as CSV, events as JSON lines, curves and confusions as SVG."""

import csv
import json
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from imodbatch.lab.learning.losses import LOSS_NAMES
from imodbatch.lab.learning.validation import Validation
from imodbatch.tables.atomic import write_bytes, write_text

TIME_NAMES = ("data", "forward", "backward")
COLUMNS = (
    "step",
    "phase",
    "learning_rate",
    *(f"{name}_loss" for name in LOSS_NAMES),
    *(f"{name}_s_per_image" for name in TIME_NAMES),
)


class TrainingLog:
    """Writes ``log.csv`` and ``events.jsonl`` in the folder of a training."""

    def __init__(self, folder: Path, step: int) -> None:
        """Open the record; what it says of later steps than `step` is taken out, to be redone."""
        self._csv, self._events = folder / "log.csv", folder / "events.jsonl"
        rows = [row for row in read_rows(self._csv) if int(row["step"]) <= step]
        kept = StringIO(newline="")
        writer = csv.DictWriter(kept, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
        write_text(self._csv, kept.getvalue())
        events = [event for event in read_events(self._events) if event["step"] <= step]
        lines = [json.dumps(event) + "\n" for event in events]
        write_text(self._events, "".join(lines))

    def add_row(self, row: dict[str, Any]) -> None:
        """Add one row of means over the last steps."""
        with self._csv.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, COLUMNS, restval="").writerow(row)

    def add_event(self, step: int, kind: str, **content: Any) -> None:
        """Add one event: started, resumed, validated, stopped, done."""
        with self._events.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"step": step, "event": kind, **content}) + "\n")

    def plot(self) -> None:
        """Draw ``curves.svg`` from the rows and events so far."""
        rows, events = read_rows(self._csv), read_events(self._events)
        figure = Figure(figsize=(9, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        for name in LOSS_NAMES:
            points = [(int(r["step"]), float(r[f"{name}_loss"])) for r in rows if r[f"{name}_loss"]]
            left.plot([p[0] for p in points], [p[1] for p in points], label=name, linewidth=1)
        left.set(xlabel="step", ylabel="loss")
        validations = [event for event in events if event["event"] == "validated"]
        for key in ("mean_ap_voc07_11pt", "azimuth_exact", "azimuth_within_1_bin"):
            known = [(e["step"], e["figures"][key]) for e in validations]
            known = [point for point in known if point[1] is not None]
            right.plot([p[0] for p in known], [p[1] for p in known], marker=".", label=key)
        right.set(xlabel="step", ylim=(0, 1))
        left.legend(fontsize=7)
        right.legend(fontsize=7)
        _save(figure, self._csv.with_name("curves.svg"))


def write_confusions(validation: Validation, folder: Path) -> None:
    """Write the azimuth confusions of all classes as ``azimuth_confusion.csv`` and as ``.svg``."""
    confusion = validation.azimuth_confusion
    table = StringIO(newline="")
    writer = csv.writer(table)
    writer.writerow(("class", "true_bin", "named_bin", "n_boxes"))
    for k, true, named in np.argwhere(confusion > 0):
        writer.writerow((validation.classes[k], true, named, confusion[k, true, named]))
    write_text(folder / "azimuth_confusion.csv", table.getvalue())
    shown = [k for k in range(len(validation.classes)) if confusion[k].any()]
    figure = Figure(figsize=(2.0 * min(len(shown) + 1, 6), 2.2 * (len(shown) // 6 + 1)))
    panels = [("all", confusion.sum(axis=0))]
    panels += [(validation.classes[k], confusion[k]) for k in shown]
    grid = figure.subplots(len(shown) // 6 + 1, min(len(shown) + 1, 6), squeeze=False).ravel()
    for axes in grid:
        axes.axis("off")
    for axes, (name, counts) in zip(grid, panels, strict=False):
        share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        axes.imshow(share, vmin=0, vmax=1, cmap="Blues")
        axes.set_title(name, fontsize=7)
    figure.suptitle("azimuth bins: true (down) by named (across)", fontsize=8)
    _save(figure, folder / "azimuth_confusion.svg")


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of ``log.csv``; none if it is not there. A torn last row is left out."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if None not in row.values()]


def read_events(path: Path) -> list[dict[str, Any]]:
    """Events of ``events.jsonl``; none if it is not there. A torn last line is left out."""
    if not path.is_file():
        return []
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return [json.loads(line) for line in lines]


def _save(figure: Figure, path: Path) -> None:
    drawn = BytesIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None})
    write_bytes(path, drawn.getvalue())
