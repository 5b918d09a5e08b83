"""Every cause of the losses table, and the sweep, on few boxes, worked out on paper."""

import numpy as np
import pytest
from hand_tables import annotation, detection, frame, observation, pose, table

from imodbatch.core.diagnosis import Overlaps
from imodbatch.scoring import losses as losses_stage
from imodbatch.scoring import sweep
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.config import FuseConfig, MatchingConfig, Pipeline, SweepConfig

CLASSES = ("mug", "box")
MUG, BOX = 0, 1
WHOLE = (0, 0, 10, 10)  # the annotation; lower boxes overlap it by a tenth per row of pixels
HALF, LOOSE, LEAST_LOOSE, NEAR = (0, 0, 10, 5), (0, 0, 10, 4), (0, 0, 10, 3), (0, 0, 10, 2)
AWAY = (10, 0, 20, 10)
SAYS = {MUG: (0.5, 0.0), BOX: (0.0, 0.5)}


def pipeline(mode="both", voxel_sizes_m=(0.1, 0.4)):
    return Pipeline(
        fuse=FuseConfig(methods=("single", "imod"), mode=mode),
        matching=MatchingConfig(iou_percents=(50,)),
        sweep=SweepConfig(voxel_sizes_m=voxel_sizes_m),
    )


def evidence(n_frames, annotations, boxes, mode="both"):
    """All of a run; boxes are pairs of rows, of detections and of observations."""
    return Evidence(
        table("frames", [frame(s, i) for s in ("s", "t") for i in range(n_frames)]),
        table("annotations", annotations),
        table("detections", [d for d, _ in boxes]),
        table("observations", [o for _, o in boxes]),
        len(CLASSES),
        pipeline(mode),
    )


def box(s, i, number, corners, class_id=MUG, score=None, **place):
    """A detection without viewpoints and where it lies; without `xyz` it has no place."""
    scores = SAYS[class_id] if score is None else [score * (k == class_id) for k in (MUG, BOX)]
    found = detection(s, i, number, corners, scores, (class_id,))
    return found, observation(s, i, number, **place)


def losses(found, camera=lambda s, i: (10.0, 0.0, 0.0)):  # noqa: ARG005
    """(class, cause) → (value, n)."""
    keys = zip(
        *(found.frames[name].to_pylist() for name in ("sequence_id", "frame_index")), strict=True
    )
    poses = table("poses", [pose(s, i, camera(s, i)) for s, i in keys])
    rows = losses_stage.run(found, poses, CLASSES).tables["losses"].to_pylist()
    return {(row["class_id"], row["cause"]): (row["value"], row["n"]) for row in rows}


# Boxes: what the detector missed, and what it found too loosely


def test_no_box_and_loose_box():
    """Best IoU per mug: 1, .5, .4, .3, .2, 1 (of the second box), none (a box of class box)."""
    truth = [annotation("s", i, 0, MUG, WHOLE) for i in range(7)]
    truth.append(annotation("s", 7, 0, MUG, WHOLE, is_ignored=True))  # missed, but does not count
    drawn = [WHOLE, HALF, LOOSE, LEAST_LOOSE, NEAR, NEAR]
    boxes = [box("s", i, 0, corners) for i, corners in enumerate(drawn)]
    boxes += [box("s", 5, 1, WHOLE), box("s", 6, 0, WHOLE, BOX)]
    found = losses(evidence(8, truth, boxes))
    assert found[MUG, "no_box"] == (pytest.approx(2 / 7), 7)  # .2 and none
    assert found[MUG, "loose_box"] == (pytest.approx(2 / 7), 7)  # .4 and .3; .5 is what was asked
    assert found[BOX, "no_box"] == found[BOX, "loose_box"] == (None, 0)


# Places: one mug in each of two sequences, both called "m"

SEEN = [
    annotation(s, i, 0, MUG, WHOLE, instance_id="m")
    for s, n in (("s", 5), ("t", 2))
    for i in range(n)
]
OWN, OTHER = (0, 0, 0), (-1, 0, 0)
SIGHTINGS = [
    box("s", 0, 0, WHOLE, xyz=(0.0, 0.0, 0.0), voxel=OWN),
    box("s", 1, 0, WHOLE, xyz=(0.0, 0.0, 0.0), voxel=OWN),
    box("s", 2, 0, WHOLE, xyz=(0.02, 0.0, 0.0), voxel=OWN),
    box("s", 3, 0, WHOLE, xyz=(-0.04, 0.0, 0.0), voxel=OTHER),
    box("s", 4, 0, HALF),
    box("t", 0, 0, WHOLE, xyz=(5.0, 0.0, 0.0), voxel=(25, 0, 0)),
    box("t", 1, 0, WHOLE, xyz=(5.1, 0.0, 0.0), voxel=(25, 0, 0)),
]


def looked_at_from(s, i):  # noqa: ARG001
    """s looks along −x, so smaller x is behind; t along +y, so nothing of it is behind."""
    return (10.0, 0.0, 0.0) if s == "s" else (5.05, -10.0, 0.0)


