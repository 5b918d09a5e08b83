"""Mistakes to plant in the stages: (file, tests) → (old text, new text, what it breaks)."""

STAGES = {
    ("imodbatch/scoring/losses.py", "tests/scoring/test_losses_cases.py"): [
        (
            "stray_voxel[stray_voxel >= 0]",
            "stray_voxel[stray_voxel >= -1]",
            "false boxes without a place count",
        ),
        (
            "return box[rows][instance >= 0], instance[instance >= 0]",
            "return box[rows], instance",
            "things without a name are one object",
        ),
        (
            '"n": int(counted[k])',
            '"n": int(counted.sum())',
            "n of an AP is of all classes",
        ),
        (
            '"no_box": _share(iou < LOOSE_IOU)',
            '"no_box": _share(iou < evidence.iou_percent / 100)',
            "no_box takes loose boxes in",
        ),
        (
            "(iou >= LOOSE_IOU) & (iou < evidence.iou_percent / 100)",
            "iou < evidence.iou_percent / 100",
            "loose_box takes no_box in",
        ),
        (
            "(truth.class_id == k) & ~truth.is_ignored",
            "truth.class_id == k",
            "ignored annotations count as missed",
        ),
        ("_share(~has_place)", "_share(has_place)", "unplaced is the placed share"),
        (
            '"behind_share": (found.behind_share,',
            '"behind_share": (1 - found.behind_share,',
            "behind_share inverted",
        ),
        ("_share(np.isin(", "_share(~np.isin(", "false_in_true_voxel inverted"),
        (
            "stray = box[(class_id == k) & (evidence.overlaps.candidate_iou < LOOSE_IOU)]",
            "stray = box[evidence.overlaps.candidate_iou < LOOSE_IOU]",
            "stray boxes of all classes",
        ),
        (
            "perfect = best_boxes(evidence.overlaps, iou_percent / 100).astype(np.float64)",
            "perfect = usual",
            "ap_perfect_ranking from ordinary scores",
        ),
        (
            "evidence.average_precisions(usual, round(100 * LOOSE_IOU))",
            "evidence.average_precisions(usual, iou_percent)",
            "ap_iou_30 at the usual IoU",
        ),
        (
            '("imod", "imod_offline")',
            '("imod_offline", "imod")',
            "ceilings of the method that sees all frames",
        ),
        (
            "np.argsort(-found.candidate_iou",
            "np.argsort(found.candidate_iou",
            "the loosest right box is the best",
        ),
        ("first_new + instance", "first_new", "one voxel for all instances together"),
        (
            "(found.split_pairs, found.n_pairs)",
            "(found.split_pairs, len(boxes))",
            "n of split_pairs",
        ),
        ("[evidence.image[boxes]]", "[boxes]", "the camera of another frame"),
        (
            "(class_id == k) & (found.candidate_iou >= evidence",
            "(class_id == k) & (found.candidate_iou > evidence",
            "a box of exactly the IoU asked is no sighting",
        ),
    ],
    ("imodbatch/scoring/sweep.py", "tests/scoring/test_losses_cases.py"): [
        (
            "replace(evidence.own_meeting, voxel=evidence.voxel_numbers(size_m))",
            "replace(evidence.own_meeting)",
            "every size of the sweep is the run's own",
        ),
    ],
    ("imodbatch/scoring/rescoring.py", "tests/scoring/test_losses_cases.py"): [
        (
            "group_labels(np.column_stack([self.sequence[rows], voxels]))",
            "group_labels(voxels)",
            "sequences share their voxels",
        ),
        ("pc.not_equal(poses", "pc.equal(poses", "cameras of lost frames only"),
        ('"tx_m", "ty_m", "tz_m"', '"ty_m", "tx_m", "tz_m"', "camera's x for y"),
        (
            'for name in ("sequence_id", "instance_id")',
            'for name in ("instance_id",)',
            "objects of one name in two sequences are one",
        ),
        (
            "self.survives[rows], config",
            "self.survives[: len(rows)], config",
            "candidates are read off other boxes",
        ),
        (
            "self.truth, iou_percent / 100, rule",
            "self.truth, self.iou_percent / 100, rule",
            "every AP is that of the first IoU",
        ),
    ],
    ("imodbatch/fusion/evidence.py", "tests/scoring/test_losses_cases.py"): [
        (
            "np.where(stands, found[name].score, absent)",
            "found[name].score",
            "every box takes the score",
        ),
    ],
    ("imodbatch/fusion/fuse.py", "tests/fusion/test_objects_cases.py"): [
        (
            "mask=pose_bin < 0",
            "mask=pose_bin <= 0",
            "pose 0 is unknown",
        ),
        (
            '"fused": len(placed), "single-view": detections.num_rows - len(placed)',
            '"single-view": len(placed), "fused": detections.num_rows - len(placed)',
            "fused and single-view boxes swapped",
        ),
        ("sightings.frame[rows].max()", "sightings.frame[rows].min()", "last frame is the first"),
        ("sightings.frame[rows].min()", "rows.min()", "first row for first frame"),
        ("xyz[rows].mean(axis=0)", "np.median(xyz[rows], axis=0)", "median place of an object"),
        ("np.median(extent[rows], axis=0)", "extent[rows].mean(axis=0)", "mean size of an object"),
        (
            'stacked(frames, "fx_px", "fy_px")[row]',
            'stacked(frames, "fy_px", "fx_px")[row]',
            "width by fy, height by fx",
        ),
        ("np.argsort(-value", "np.argsort(value", "the weakest object first"),
        (
            'of_mode["offline"]',
            'of_mode["online"]',
            "objects of what the first frame knew",
        ),
        ("* depth_m[:, None] / focal", "/ depth_m[:, None] / focal", "farther is smaller"),
        ('"n_cells": n_cells[g]', '"n_cells": len(rows)', "boxes for cells"),
        ("result.score[first].argmax(", "result.score[first].argmin(", "the worst class"),
    ],
    ("imodbatch/scoring/match.py", "tests/scoring/test_matches_cases.py"): [
        (
            "pa.array(index, mask=~hit)",
            "pa.array(index, mask=hit)",
            "annotations of the false boxes",
        ),
        (
            "iou_percent / 100, config.rule",
            "0.5, config.rule",
            "every IoU is 50 %",
        ),
        (
            "own_index[found.annotation_index[hit]]",
            "found.annotation_index[hit]",
            "row of an annotation for its index in the frame",
        ),
    ],
    ("imodbatch/scoring/metrics.py", "tests/scoring/test_metrics_cases.py"): [
        (
            'self.annotations.filter(pc.invert(self.annotations["is_ignored"]))',
            "self.annotations",
            "ignored annotations are to be found",
        ),
        ("Counts.of(kept, ", "Counts.of(tested, ", "precision and recall of all boxes"),
        (
            "tested.score >= thresholds[tested.class_id]",
            "tested.score > thresholds[tested.class_id]",
            "a box at the threshold is dropped",
        ),
        (
            '(name, "ascending")',
            '(name, "descending")',
            "equal scores ranked backwards",
        ),
        (
            "return ~self.is_tuned_on if self.threshold_sequences else self.is_tuned_on",
            "return self.is_tuned_on",
            "judged on the very sequences it is tuned on",
        ),
        (
            "n_false = (behind.n_kept - behind.n_hits)",
            "n_false = behind.n_hits",
            "true for false positives",
        ),
        (
            "float(not ground.threshold_sequences)",
            "float(bool(ground.threshold_sequences))",
            "tuned on test is inverted",
        ),
        (
            "behind.n_annotations.sum(), behind.n_kept.sum()",
            "behind.n_annotations.sum(), behind.n_hits.sum()",
            "the mean counts right boxes only",
        ),
        ("matching.iou_percents[0]))", "matching.iou_percents[-1]))", "ap_coco of the last IoU"),
        (
            "boxes.take(ground.is_tuned_on[boxes.sequence])",
            "boxes.take(ground.is_tested[boxes.sequence])",
            "thresholds tuned on the boxes of the test sequences",
        ),
        (
            "annotations[:, ground.is_tuned_on].sum(axis=1)",
            "annotations.sum(axis=1)",
            "thresholds tuned for the annotations of all sequences",
        ),
        (
            "annotations[:, ground.is_tested].sum(axis=1)",
            "annotations.sum(axis=1)",
            "recall of the annotations of all sequences",
        ),
        (
            "np.where(np.isnan(thresholds), 0, behind.n_annotations)",
            "behind.n_annotations",
            "a class without a threshold is missed everywhere",
        ),
        (
            'column(found, "score") >= thresholds[',
            'column(found, "score") < thresholds[',
            "background of the boxes thrown away",
        ),
    ],
    (
        "imodbatch/scoring/background.py",
        "tests/scoring/test_metrics_cases.py tests/scoring/test_matches_cases.py",
    ): [
        (
            "(is_predicted & counts).sum()",
            "is_predicted.sum()",
            "pixels of ignored annotations count",
        ),
        (
            "both / predicted if predicted else nan, both / true if true else nan",
            "both / true if true else nan, both / predicted if predicted else nan",
            "precision and recall of the background swapped",
        ),
        ("np.ceil(box - 0.5)", "np.floor(box)", "pixels whose centre is outside"),
        ("mask[y0:y1, x0:x1]", "mask[x0:x1, y0:y1]", "x for y"),
    ],
    (
        "imodbatch/scoring/jitter.py",
        "tests/scoring/test_jitter_cases.py tests/scoring/test_jitter.py",
    ): [
        (
            "np.radians(self.rotation_mdeg / 1000)",
            "self.rotation_mdeg / 1000",
            "degrees as radians",
        ),
        ("np.std(known, ddof=1)", "np.std(known)", "the spread is too small"),
        ('("placed", "out_of_range")', '("placed",)', "what was too steep stays so"),
        (
            "camera_world + shift_m, viewpoint",
            "camera_world, viewpoint",
            "azimuths seen from where the camera truly stood",
        ),
    ],
    ("imodbatch/scoring/coco.py", "tests/scoring/test_coco.py"): [
        (
            "np.where(truth.is_ignored[wanted]",
            "np.where(truth.is_crowd[wanted]",
            "ignored annotations are to be found",
        ),
        (
            "corners[:, 2:] - corners[:, :2]]",
            "corners[:, 2:]]",
            "the far corner for the extent",
        ),
        (
            "int(n_detections_per_image.max(initial=1))",
            "1",
            "one box of each image counts",
        ),
    ],
    ("imodbatch/fusion/lift.py", "tests/fusion/test_lift.py"): [
        (
            "too_far = depth_m > config",
            "too_far = depth_m < config",
            "what is near is out of range",
        ),
        ("np.minimum(width_m, height_m)", "np.maximum(width_m, height_m)", "pushed too far"),
    ],
    ("imodbatch/poses/quality.py", "tests/poses/test_pose_quality.py"): [
        (
            "_quantile(np.degrees(rotation_rad), 0.5)",
            "_quantile(rotation_rad, 0.5)",
            "radians as degrees",
        ),
    ],
}
