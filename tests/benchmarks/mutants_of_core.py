"""Mistakes to plant in the core: (file, tests) → (old text, new text, what it breaks)."""

CORE = {
    ("imodbatch/core/diagnosis.py", "tests/core/test_diagnosis.py"): [
        ("> BEHIND_M", "< -BEHIND_M", "behind_share counts what lies before the object"),
        ("np.median(xyz_world[rows]", "np.mean(xyz_world[rows]", "an outlier moves the place"),
        ("np.median(distance)", "np.mean(distance)", "place_spread_m is a mean"),
        ("n_split += pairs - int(", "n_split += int(", "split_pairs counts pairs that met"),
        ("np.mean(n_voxels)", "np.max(n_voxels)", "voxels_per_instance is the largest"),
        (
            "true_rows[iou.argmax(axis=1)]",
            "iou.argmax(axis=1)",
            "a place within the image for a row of the truth",
        ),
        (
            "annotation_iou[true_rows] = iou.max(axis=0)",
            "annotation_iou[true_rows] = iou[0]",
            "the first box of an image, not the best",
        ),
    ],
    ("imodbatch/core/matching.py", "tests/core/test_matching.py"): [
        (
            "best_ious[ranking] >= iou_threshold",
            "best_ious[ranking] > iou_threshold",
            "IoU of exactly the limit",
        ),
        ("np.argsort(-np.asarray(scores", "np.argsort(np.asarray(scores", "worst box first"),
        ("row[annotation] >= best_overlap", "row[annotation] > best_overlap", "first of equals"),
        ("taken.add(annotation)", "taken.discard(annotation)", "duplicates count as right"),
    ],
    ("imodbatch/core/precision.py", "tests/core/test_precision.py"): [
        (
            'np.arange(11) * n_annotations, side="left"',
            'np.arange(11) * n_annotations, side="right"',
            "11-point AP asks for more recall than t",
        ),
        (
            "_envelope(n_found)[finds_one].sum() / n_annotations",
            "_envelope(n_found)[finds_one].mean()",
            "missed annotations cost no area",
        ),
    ],
    ("imodbatch/core/scoring.py", "tests/core/test_scoring.py tests/core/test_means_cases.py"): [
        (
            "order = order[outcome[order] != Outcome.IGNORED]",
            "order = np.asarray(order)",
            "ignored boxes count as wrong",
        ),
        ("float(known.mean())", "float(np.median(known))", "a median over classes"),
        (
            "~(self.is_ignored | self.is_crowd)",
            "~(self.is_ignored & self.is_crowd)",
            "ignored annotations count",
        ),
        (
            "(np.diff(image[order]) != 0) | (np.diff(class_id[order]) != 0)",
            "np.diff(image[order]) != 0",
            "all boxes of an image are of one class",
        ),
        (
            "order = rank(score)",
            "order = rank(-score)",
            "the worst box ranks first",
        ),
    ],
    (
        "imodbatch/core/tuning.py",
        "tests/core/test_tuning.py tests/scoring/test_metrics_cases.py",
    ): [
        ("boxes.take(boxes.sequence != s)", "boxes.take(boxes.sequence == s)", "tuned on itself"),
        (
            "np.where(np.isnan(thresholds), 0, n_annotations).sum(axis=1)",
            "n_annotations.sum(axis=1)",
            "annotations without a threshold are missed ones",
        ),
        (
            "thresholds[np.argmax(2 * n_hits / (n_kept + n_annotations[k]))]",
            "thresholds[::-1][np.argmax((2 * n_hits / (n_kept + n_annotations[k]))[::-1])]",
            "the highest of equally good thresholds",
        ),
        (
            "_quotient(2 * self.n_hits, self.n_kept + self.n_annotations)",
            "_quotient(self.n_hits, self.n_kept + self.n_annotations - self.n_hits)",
            "Jaccard index in place of F1",
        ),
        (
            "return _quotient(self.n_hits, self.n_annotations)",
            "return _quotient(self.n_hits, self.n_kept)",
            "recall per box",
        ),
        (
            "others = np.delete(n_annotations, s, axis=1).sum(axis=1)",
            "others = n_annotations.sum(axis=1)",
            "annotations of the sequence held out count in its tuning",
        ),
        (
            'np.searchsorted(scores[order], thresholds, side="left")',
            'np.searchsorted(scores[order], thresholds, side="right")',
            "a box at the threshold is dropped",
        ),
    ],
    ("imodbatch/core/viewpoint.py", "tests/core/test_viewpoint.py"): [
        (
            "np.arctan2(view[..., 1], view[..., 0])",
            "np.arctan2(view[..., 0], view[..., 1])",
            "azimuth from y, clockwise",
        ),
        (
            "(-np.asarray(pose_bin) % n_azimuths)",
            "(np.asarray(pose_bin) % n_azimuths)",
            "yaw turns the other way",
        ),
        ("np.floor(steps + 0.5)", "np.floor(steps)", "bins begin at their centre"),
        ("np.minimum(forth, n_azimuths - forth)", "forth", "the longer way round"),
    ],
    ("imodbatch/core/voxels.py", "tests/core/test_placing_cases.py"): [
        ("np.floor(np.asarray(xyz_world", "np.trunc(np.asarray(xyz_world", "twice as wide at 0"),
    ],
    ("imodbatch/core/placing.py", "tests/core/test_placing_cases.py"): [
        ("np.radians(margin_deg)", "margin_deg", "a margin in degrees taken for radians"),
    ],
    ("imodbatch/core/depth.py", "tests/core/test_depth.py"): [
        (
            "depth_m[_pixels(y_mid, half_height), _pixels(x_mid, half_width)]",
            "depth_m[_pixels(x_mid, half_width), _pixels(y_mid, half_height)]",
            "x for y in a depth image",
        ),
    ],
    ("imodbatch/core/fusion.py", "tests/core/test_fusion.py"): [
        (
            "(n_cells + 1) * log_odds",
            "(n_cells - 1) * log_odds",
            "an absent class beats a doubtful one",
        ),
        (
            "class_scores == np.maximum.reduceat",
            "class_scores == np.minimum.reduceat",
            "the worst box of a moment enters",
        ),
        ('if mode == "online":', 'if mode == "offline":', "online and offline mixed"),
        (
            "(azimuth_bins[:, None] + np.arange(n_azimuths)) % n_azimuths",
            "(azimuth_bins[:, None] - np.arange(n_azimuths)) % n_azimuths",
            "pose hypotheses turn the other way",
        ),
        ("result.n_cells[rows] = counts[known]", "result.n_cells[rows] = counts", "cells so far"),
        (
            "np.where(candidates, marginal(sightings.view_scores), -np.inf)",
            "marginal(sightings.view_scores)",
            "a box that is no candidate stands for the others",
        ),
    ],
    ("imodbatch/core/slots.py", "tests/core/test_fusion.py"): [
        (
            "enters[rows] & (n_entered[at] == 0)",
            "enters[rows] & (n_entered[at] <= 1)",
            "a second visit fills a slot anew",
        ),
        (
            "(votes - content) / np.maximum(n_entered, 1)",
            "(votes - content) / np.maximum(n_entered + 1, 1)",
            "the mean of a slot counts a view too many",
        ),
    ],
    ("imodbatch/core/disturbance.py", "tests/core/test_disturbance.py"): [
        (
            "change, xyz_world - camera_world)",
            "change, xyz_world)",
            "cameras turn about the world's origin",
        ),
    ],
    ("imodbatch/core/resampling.py", "tests/core/test_resampling.py"): [
        (
            "int(n_annotations @ times)",
            "int(n_annotations.sum())",
            "a sequence drawn twice has its annotations once",
        ),
        (
            "[(1 - coverage) / 2, (1 + coverage) / 2]",
            "[1 - coverage, coverage]",
            "a 95 % interval that holds 90 %",
        ),
    ],
    ("imodbatch/core/alignment.py", "tests/core/test_alignment.py"): [
        ("np.sqrt(np.mean(values**2))", "np.mean(np.abs(values))", "a mean for an RMS"),
    ],
    ("imodbatch/core/consistency.py", "tests/core/test_consistency.py"): [
        (
            "(residual <= HIDDEN_BEHIND_M)",
            "(np.abs(residual) <= HIDDEN_BEHIND_M)",
            "points far before b's surface say nothing",
        ),
    ],
    ("imodbatch/core/trajectory.py", "tests/core/test_trajectory.py"): [
        (
            "fraction = (at - stamps[after - 1]) / span",
            "fraction = (stamps[after] - at) / span",
            "poses between two run backwards",
        ),
    ],
}