def test_unplaced_is_the_share_of_right_boxes_without_a_place():
    """One of 5 + 2 sightings, which overlaps by exactly .5; the loose box is no sighting."""
    found = losses(evidence(5, SEEN, [*SIGHTINGS, box("s", 0, 1, LOOSE)]), looked_at_from)
    assert found[MUG, "unplaced"] == (pytest.approx(1 / 7), 7)


def test_things_without_a_name_are_not_one_object():
    """Which sightings belong together is not known, so there are none to be compared."""
    unnamed = [row | {"instance_id": None} for row in SEEN]
    found = losses(evidence(5, unnamed, SIGHTINGS), looked_at_from)
    assert {found[MUG, cause] for cause in ("unplaced", "split_pairs", "place_spread_m")} == {
        (None, 0)
    }


def test_split_pairs_and_voxels_per_instance():
    """In s 3 + 1 sightings: 3 of 6 pairs are split, 2 voxels; in t 1 pair in 1 voxel."""
    found = losses(evidence(5, SEEN, SIGHTINGS), looked_at_from)
    assert found[MUG, "split_pairs"] == (pytest.approx(3 / 7), 7)
    assert found[MUG, "voxels_per_instance"] == (pytest.approx(1.5), 2)


def test_place_spread_is_a_median_of_distances_from_medians():
    """In s from x = 0: 0 0 .02 .04; in t from x = 5.05: .05 .05. Middle of the six: .03."""
    found = losses(evidence(5, SEEN, SIGHTINGS), looked_at_from)
    assert found[MUG, "place_spread_m"] == (pytest.approx(0.03), 6)


def test_behind_share_is_seen_from_each_frames_own_camera():
    """Only x = −.04 is more than 3 cm behind; in t the places lie side by side."""
    found = losses(evidence(8, SEEN, SIGHTINGS), looked_at_from)  # no box in s 5 to s 7
    assert found[MUG, "behind_share"] == (pytest.approx(1 / 6), 6)
    # all cameras on the −x side: in s nothing is behind by 3 cm, in t 5.1 is
    turned = losses(evidence(5, SEEN, SIGHTINGS), lambda *_: (-10.0, 0.0, 0.0))
    assert turned[MUG, "behind_share"] == (pytest.approx(1 / 6), 6)
    # all on the +x side: −.04, and 5.0 in t
    front = losses(evidence(5, SEEN, SIGHTINGS), lambda *_: (10.0, 0.0, 0.0))
    assert front[MUG, "behind_share"] == (pytest.approx(2 / 6), 6)


def test_false_in_true_voxel():
    """Of five placed mugs on no annotation, two lie where sightings of s are."""
    origin = (0.0, 0.0, 0.0)
    stray = [
        box("s", 0, 1, AWAY, xyz=origin, voxel=OWN),  # in
        box("s", 1, 1, NEAR, xyz=origin, voxel=OTHER),  # in: an overlap of .2 is no sighting
        box("s", 2, 1, AWAY, xyz=origin, voxel=(8, 8, 8)),  # out
        box("s", 3, 1, AWAY, xyz=origin, voxel=(9, 9, 9)),  # out
        box("t", 0, 1, AWAY, xyz=origin, voxel=OTHER),  # out: that voxel is one of s
        box("s", 4, 1, AWAY),  # without a place, so not among the five
        box("s", 0, 2, LOOSE, xyz=origin, voxel=OWN),  # loose, not false
        box("s", 0, 3, AWAY, BOX, xyz=origin, voxel=OWN),  # another class, without sightings
    ]
    found = losses(evidence(5, SEEN, [*SIGHTINGS, *stray]), looked_at_from)
    assert found[MUG, "false_in_true_voxel"] == (pytest.approx(2 / 5), 5)
    assert found[BOX, "false_in_true_voxel"] == (0.0, 1)


# Ceilings: 11-point APs of imod; every AP below is a sum over the eleven recalls


def aps(found):
    return {c: v for (k, c), (v, _) in losses(found).items() if k == MUG and c.startswith("ap_")}


def test_loose_boxes_and_ranking():
    """Two mugs; stray .9, loose .5 (frame 1), right .3 (frame 0), all without a place.

    As it is F F T of 2: precision 1/3 up to recall 1/2, at 6 of 11 recalls. At IoU .3 F T T:
    2/3 everywhere. Right ones first: the one right box, precision 1 at 6 recalls.
    """
    truth = [annotation("s", i, 0, MUG, WHOLE) for i in (0, 1)]
    boxes = [
        box("s", 0, 0, WHOLE, score=0.3),
        box("s", 0, 1, AWAY, score=0.9),
        box("s", 1, 0, LOOSE, score=0.5),
    ]
    found = evidence(2, truth, boxes)
    assert aps(found) == {
        "ap_as_is": pytest.approx(6 / 33),
        "ap_iou_30": pytest.approx(2 / 3),
        "ap_oracle_voxels": pytest.approx(6 / 33),
        "ap_perfect_ranking": pytest.approx(6 / 11),
    }
    assert losses(found)[MUG, "ap_as_is"][1] == 2
    assert losses(found)[BOX, "ap_as_is"] == (None, 0)


