"""jitter: no disturbance changes nothing, a large one undoes fusion, and results repeat."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scene import GRID
from scene_tables import (
    LIFT,
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

from imodbatch.core.placing import place
from imodbatch.fusion.evidence import places_of
from imodbatch.scoring import jitter
from imodbatch.scoring.jitter import Level, levels
from imodbatch.settings.config import JitterConfig, LiftConfig
from imodbatch.tables.parquet import empty, from_columns, from_rows
from imodbatch.tables.schemas import DETECTIONS, OBSERVATIONS, TABLES

KEY = ["kind", "translation_mm", "rotation_mdeg", "method"]


def with_sure_false_boxes(**score):
    """Each true box less sure, and in every frame a surer false one at a place of its own."""
    boxes = detections_table().to_pylist()
    false = [
        row
        | {"detection_index": row["detection_index"] + N_OBJECTS, "class_ids": row["class_ids"]}
        | {"x0_px": row["x0_px"] + 500, "x1_px": row["x1_px"] + 500}
        for row in boxes
    ]
    true = [row | {"view_scores": [0.5 * s for s in row["view_scores"]]} for row in boxes]
    seen = observations_table()
    apart = 5.0 * (1 + np.arange(seen.num_rows))[:, None] * [1, 0, 0]
    xyz = places_of(seen) + apart
    cameras = SCENE.world_from_cam[seen["frame_index"].to_numpy(), :3, 3]
    places = place(xyz, cameras, GRID, LIFT.voxel_size_m)
    elsewhere = from_columns(
        OBSERVATIONS,
        {name: seen[name] for name in seen.column_names}
        | {"detection_index": seen["detection_index"].to_numpy() + N_OBJECTS}
        | {f"{axis}_m": xyz[:, i] for i, axis in enumerate("xyz")}
        | {f"voxel_{axis}": places.voxel[:, i] for i, axis in enumerate("ijk")}
        | {"azimuth_bin": places.azimuth_bin, "elevation_bin": places.elevation_bin},
    )
    return replace(
        evidence(pa.concat_tables([seen, elsewhere]), jitter=JitterConfig(**score)),
        detections=from_rows(DETECTIONS, true + false),
    )


def swept(used):
    return jitter.run(used, poses_table()).tables["jitters"]


def test_nothing_asked_gives_an_empty_table():
    result = jitter.run(evidence(observations_table()), poses_table())
    assert result.tables["jitters"].equals(empty(TABLES["jitters"]))
    assert result.summary == "no disturbance of poses asked"


def test_levels_are_swept_alone_and_in_pairs_of_equal_rank():
    config = JitterConfig(shifts_m=(0.01, 0.05, 0.1), turns_deg=(1, 2.5))
    shifts = [Level(10, 0), Level(50, 0), Level(100, 0)]
    turns = [Level(0, 1000), Level(0, 2500)]
    pairs = [Level(10, 1000), Level(50, 2500)]
    assert levels(config) == (Level(0, 0), *shifts, *turns, *pairs)
    assert levels(JitterConfig(turns_deg=(2,))) == (Level(0, 0), Level(0, 2000))
    assert levels(JitterConfig(shifts_m=(0.01, 0.01))) == (Level(0, 0), Level(10, 0))
    assert levels(JitterConfig()) == ()
    assert Level(50, 2500).shift_m == 0.05
    assert Level(50, 2500).turn_rad == pytest.approx(np.radians(2.5))


def test_without_disturbance_boxes_meet_where_they_met():
    used = with_sure_false_boxes(shifts_m=(0.05,))
    rows = swept(used).to_pandas()
    undisturbed = rows[rows.translation_mm == 0]
    own = used.mean_average_precisions(used.own_meeting)
    for _, of_kind in undisturbed.groupby("kind"):
        assert of_kind.set_index("method").value.to_dict() == own
    assert (undisturbed.n_repeats == 1).all()
    assert undisturbed.spread.isna().all()


@pytest.mark.parametrize("level", [{"shifts_m": (5.0,)}, {"turns_deg": (60.0,)}])
def test_a_large_disturbance_lowers_fusion_and_leaves_single_view(level):
    rows = swept(with_sure_false_boxes(**level)).to_pandas().set_index(KEY).sort_index()
    largest = rows.index.droplevel(["kind", "method"]).max()
    for kind in ("jitter", "drift"):
        before, after = rows.loc[(kind, 0, 0)], rows.loc[(kind, *largest)]
        assert (after.n_repeats == 3).all()
        assert after.value["single"] == before.value["single"]
        assert after.spread["single"] == 0
        for method in ("imod", "imod_offline"):
            assert after.value[method] < before.value[method] - 0.1


def test_results_repeat_and_sequences_do_not_share_noise():
    score = {"shifts_m": (0.3,), "repeats": 2}
    assert swept(with_sure_false_boxes(**score)).equals(swept(with_sure_false_boxes(**score)))
    noise = {name: noise_of(renamed(name)) for name in ("walk", "ride")}
    assert np.array_equal(noise["walk"], noise_of(renamed("walk")))
    assert not np.allclose(noise["walk"], noise["ride"])
    assert not np.allclose(noise["walk"][0], noise["walk"][1])  # shifts, turns


def renamed(sequence_id):
    """The frames as those of another sequence."""
    frames = frames_table().to_pylist()
    schema = TABLES["frames"]
    return from_rows(schema, [row | {"sequence_id": sequence_id} for row in frames])


def noise_of(frames):
    used = replace(evidence(observations_table()), frames=frames)
    return jitter.Disturbed(used, np.zeros((frames.num_rows, 3))).unit_noise("jitter", 0)


def test_a_turned_camera_may_see_too_steeply_or_no_longer():
    steep = VIEWPOINT.model_copy(update={"elevation_margin_deg": 0.0})
    seen = observations_table(steep)
    used = evidence(seen)
    used = replace(used, pipeline=used.pipeline.model_copy(update={"viewpoint": steep}))
    disturbed = jitter.Disturbed(used, SCENE.world_from_cam[:, :3, 3])
    before, shifted, after = (
        set(disturbed.meeting(level, "jitter", 0).rows.tolist())
        for level in (Level(0, 0), Level(500, 0), Level(0, 20000))
    )
    assert before == set(np.flatnonzero(np.array(seen["status"]) == "placed").tolist())
    assert shifted == before  # point and camera move alike
    assert before - after
    assert after - before


def test_boxes_too_far_stay_out():
    near = LiftConfig(max_depth_m=0.1, voxel_size_m=LIFT.voxel_size_m)
    used = evidence(observations_table())
    used = replace(used, pipeline=used.pipeline.model_copy(update={"lift": near}))
    disturbed = jitter.Disturbed(used, SCENE.world_from_cam[:, :3, 3])
    assert len(disturbed.rows) == 0


def test_without_annotations_there_is_no_ap():
    used = replace(
        evidence(observations_table(), jitter=JitterConfig(shifts_m=(0.1,))),
        annotations=annotations_table().slice(0, 0),
    )
    rows = swept(used).to_pandas()
    assert rows.value.isna().all()
    assert rows.spread.isna().all()
