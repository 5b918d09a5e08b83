"""The score tables: AP per class and method, and precision/recall at the tuned thresholds."""

from collections.abc import Iterable, Sequence

from imodbatch.reporting.csv_text import to_csv
from imodbatch.reporting.grids import Cell, Column, Grid, Row, marked_best, method_columns
from imodbatch.reporting.names import AP_METRICS, number, percent, plural
from imodbatch.reporting.paper import MARK, PaperColumn
from imodbatch.reporting.results import Results
from imodbatch.tables.schemas import BACKGROUND_CLASS_ID, MEAN_CLASS_ID, SEVERAL_IOUS

HEADLINE, MEAN = "ap_voc07_11pt", "mean"


def class_rows(classes: Sequence[str], with_background: bool = False) -> list[tuple[int, str]]:
    """Id and name of every row of a table: the classes, the background if asked for, the mean."""
    background = [(BACKGROUND_CLASS_ID, "background")] if with_background else []
    return [*enumerate(classes), *background, (MEAN_CLASS_ID, MEAN)]


def ap_metrics(results: Results) -> list[tuple[str, int]]:
    """Every AP metric and IoU that the metrics hold, the headline first."""
    main, *others = results.iou_percents
    order = [(m, main) for m in AP_METRICS] + [(m, SEVERAL_IOUS) for m in AP_METRICS]
    order += [(m, iou) for iou in others for m in AP_METRICS]
    return [(metric, iou) for metric, iou in order if results.has(metric, iou)]


def ap_title(metric: str, iou_percent: int) -> str:
    """What the metric is, in words."""
    limit = "" if iou_percent == SEVERAL_IOUS else f", IoU ≥ {iou_percent / 100:.2f}"
    return AP_METRICS[metric] + limit


def ap_grid(
    results: Results,
    classes: Sequence[str],
    metric: str,
    iou_percent: int,
    paper: Sequence[PaperColumn] = (),
) -> Grid:
    """AP per class and method, the best of each row marked.

    The headline also counts annotations, and the false positives of classes that have none, and
    the paper's columns stand beside it.
    """
    is_headline = metric == HEADLINE and iou_percent == results.main_iou
    paper = [c for c in paper if is_headline and any(v is not None for v in c.ap.values())]
    rows = []
    for class_id, name in class_rows(classes):
        n_annotations = _n_annotations(results, class_id, len(classes))
        values = [results.value(m, class_id, metric, iou_percent) for m in results.methods]
        notes = [""] * len(values)
        if is_headline and n_annotations == 0 and class_id != MEAN_CLASS_ID:
            notes = [_false_positives(results, m, class_id) for m in results.methods]
        cells = [Cell(f"{n_annotations:,}")] if is_headline else []
        cells += marked_best(values, notes)
        cells += [Cell(number(column.ap.get(name))) for column in paper]
        rows.append(Row(name, tuple(cells), class_id == MEAN_CLASS_ID))
    columns = (
        *([Column("annotations")] if is_headline else []),
        *method_columns(results.methods),
        *map(paper_head, paper),
    )
    title = ap_title(metric, iou_percent)
    return Grid(f"{metric}-{iou_percent}", title, "class", columns, tuple(rows))


def ap_csv(results: Results, classes: Sequence[str]) -> str:
    """All AP figures in full precision; empty = no AP."""
    head = ["metric", "iou_percent", "class_id", "class_name", "n_annotations", *results.methods]
    rows = [
        [
            *(metric, iou, class_id, name, _n_annotations(results, class_id, len(classes))),
            *(results.value(m, class_id, metric, iou) for m in results.methods),
        ]
        for metric, iou in ap_metrics(results)
        for class_id, name in class_rows(classes)
    ]
    return to_csv(head, rows)


def precision_recall_grid(results: Results, classes: Sequence[str]) -> Grid:
    """Table 2's layout: precision/recall (AP) in percent, with the threshold it was read at."""
    rows = [
        Row(
            name,
            tuple(_triple(results, method, class_id) for method in results.methods),
            class_id == MEAN_CLASS_ID,
        )
        for class_id, name in class_rows(classes, with_background=True)
    ]
    title = f"Precision/recall in percent (AP), IoU ≥ {results.main_iou / 100:.2f}"
    return Grid("precision-recall", title, "class", method_columns(results.methods), tuple(rows))


def paper_precision_recall_grid(
    classes: Sequence[str], paper: Sequence[PaperColumn]
) -> Grid | None:
    """The paper's columns in the same rows; None if it has none."""
    columns = [column for column in paper if column.precision_recall]
    if not columns:
        return None
    names = [name for _, name in class_rows(classes, with_background=True)]
    title = "The same in the paper's Table 2, on other data"
    return paper_grid("precision-recall-paper", title, names, columns)


def paper_grid(name: str, title: str, rows: Iterable[str], columns: Sequence[PaperColumn]) -> Grid:
    """Columns of the paper's Table 2 as printed, a row per name."""
    cells = {row: tuple(paper_cell(column, row) for column in columns) for row in rows}
    grid_rows = tuple(Row(row, found, row == MEAN) for row, found in cells.items())
    return Grid(name, title, "class", tuple(map(paper_head, columns)), grid_rows)


def paper_head(column: PaperColumn) -> Column:
    """The heading of a column of the paper, marked as such."""
    return Column(column.name, f"{MARK}, {column.group}")


def paper_cell(column: PaperColumn, name: str) -> Cell:
    """Precision/recall (AP) of a row as the paper prints it; a dash where it has no such row."""
    pair = column.precision_recall.get(name)
    if pair is None:
        return Cell(number(None))
    precision, recall = (f"{value:.2f}".removesuffix("0") for value in pair)  # as printed
    return Cell(f"{precision}/{recall} ({number(column.ap.get(name))})")


def triple(precision: float | None, recall: float | None, ap: float | None) -> str:
    """Precision/recall in percent, and AP."""
    return f"{percent(precision)}/{percent(recall)} ({number(ap)})"


def precision_recall_csv(results: Results, classes: Sequence[str]) -> str:
    """The same figures in full precision, four columns per method; empty = unknown."""
    metrics = ("precision", "recall", HEADLINE, "threshold")
    head = ["class_id", "class_name", "iou_percent"]
    head += [f"{method}_{metric}" for method in results.methods for metric in metrics]
    rows = [
        [
            *(class_id, name, results.main_iou),
            *(results.value(m, class_id, metric) for m in results.methods for metric in metrics),
        ]
        for class_id, name in class_rows(classes, with_background=True)
    ]
    return to_csv(head, rows)


def _n_annotations(results: Results, class_id: int, n_classes: int) -> int:
    if class_id == MEAN_CLASS_ID:
        return sum(results.n_evaluated(i) for i in range(n_classes))
    return results.n_evaluated(class_id)


def _false_positives(results: Results, method: str, class_id: int) -> str:
    return plural(results.n_false_positives(method, class_id), "false positive")


def _triple(results: Results, method: str, class_id: int) -> Cell:
    precision, recall, ap, threshold = (
        results.value(method, class_id, metric)
        for metric in ("precision", "recall", HEADLINE, "threshold")
    )
    has_limit = threshold is not None and class_id != MEAN_CLASS_ID
    return Cell(triple(precision, recall, ap), f"≥ {number(threshold, 2)}" if has_limit else "")