SPLIT = [  # mug m split over two voxels and seen from two sides, mug n beside it, and a stray
    box("s", 0, 0, WHOLE, score=0.6, xyz=(0.05, 0, 0), voxel=(0, 0, 0), bins=(0, 0)),
    box("s", 1, 0, WHOLE, score=0.6, xyz=(0.25, 0, 0), voxel=(1, 0, 0), bins=(4, 0)),
    box("s", 1, 1, AWAY, score=0.8, xyz=(3.05, 0, 0), voxel=(15, 0, 0), bins=(0, 0)),
    box("s", 2, 0, AWAY, score=0.7, xyz=(5.05, 0, 0), voxel=(25, 0, 0), bins=(0, 0)),
]
MUGS = [
    annotation("s", 0, 0, MUG, WHOLE, instance_id="m"),
    annotation("s", 1, 0, MUG, WHOLE, instance_id="m"),
    annotation("s", 1, 1, MUG, AWAY, instance_id="n"),
]
AS_IS = (4 * 1 + 7 * 3 / 4) / 11  # n .8, stray .7, m .6, m .6: T F T T of 3


def test_one_voxel_per_object():
    """m's second box then has .6 + .6: T(1.2) T(.8) F(.7) T(.6), 1 up to recall 2/3, then 3/4."""
    found = aps(evidence(3, MUGS, SPLIT))
    assert found["ap_as_is"] == found["ap_iou_30"] == pytest.approx(AS_IS)
    assert found["ap_oracle_voxels"] == pytest.approx((7 * 1 + 4 * 3 / 4) / 11)
    assert found["ap_perfect_ranking"] == 1


def test_ceilings_of_a_run_that_is_offline_only():
    """With all frames seen both boxes of m have 1.2: T T T F."""
    found = aps(evidence(3, MUGS, SPLIT, mode="offline"))
    assert found["ap_as_is"] == pytest.approx(AS_IS)
    assert found["ap_oracle_voxels"] == 1


def test_a_loose_box_does_not_take_the_score_of_its_voxel():
    """Right .6, stray .3, right .2 (no place), loose 0: T F T F of 2, 1 at 6 recalls, 2/3 at 5."""
    truth = [annotation("s", i, 0, MUG, WHOLE) for i in (0, 1)]
    boxes = [
        box("s", 0, 0, LOOSE, score=0.5, xyz=(0, 0, 0)),
        box("s", 0, 1, WHOLE, score=0.6, xyz=(0, 0, 0)),
        box("s", 0, 2, AWAY, score=0.3, xyz=(5, 0, 0), voxel=(25, 0, 0)),
        box("s", 1, 0, WHOLE, score=0.2),
    ]
    assert aps(evidence(2, truth, boxes))["ap_as_is"] == pytest.approx((6 + 5 * 2 / 3) / 11)


def test_a_box_without_a_place_does_not_say_who_takes_a_score():
    """The first box is of another class and has no place; the mug keeps .6: T(.6) F(.3) of 1."""
    boxes = [
        box("s", 0, 0, WHOLE, BOX, score=0.9),
        box("s", 0, 1, WHOLE, score=0.6, xyz=(0, 0, 0)),
        box("s", 0, 2, AWAY, score=0.3),
    ]
    assert aps(evidence(1, [annotation("s", 0, 0, MUG, WHOLE)], boxes))["ap_as_is"] == 1


def test_the_best_box_of_an_annotation_is_its_tightest():
    """Annotation 0 has .6 and .9, annotation 1 only .4, annotation 2 exactly .5."""
    found = Overlaps(
        np.array([0.9, 0.4, 0.5]), np.array([0.6, 0.9, 0.4, 0.5]), np.array([0, 0, 1, 2])
    )
    assert losses_stage.best_boxes(found, 0.5).tolist() == [False, True, False, True]


def test_one_voxel_per_object_numbers():
    """m's two boxes share a new voxel, n has another one, the stray keeps its own."""
    found = evidence(3, MUGS, SPLIT)
    first, second, n, stray = losses_stage.oracle_voxels(found).tolist()
    assert first == second
    assert len({first, n, stray}) == 3
    assert stray == found.own_voxels[3]


# The sweep


def test_the_sweep_fuses_in_voxels_of_each_size():
    """At 10 cm m stays split (x .05 and .25), at 40 cm it is whole; single frames do not care."""
    rows = sweep.run(evidence(3, MUGS, SPLIT)).tables["sweeps"].to_pylist()
    assert {row["metric"] for row in rows} == {"ap_voc07_11pt"}
    assert {(row["method"], row["voxel_mm"]): row["value"] for row in rows} == {
        ("single", 100): pytest.approx(AS_IS),
        ("single", 400): pytest.approx(AS_IS),
        ("imod", 100): pytest.approx(AS_IS),
        ("imod", 400): pytest.approx(10 / 11),
        ("imod_offline", 100): pytest.approx(AS_IS),
        ("imod_offline", 400): 1.0,
    }
