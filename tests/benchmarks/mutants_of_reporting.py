"""Mistakes to plant in the reports: (file, tests) → (old text, new text, what it breaks)."""

REPORTING = {
    ("imodbatch/reporting/scores.py", "tests/reporting/test_score_tables.py"): [
        (
            "{percent(precision)}/{percent(recall)}",
            "{percent(recall)}/{percent(precision)}",
            "recall before precision",
        ),
        (
            "*(results.value(m, class_id, metric) for m in results.methods for metric in metrics)",
            "*(results.value(m, class_id, metric) for metric in metrics for m in results.methods)",
            "figures under the wrong heading",
        ),
        (
            "return sum(results.n_evaluated(i)",
            "return max(results.n_evaluated(i)",
            "the largest class for all",
        ),
    ],
    ("imodbatch/reporting/grids.py", "tests/reporting/test_score_tables.py"): [
        ("number(max(known))", "number(min(known))", "the worst is marked"),
    ],
    ("imodbatch/reporting/names.py", "tests/reporting/test_score_tables.py"): [
        ("return method != base, order", "return method == base, order", "all frames first"),
    ],
    ("imodbatch/reporting/results.py", "tests/reporting/test_results_cases.py"): [
        (
            "order = rank(rows.score, rows.sequence",
            "order = rank(rows.score, -rows.sequence",
            "equal scores ranked backwards",
        ),
        (
            "key=lambda p: (p != USUAL_IOU_PERCENT, p)",
            "key=lambda p: p",
            "the smallest IoU is the main one",
        ),
        (
            "return max(counts) if counts",
            "return min(counts) if counts",
            "annotations of the test sequences only",
        ),
        ("matches.score >= limits[", "matches.score > limits[", "a box at the threshold is hidden"),
        (
            "Curve(recall[is_right], precision[is_right])",
            "Curve(precision[is_right], recall[is_right])",
            "axes of the curve swapped",
        ),
        (
            "(matches.class_id == class_id) & (matches.outcome != Outcome.IGNORED)",
            "matches.class_id == class_id",
            "ignored boxes lower the curve",
        ),
        (
            '== class_id)\n            & (pc.field("iou_percent") == self.main_iou)',
            "== class_id)",
            "false positives of all IoUs",
        ),
        (
            'pc.or_(table["is_ignored"], table["is_crowd"])',
            'pc.and_(table["is_ignored"], table["is_crowd"])',
            "ignored annotations count",
        ),
    ],
    ("imodbatch/reporting/results.py", "tests/reporting/test_camera_pose_tables.py"): [
        ('for name in ("tx_m", "ty_m")', 'for name in ("tx_m", "tz_m")', "paths from the side"),
    ],
    ("imodbatch/reporting/losses.py", "tests/reporting/test_losses_tables.py"): [
        (
            "(_loss(found.get((class_id, cause))) for cause in causes)",
            "(_loss(found.get((class_id, cause))) for cause in told)",
            "figures of other causes",
        ),
        (
            "sum(c.n for c in counts if (c.stage, c.status) == kind)",
            "sum(1 for c in counts if (c.stage, c.status) == kind)",
            "sequences for rows in the total",
        ),
    ],
    ("imodbatch/reporting/operating_points.py", "tests/reporting/test_table_2_cases.py"): [
        (
            "annotations.shape[1] == 1",
            "annotations.shape[0] == 1",
            "one class for one sequence",
        ),
        (
            "{ON_TEST: tune_thresholds, HELD_OUT: leave_one_out}",
            "{ON_TEST: leave_one_out, HELD_OUT: tune_thresholds}",
            "tunings swapped",
        ),
        (
            "MULTI if base == method else ALL_FRAMES",
            "ALL_FRAMES if base == method else MULTI",
            "online and offline mixed",
        ),
        (
            "n_annotations.sum(axis=1) - self.counts.n_annotations",
            "n_annotations.sum(axis=1) - self.counts.n_hits",
            "missed annotations for those left out",
        ),
        (
            "counts_at(boxes, annotations, thresholds)",
            "counts_at(boxes, annotations, tune_thresholds(boxes, annotations, step))",
            "what is held out is counted at thresholds of the test set",
        ),
        ("np.append(values, b)", "values", "means without the background"),
        (
            "_kept(matches, thresholds",
            "_kept(matches.take(matches.outcome != 2), thresholds",
            "ignored boxes hide nothing",
        ),
    ],
    (
        "imodbatch/reporting/comparison.py",
        "tests/reporting/test_table_1_cases.py tests/reporting/test_table_2_cases.py",
    ): [
        (
            "counts.to_numpy(np.int64)",
            "counts.to_numpy(np.int64).clip(max=1)",
            "one annotation per class and sequence",
        ),
        (
            'OURS: "imod", OURS_OFFLINE: "imod_offline"',
            'OURS: "imod_offline", OURS_OFFLINE: "imod"',
            "online and offline mixed",
        ),
        ("lambda r: -r.grid.n_azimuths", "lambda r: r.grid.n_azimuths", "fewer azimuths first"),
        (
            "run.results.annotations.select(",
            'run.results.tables["annotations"].select(',
            "ignored annotations count",
        ),
        (
            "columns=list(run.sequence_ids)",
            "columns=list(run.sequence_ids)[::-1]",
            "annotations of another sequence",
        ),
        ("(~of_class.is_hit).sum()", "of_class.is_hit.sum()", "true for false positives"),
        (
            "boxes = self.boxes if class_id",
            "boxes = self.boxes[:1] if class_id",
            "false positives of all classes are those of the first",
        ),
    ],
    ("imodbatch/reporting/table_1.py", "tests/reporting/test_table_1_cases.py"): [
        (
            "comb(2 * n - 1, n)",
            "comb(2 * n, n)",
            "too many resamples",
        ),
        (
            "*(c.n_false_positives(class_id) for c in ours)",
            "*(c.n_false_positives(MEAN_CLASS_ID) for c in ours)",
            "every class has the false positives of all",
        ),
        (
            "columns[place[better]].mean - columns[place[worse]].mean",
            "columns[place[worse]].mean - columns[place[better]].mean",
            "gains are losses",
        ),
        (
            "(e.interval.low, e.interval.high)",
            "(e.interval.high, e.interval.low)",
            "ends of intervals swapped",
        ),
    ],
    ("imodbatch/reporting/table_2.py", "tests/reporting/test_table_2_cases.py"): [
        ("best = max((number(ap)", "best = min((number(ap)", "the worst AP is marked"),
        (
            "comparison.n_annotations.sum(axis=1) > 0",
            "comparison.n_annotations.sum(axis=0) > 0",
            "sequences for classes",
        ),
    ],
    ("imodbatch/reporting/table_2_files.py", "tests/reporting/test_table_2_cases.py"): [
        (
            "point.thresholds[k, s]",
            "point.thresholds[k, 0]",
            "the first sequence's threshold for all",
        ),
        (
            "int(point.counts.n_hits[class_id])",
            "int(point.counts.n_kept[class_id])",
            "kept boxes for right ones",
        ),
        ("recall / 100", "recall", "percent for shares"),
    ],
    ("imodbatch/reporting/azimuths.py", "tests/reporting/test_azimuth_cases.py"): [
        (
            "vectors[own.row, own.class_id].sum(axis=1)",
            "vectors[own.row, own.class_id].max(axis=1)",
            "the bin of the largest score, not of the largest sum",
        ),
        ("== METHODS[WITH_VIEW])", "!= METHODS[WITH_VIEW])", "azimuths of fused boxes"),
        ("(apart <= 1).sum()", "(apart < 1).sum()", "±1 bin is exact"),
        (
            "figure.n and n_fold(symmetry) == 1",
            "figure.n",
            "symmetric classes in the mean",
        ),
    ],
    ("imodbatch/reporting/jitters.py", "tests/reporting/test_jitter_plots.py"): [
        ("{mdeg / 1000:g}°", "{mdeg:g}°", "thousandths of a degree as degrees"),
        (
            '[row["spread"] or 0.0',
            '[row["value"] or 0.0',
            "error bars of the values",
        ),
        (
            "[row[names[0]] for row in of_method]",
            "[row[names[-1]] for row in of_method]",
            "turn for shift",
        ),
    ],
    ("imodbatch/reporting/camera_poses.py", "tests/reporting/test_camera_pose_tables.py"): [
        (
            "metric not in SHOWN and metric not in HIDDEN",
            "metric not in SHOWN",
            "counts of frames among the source's figures",
        ),
        (
            '_Shown("ATE, largest (cm)", TRUTH, 100)',
            '_Shown("ATE, largest (cm)", TRUTH)',
            "metres as centimetres",
        ),
        (
            "path[status == kind]",
            "path[status != kind]",
            "marks on tracked frames",
        ),
    ],
    ("imodbatch/reporting/plots.py", "tests/reporting/test_results_cases.py"): [
        ("1000 * float(used_m)", "100 * float(used_m)", "centimetres for millimetres"),
        (
            "for m in (base + OFFLINE, base))",
            "for m in (base, base + OFFLINE))",
            "objects held against online thresholds",
        ),
        (
            "points.append((method, recall, precision))",
            "points.append((method, precision, recall))",
            "dots on swapped axes",
        ),
    ],
    ("imodbatch/reporting/figures.py", "tests/reporting/test_figures_cases.py"): [
        (
            "YAW_MARK_M * np.cos(yaw_rad), YAW_MARK_M * np.sin(yaw_rad)",
            "YAW_MARK_M * np.sin(yaw_rad), YAW_MARK_M * np.cos(yaw_rad)",
            "strokes along y for x",
        ),
        (
            "axes.plot(recall, precision,",
            "axes.plot(precision, recall,",
            "axes of drawn curves swapped",
        ),
    ],
}
