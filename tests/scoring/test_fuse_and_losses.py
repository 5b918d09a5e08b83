"""lift → fuse → losses on a scene whose truth is exact and whose scores are ideal."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scene_tables import (
    LIFT,
    N_FRAMES,
    N_OBJECTS,
    SCENE,
    VIEWPOINT,
    annotations_table,
    detections_table,
    evidence,
    frames_table,
    observations_table,
    poses_table,
)

from imodbatch.core.errors import DataError
from imodbatch.fusion import fuse
from imodbatch.lab.analytic.catalogue import CLASSES
from imodbatch.scoring import losses, sweep
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.config import FuseConfig, Pipeline, SweepConfig
from imodbatch.tables.parquet import from_rows
from imodbatch.tables.schemas import DETECTIONS, OBSERVATIONS


@pytest.fixture(scope="module")
def observations():
    return observations_table()


@pytest.fixture(scope="module")
def fused(observations):
    return fuse.run(
        frames_table(), detections_table(), observations, len(CLASSES), VIEWPOINT, FuseConfig()
    )


def test_boxes_land_on_their_objects(observations):
    places = np.stack([observations[n].to_numpy() for n in ("x_m", "y_m", "z_m")], axis=-1)
    distance = np.linalg.norm(places.reshape(N_FRAMES, N_OBJECTS, 3) - SCENE.xyz_world, axis=-1)
    assert distance.max() < 0.12  # the surface, not the middle, of things about 20 cm tall


def test_the_objects_table_names_class_and_yaw(fused):
    objects = fused.tables["objects"].to_pandas()
    found = objects[objects.method == "imod"]
    for k in range(N_OBJECTS):
        center = found[["x_m", "y_m", "z_m"]].to_numpy()
        mine = found[np.linalg.norm(center - SCENE.xyz_world[k], axis=1) < 0.15]
        assert set(mine.class_id) == {SCENE.class_id[k]}
        best = mine.sort_values("n_cells").iloc[-1]
        turn = (best.yaw_rad - SCENE.yaw_rad[k]) % (2 * np.pi)
        assert min(turn, 2 * np.pi - turn) < 1e-5
        assert best.extent_z_m == pytest.approx(0.2, abs=0.15)
    assert found.n_detections.sum() == N_FRAMES * N_OBJECTS
    assert found.score.is_monotonic_decreasing


def test_views_that_agree_add_up_and_wrong_poses_do_not(observations):
    right = detections_table()
    turned = np.stack(right["view_scores"].to_pylist()).reshape(-1, len(CLASSES), 3, 16)
    turns = np.random.default_rng(0).integers(0, 16, len(turned))
    turned = np.stack([np.roll(s, t, axis=-1) for s, t in zip(turned, turns, strict=True)])
    column = pa.array(list(turned.reshape(len(turned), -1)), pa.list_(pa.float32()))
    index = right.schema.get_field_index("view_scores")
    wrong = right.set_column(index, right.schema.field(index), column)
    total = {}
    for name, table in (("right", right), ("wrong", wrong)):
        result = fuse.run(
            frames_table(), table, observations, len(CLASSES), VIEWPOINT, FuseConfig()
        )
        rows = result.tables["fused"].to_pandas()
        total[name] = rows.groupby("method").score.sum()
    assert total["right"]["naive"] == pytest.approx(total["wrong"]["naive"])
    assert total["right"]["imod"] > 1.5 * total["wrong"]["imod"]


def test_unplaced_boxes_keep_their_single_view_score(observations):
    rows = observations.to_pandas()
    rows.loc[0, "status"] = "no_depth"
    result = fuse.run(
        frames_table(),
        detections_table(),
        pa.Table.from_pandas(rows, schema=observations.schema, preserve_index=False),
        len(CLASSES),
        VIEWPOINT,
        FuseConfig(),
    )
    first = result.tables["fused"].to_pandas().query("frame_index == 0 and detection_index == 0")
    single = first[first.method == "single"].score.item()
    assert (first.score == single).all()
    assert (first[first.method != "single"].n_cells == 0).all()
    assert result.summary.startswith("36 detections = 35 fused + 1 single-view")


def test_a_foreign_grid_is_refused(observations):
    other = replace_viewpoint(n_azimuths=8)
    with pytest.raises(DataError, match="3×8") as caught:
        fuse.run(
            frames_table(), detections_table(), observations, len(CLASSES), other, FuseConfig()
        )
    assert "\n" not in str(caught.value)


def replace_viewpoint(**changes):
    return VIEWPOINT.model_copy(update=changes)


def test_the_sweep_says_what_fusing_in_those_voxels_gives(observations):
    result = sweep.run(evidence(observations, sweep=SweepConfig(voxel_sizes_m=(0.1, 0.4))))
    rows = result.tables["sweeps"].to_pandas().set_index(["method", "voxel_mm"])
    assert set(rows.index.get_level_values("voxel_mm")) == {100, 400}
    assert (rows.value == 1.0).all()  # ideal boxes and scores: nothing can outrank a right box


def test_losses_of_an_ideal_run_are_none(observations):
    used = evidence(observations)
    result = losses.run(used, poses_table(), CLASSES)
    rows = result.tables["losses"].to_pandas().set_index(["class_id", "cause"]).value
    for k in SCENE.class_id:
        for cause in ("no_box", "loose_box", "unplaced"):
            assert rows[k, cause] == 0
        for cause in ("ap_as_is", "ap_iou_30", "ap_oracle_voxels", "ap_perfect_ranking"):
            assert rows[k, cause] == 1
    absent = next(k for k in range(len(CLASSES)) if k not in SCENE.class_id)
    assert np.isnan(rows[absent, "no_box"])


def test_losses_count_what_is_lost(observations):
    """Every third annotation without a box, a third loose, a third right."""
    boxes = detections_table().to_pandas()
    kind = boxes.frame_index % 3
    height = boxes.y1_px - boxes.y0_px
    boxes.loc[kind == 1, "y1_px"] = (boxes.y0_px + 0.4 * height)[kind == 1]  # IoU 0.4
    boxes.loc[kind == 2, "y1_px"] = (boxes.y0_px + 0.1 * height)[kind == 2]  # IoU 0.1
    schema = DETECTIONS.schema
    used = replace(
        evidence(observations),
        detections=pa.Table.from_pandas(boxes, schema=schema, preserve_index=False),
    )
    rows = losses.run(used, poses_table(), CLASSES).tables["losses"].to_pandas()
    rows = rows.set_index(["class_id", "cause"]).value
    for k in SCENE.class_id:
        assert rows[k, "no_box"] == pytest.approx(1 / 3)
        assert rows[k, "loose_box"] == pytest.approx(1 / 3)
        assert rows[k, "ap_iou_30"] > rows[k, "ap_as_is"]


def test_split_voxels_show(observations):
    """Voxels of 2 cm part the sightings of every object."""
    fine = observations.to_pandas()
    for axis, name in zip("xyz", "ijk", strict=True):
        fine[f"voxel_{name}"] = np.floor(fine[f"{axis}_m"] / 0.02).astype("int32")
    table = pa.Table.from_pandas(fine, schema=observations.schema, preserve_index=False)
    shares = {}
    for name, seen in (("coarse", observations), ("fine", table)):
        rows = losses.run(evidence(seen), poses_table(), CLASSES).tables["losses"].to_pandas()
        shares[name] = rows[rows.cause == "split_pairs"].set_index("class_id").value
    for k in SCENE.class_id:
        assert shares["fine"][k] > shares["coarse"][k]
        assert shares["fine"][k] > 0.5


def with_loose_boxes(detections, observations):
    """Beside every box a looser one at the same place, less sure of the same class."""
    loose = detections.to_pylist()
    for row in loose:
        row["detection_index"] += N_OBJECTS
        row["x0_px"] -= 40
        row["view_scores"] = [0.9 * score for score in row["view_scores"]]
    places = observations.to_pylist()
    for row in places:
        row["detection_index"] += N_OBJECTS
    return (
        pa.concat_tables([detections, from_rows(DETECTIONS, loose)]),
        pa.concat_tables([observations, from_rows(OBSERVATIONS, places)]),
    )


def test_loose_boxes_do_not_inherit_the_score_of_the_place(observations):
    detections, places = with_loose_boxes(detections_table(), observations)
    for takers in ("best", "all"):
        result = fuse.run(
            frames_table(), detections, places, len(CLASSES), VIEWPOINT, FuseConfig(takers=takers)
        )
        table = result.tables["fused"].to_pandas()
        is_loose = table.detection_index >= N_OBJECTS
        for method in ("naive", "imod", "imod_offline"):
            loose = table[(table.method == method) & is_loose].score.to_numpy()
            tight = table[(table.method == method) & ~is_loose].score.to_numpy()
            assert (tight > 0).all()
            assert np.array_equal(loose, np.zeros(len(loose)) if takers == "best" else tight)
        single = table[(table.method == "single") & is_loose].score
        assert (single > 0).all()  # single view knows no voxels
    # what is there does not depend on who takes the score
    plain = fuse.run(
        frames_table(), detections, places, len(CLASSES), VIEWPOINT, FuseConfig(takers="all")
    )
    assert plain.tables["objects"].equals(result.tables["objects"])


def test_the_ceiling_counts_one_box_per_object(observations):
    detections, places = with_loose_boxes(detections_table(), observations)
    pipeline = Pipeline(viewpoint=VIEWPOINT, lift=LIFT)
    whole = Evidence(
        frames_table(), annotations_table(), detections, places, len(CLASSES), pipeline
    )
    table = losses.run(whole, poses_table(), CLASSES).tables["losses"].to_pandas()
    ceiling = table[(table.cause == "ap_perfect_ranking")].value.dropna()
    assert len(ceiling)
    assert (ceiling == 1).all()
