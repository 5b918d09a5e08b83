"""Mistakes to plant in the stages: (file, tests) → (old text, new text, what it breaks)."""

STAGES = {
    ("imodbatch/scoring/limits.py", "tests/scoring/test_losses_cases.py"): [
        (
            "stray = stray[row_of_box[stray] >= 0]",
            "stray = stray[row_of_box[stray] >= -1]",
            "false boxes without a place count",
        ),
        (
            "instances[annotation] is not None",
            "annotation >= 0",
            "things without a name are one object",
        ),
        (
            '"n": int(counted[k])',
            '"n": int(counted.sum())',
            "n of an AP is of all classes",
        ),
        (
            '"no_box": _share(iou < LOOSE_IOU)',
            '"no_box": _share(iou < right)',
            "no_box takes loose boxes in",
        ),
        ("(iou >= LOOSE_IOU) & (iou < right)", "(iou < right)", "loose_box takes no_box in"),
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
        (
            "_share(np.isin(voxels, sorted(true_voxels)))",
            "_share(~np.isin(voxels, sorted(true_voxels)))",
            "false_in_true_voxel inverted",
        ),
        (
            "stray = box[(class_id == k) & (found.candidate_iou < LOOSE_IOU)]",
            "stray = box[found.candidate_iou < LOOSE_IOU]",
            "stray boxes of all classes",
        ),
        (
            'f"{sequences[annotation]}/{instances[annotation]}"',
            "instances[annotation]",
            "objects of one name in two sequences are one",
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
        ("first + len(number_of)", "first", "one voxel for all instances together"),
        (
            "(found.split_pairs, found.n_pairs)",
            "(found.split_pairs, len(boxes))",
            "n of split_pairs",
        ),
        ("[evidence.image[boxes]]", "[boxes]", "the camera of another frame"),
        (
            "(class_id == k) & (found.candidate_iou >= right)",
            "(class_id == k) & (found.candidate_iou > right)",
            "a box of exactly the IoU asked is no sighting",
        ),
        (
            "replace(evidence.own_meeting, voxel=evidence.voxel_numbers(size_m))",
            "replace(evidence.own_meeting)",
            "every size of the sweep is the run's own",
        ),
    ],
    ("imodbatch/scoring/refusion.py", "tests/scoring/test_losses_cases.py"): [
        (
            "group_labels(np.column_stack([self.sequence[rows], voxels]))",
            "group_labels(voxels)",
            "sequences share their voxels",
        ),
        ("pc.not_equal(poses", "pc.equal(poses", "cameras of lost frames only"),
        ('("tx_m", "ty_m", "tz_m")', '("ty_m", "tx_m", "tz_m")', "camera's x for y"),
    ],
    ("imodbatch/fusion/evidence.py", "tests/scoring/test_losses_cases.py"): [
        ("np.where(stands, result.score, absent)", "result.score", "every box takes the score"),
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
            'column(frames, "fx_px")[row], column(frames, "fy_px")[row]',
            'column(frames, "fy_px")[row], column(frames, "fx_px")[row]',
            "width by fy, height by fx",
        ),
        ("np.argsort(-value", "np.argsort(value", "the weakest object first"),
        (
            "fused.get(method + OFFLINE_SUFFIX)",
            "fused.get(method)",
            "objects of what the first frame knew",
        ),
        ("* depth_m[:, None] / focal", "/ depth_m[:, None] / focal", "farther is smaller"),
        ("int(result.n_cells[rows[0], k])", "len(rows)", "boxes for cells"),
        ("result.score[rows[0]].argmax()", "result.score[rows[0]].argmin()", "the worst class"),
    ],
    (
        "imodbatch/scoring/score.py",
        "tests/scoring/test_metrics_cases.py tests/scoring/test_matches_cases.py",
    ): [
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
            'counted = annotations.filter(pc.invert(annotations["is_ignored"]))',
            "counted = annotations",
            "ignored annotations are to be found",
        ),
        ("kept.sum() / hits.n_annotations", "kept.sum() / len(hits.hits)", "recall per box"),
        (
            "len(kept) + hits.n_annotations",
            "len(hits.hits) + hits.n_annotations",
            "F1 of all boxes",
        ),
        (
            "hits.hits[hits.scores >= threshold]",
            "hits.hits[hits.scores > threshold]",
            "a box at the threshold is dropped",
        ),
        ('[("score", "descending"), *keys]', '[("score", "ascending"), *keys]', "rank order"),
        (
            "chosen if inside else pc.invert(chosen)",
            "pc.invert(chosen) if inside else chosen",
            "tuned on the test sequences, tested on the others",
        ),
        ("float((~h.hits).sum())", "float(h.hits.sum())", "true for false positives"),
        ("float(tuning is None)", "float(tuning is not None)", "tuned on test is inverted"),
        (
            "own_index[found.annotation_index[hit]]",
            "found.annotation_index[hit]",
            "row of an annotation for its index in the frame",
        ),
        (
            "sum(h.n_annotations for h in hits), sum(len(h.hits) for h in hits)",
            "sum(h.n_annotations for h in hits), sum(h.hits.sum() for h in hits)",
            "the mean counts right boxes only",
        ),
        ("matching.iou_percents[0]))", "matching.iou_percents[-1]))", "ap_coco of the last IoU"),
        (
            "h.n_annotations, step) for h in tuned",
            "h.n_annotations, step) for h in tested",
            "thresholds tuned on the test sequences",
        ),
        (
            'column(found, "score") >= limit',
            'column(found, "score") < limit',
            "background of the boxes thrown away",
        ),
    ],
    (
        "imodbatch/scoring/background.py",
        "tests/scoring/test_metrics_cases.py tests/scoring/test_matches_cases.py",
    ): [
        (
            "~_mask(shape, kept_of.get(key, ())) & counts",
            "~_mask(shape, kept_of.get(key, ()))",
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
