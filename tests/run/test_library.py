"""The library: the same numbers as the command line, from arrays and tables in memory."""

import subprocess
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pandas.testing import assert_frame_equal
from PIL import Image
from scene import CAMERA, make_scene

import imodbatch
from imodbatch.core.errors import ConfigError, DataError, ImodError
from imodbatch.core.trajectory import FramePoses, Trajectory
from imodbatch.lab.analytic.catalogue import CLASSES
from imodbatch.lab.analytic.sequence import CAMERA as WALK_CAMERA
from imodbatch.lab.analytic.sequence import make_walk
from imodbatch.settings.config import load_pipeline
from imodbatch.tables.schemas import TABLES

SEQUENCES = ["walk_1", "walk_2"]
N_FRAMES = 8
SCENE = make_scene()
COLORS, DEPTHS = list(SCENE.color), list(SCENE.depth_m)


@pytest.fixture(scope="module")
def run(analytic_data, analytic_manifest, cli, tmp_path_factory):
    """Tables of `imodbatch run` by name."""
    folder = tmp_path_factory.mktemp("run")
    manifest = folder / "small.toml"
    manifest.write_text(analytic_manifest(analytic_data, *SEQUENCES), encoding="utf-8")
    settings = ["--set", "lift.max_depth_m=5.0", "--set", "matching.iou_percents=[50,75]"]
    result = cli("run", manifest, "--out", folder / "tables", *settings)
    assert result.exit_code == 0, result.output
    return lambda name: pd.read_parquet(folder / "tables" / name)


def depths_of(root, sequence_id):
    """Metres as a caller reads them, 0 = none."""
    paths = sorted((root / sequence_id / "depth").glob("*.png"))
    return [np.asarray(Image.open(path)).astype(np.float32) * np.float32(0.001) for path in paths]


def colors_of(root, sequence_id):
    paths = sorted((root / sequence_id / "color").glob("*.png"))
    return [np.asarray(Image.open(path)) for path in paths]


def rows(table, sequence_id):
    return table[table.sequence_id == sequence_id].reset_index(drop=True)


def same(found, expected):
    assert len(expected) > 0
    assert_frame_equal(found, expected, check_exact=True)


@pytest.mark.parametrize("kind", [pd.DataFrame, pa.Table])
def test_lift_fuse_and_score_give_the_tables_of_a_run(run, analytic_data, kind):
    def given(table):
        return table if kind is pd.DataFrame else pa.Table.from_pandas(table)

    detections, poses = run("detections"), run("poses")
    lifted = [
        imodbatch.lift(
            given(rows(detections, sequence_id)),
            depths_of(analytic_data, sequence_id),
            given(rows(poses, sequence_id)),
            WALK_CAMERA,
            max_depth_m=5.0,
        )
        for sequence_id in SEQUENCES
    ]
    observations = pd.concat(lifted, ignore_index=True)
    same(observations, run("observations"))
    assert observations.status.nunique() == 2
    fused, objects = imodbatch.fuse(
        given(detections), given(observations), WALK_CAMERA, list(CLASSES)
    )
    same(fused, run("fused"))
    same(objects, run("objects"))
    metrics = imodbatch.score(
        given(fused),
        given(detections),
        given(run("annotations")),
        list(CLASSES),
        WALK_CAMERA,
        given(poses),
        iou_percents=[50, 75],
    )
    same(metrics, run("metrics"))


def test_poses_of_the_callers_own_give_the_poses_of_a_run(run):
    for index, sequence_id in enumerate(SEQUENCES):
        own = make_walk(0, index, N_FRAMES).world_from_cam
        found = imodbatch.estimate_poses(
            None, None, WALK_CAMERA, own, up="+z", sequence_id=sequence_id
        )
        expected = rows(run("poses"), sequence_id)
        assert_frame_equal(found, expected, atol=1e-9)  # the file holds twelve digits


@pytest.mark.parametrize("up", ["estimate", "-y"])
def test_poses_by_slam_are_those_of_the_command_line(
    up, analytic_data, analytic_manifest, cli, tmp_path
):
    manifest = tmp_path / "small.toml"
    text = analytic_manifest(analytic_data, "walk_1")
    given = 'up = "+z"' if up == "estimate" else "first_camera_up = [0.0, -1.0, 0.0]"
    manifest.write_text(text.replace('up = "+z"', given, 1))
    for stage in ("index", "poses"):
        result = cli(stage, manifest, "--out", tmp_path / "run", "--set", "poses.source=slam")
        assert result.exit_code == 0, result.output
    images = colors_of(analytic_data, "walk_1"), depths_of(analytic_data, "walk_1")
    with pytest.warns(UserWarning, match="they count as lost"):
        found = imodbatch.estimate_poses(*images, WALK_CAMERA, up=up, sequence_id="walk_1")
    same(found, pd.read_parquet(tmp_path / "run/poses"))


def test_sfm_gets_the_images_and_a_folder_that_nothing_else_used(monkeypatch):
    """Its database is kept by the names of files, which images in memory do not have."""
    folders = []

    def estimate(frames, workspace, config, progress):
        assert list(workspace.iterdir()) == []
        folders.append(workspace)
        assert len(set(frames.color_files)) == len(frames) == 12
        np.testing.assert_array_equal(frames.read_color(7), COLORS[7])
        np.testing.assert_array_equal(frames.read_depth(7), DEPTHS[7].astype(np.float32))
        assert (config.mapper, list(progress([1]))) == ("global", [1])
        return Trajectory(FramePoses.from_matrices(SCENE.world_from_cam))

    monkeypatch.setattr("imodbatch.poses.sfm.estimate", estimate)
    given = COLORS, DEPTHS, CAMERA, "sfm", "+z"
    for _ in range(2):
        found = imodbatch.estimate_poses(*given, mapper="global")
    assert folders[0] != folders[1]
    assert not any(folder.exists() for folder in folders)
    same(found, imodbatch.estimate_poses(None, None, CAMERA, SCENE.world_from_cam, up="+z"))


def test_detect_gives_the_detections_of_a_run(analytic_data, analytic_manifest, cli, tmp_path):
    manifest = tmp_path / "small.toml"
    text = analytic_manifest(analytic_data, "walk_1")
    classes = ["bowl", "cap", "cereal_box", "coffee_mug", "soda_can"]
    before, after = text.split("[detections]")
    text = before.replace(str(list(CLASSES)).replace("'", '"'), str(classes).replace("'", '"'))
    annotations = text.index("[annotations]")
    manifest.write_text(text[:annotations] + after[after.index("[[sequences]]") :])
    pipeline = Path(__file__).parents[2] / "pipelines/rgbd5_3x12.toml"
    threshold = load_pipeline(pipeline).detect.score_threshold
    for stage in ("index", "detect"):
        result = cli(stage, manifest, "--pipeline", pipeline, "--out", tmp_path / "run")
        assert result.exit_code == 0, result.output
    colors = colors_of(analytic_data, "walk_1")
    own = {"sequence_id": "walk_1", "score_threshold": threshold}
    found = imodbatch.detect(colors, "rgbd5_3x12", **own)
    same(found, pd.read_parquet(tmp_path / "run/detections"))
    assert found.attrs["classes"] == classes
    assert found.attrs["n_azimuths"] == 12

    few = imodbatch.detect(
        lambda frame_index: colors[frame_index], "rgbd5_3x12", frame_index=[0, 3, 6], **own
    )
    same(few, found[found.frame_index.isin([0, 3, 6])].reset_index(drop=True))


def test_the_grid_of_viewpoints_goes_along_with_the_tables():
    """Elevations and azimuths of a detector's card reach lift and fuse without being said again."""
    found = imodbatch.detect(COLORS, "rgbd5_3x12")
    observations = imodbatch.lift(found, DEPTHS, SCENE.world_from_cam, CAMERA)
    fused, _ = imodbatch.fuse(found, observations, CAMERA)
    assert observations.attrs["n_azimuths"] == 12
    said = {"n_azimuths": 12, "elevations_deg": found.attrs["elevations_deg"]}
    found.attrs = {}
    same(imodbatch.lift(found, DEPTHS, SCENE.world_from_cam, CAMERA, **said), observations)
    again, _ = imodbatch.fuse(found, observations, CAMERA, fused.attrs["classes"])
    same(again, fused)
    with pytest.raises(ConfigError, match=r"classes=\[…\]"):
        imodbatch.fuse(found, observations, CAMERA)
    other = imodbatch.lift(found, DEPTHS, SCENE.world_from_cam, CAMERA)
    with pytest.raises(DataError, match=r"viewpoint\.n_azimuths"):
        imodbatch.fuse(found, other, CAMERA, fused.attrs["classes"])


def own_boxes(frames=range(12)):
    """What a detector without viewpoints says: a class by name and a score."""
    table = []
    for frame in frames:
        for box, class_id in zip(SCENE.boxes_px[frame], SCENE.class_id, strict=True):
            corners = dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), box, strict=True))
            row = {"frame_index": frame, "class_name": CLASSES[class_id], "score": 0.5}
            table.append(row | corners)
    return pd.DataFrame(table)


def lifted_boxes(**settings):
    return imodbatch.lift(own_boxes(), DEPTHS, SCENE.world_from_cam, CAMERA, **settings)


def test_boxes_with_a_class_and_a_score_are_enough():
    boxes = own_boxes()
    observations = lifted_boxes(push_fraction=1.0, voxel_size_m=0.4)
    fused, objects = imodbatch.fuse(boxes, observations, CAMERA, CLASSES)
    metrics = imodbatch.score(fused, boxes, boxes, CLASSES)
    for name, table in {"observations": observations, "fused": fused, "metrics": metrics}.items():
        assert list(table.columns) == TABLES[name].schema.names
    best = objects[objects.method == "imod"].head(len(SCENE.class_id))
    for class_id, true in zip(SCENE.class_id, SCENE.xyz_world, strict=True):
        (found,) = best[best.class_id == class_id][["x_m", "y_m", "z_m"]].to_numpy()
        assert np.linalg.norm(found - true) < 0.05
    ap = metrics[(metrics.metric == "ap_voc07_11pt") & (metrics.class_name == "mean")]
    assert (ap.value == 1.0).all()
    background = metrics[metrics.class_name == "background"]
    assert background.value.isna().all()  # no camera: no pixels to count


def test_settings_may_be_of_numpy():
    grid = {"elevations_deg": [30.0, 60.0], "n_azimuths": 8}
    of_numpy = {"elevations_deg": np.array([30.0, 60.0]), "n_azimuths": np.int64(8)}
    same(lifted_boxes(**of_numpy), lifted_boxes(**grid))
    given = None, None, CAMERA, SCENE.world_from_cam
    same(
        imodbatch.estimate_poses(*given, up=np.array([0.0, 0.0, 2.0])),
        imodbatch.estimate_poses(*given, up="+z"),
    )


def test_class_ids_do_as_well_as_names():
    boxes = own_boxes()
    by_id = boxes.assign(class_id=[CLASSES.index(name) for name in boxes.class_name])
    results = [
        imodbatch.fuse(given, lifted_boxes(), CAMERA, CLASSES)
        for given in (boxes, by_id.drop(columns="class_name"))
    ]
    for one, other in zip(*results, strict=True):
        same(one, other)


def test_nothing_given_is_written_into():
    boxes = own_boxes()
    kept = boxes.copy()
    observations = imodbatch.lift(boxes, DEPTHS, SCENE.world_from_cam, CAMERA)
    seen = observations.copy()
    fused, _ = imodbatch.fuse(boxes, observations, CAMERA, CLASSES)
    imodbatch.score(fused, boxes, boxes, CLASSES)
    assert_frame_equal(boxes, kept)
    assert_frame_equal(observations, seen)


def test_no_depth_is_no_depth_however_it_is_said():
    whole = lifted_boxes()
    assert (whole.status == "placed").all()
    holes = [np.nan, 0.0, -1.0, np.inf]
    depths = [np.full(image.shape, hole) for image, hole in zip(DEPTHS, holes, strict=False)]
    depths += [None, *DEPTHS[5:]]
    found = imodbatch.lift(own_boxes(), depths, SCENE.world_from_cam, CAMERA)
    assert (found[found.frame_index < 5].status == "no_depth").all()
    seen = whole.frame_index >= 5
    assert_frame_equal(found[seen], whole[seen], check_dtype=False, check_exact=True)


def test_lost_frames_are_nan():
    poses = SCENE.world_from_cam.copy()
    poses[3] = np.nan
    found = imodbatch.lift(own_boxes(), DEPTHS, poses, CAMERA)
    assert set(found.status[found.frame_index == 3]) == {"no_pose"}
    assert set(found.status[found.frame_index != 3]) == {"placed"}
    table = imodbatch.estimate_poses(None, None, CAMERA, poses, up="+z")
    assert table.status.tolist().count("lost") == 1
    same(imodbatch.lift(own_boxes(), DEPTHS, table, CAMERA), found)


def test_up_is_estimated_from_depth():
    """A world that is turned gives the same elevations once it is levelled again."""
    angle = np.deg2rad(25.0)
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    walk = make_walk(0, 0, 4)
    depths = [frame.exact_depth_m for frame in walk.frames()]
    found = imodbatch.estimate_poses(None, depths, WALK_CAMERA, turn @ walk.world_from_cam)
    heights = walk.world_from_cam[:, 2, 3]
    np.testing.assert_allclose(np.diff(found.tz_m), np.diff(heights), atol=0.01)


def test_long_sequences_come_from_functions():
    asked = []

    def depth(frame_index):
        asked.append(frame_index)
        return DEPTHS[frame_index]

    few = own_boxes([2, 5])
    found = imodbatch.lift(few, depth, SCENE.world_from_cam, CAMERA)
    assert asked == [2, 5]
    whole = lifted_boxes()
    same(found, whole[whole.frame_index.isin([2, 5])].reset_index(drop=True))


def test_detections_may_be_filtered_and_sorted_after_they_are_lifted():
    boxes = own_boxes()
    boxes["detection_index"] = boxes.groupby("frame_index").cumcount()
    whole, _ = imodbatch.fuse(boxes, lifted_boxes(), CAMERA, CLASSES)
    turned, _ = imodbatch.fuse(boxes[::-1], lifted_boxes(), CAMERA, CLASSES)
    order = ["method", "frame_index", "detection_index"]
    assert_frame_equal(
        turned.sort_values(order, ignore_index=True),
        whole.sort_values(order, ignore_index=True),
    )
    mugs = boxes[boxes.class_name == "mug"]
    fused, _ = imodbatch.fuse(mugs, lifted_boxes(), CAMERA, CLASSES)
    assert set(fused.class_id) == {CLASSES.index("mug")}
    expected = whole[whole.class_id == CLASSES.index("mug")]
    same(fused, expected.reset_index(drop=True))


def test_summaries_go_to_the_log(caplog):
    with caplog.at_level("INFO", logger="imodbatch"):
        fused, objects = imodbatch.fuse(own_boxes(), lifted_boxes(), CAMERA, CLASSES)
    assert [record.message.split(";")[0] for record in caplog.records] == [
        "observations: 36 detections = 36 placed",
        "fused: 36 detections = 36 fused",
    ]
    assert fused.attrs == objects.attrs == {"classes": list(CLASSES)}


def with_row(table, row, **values):
    changed = table.copy()
    for name, value in values.items():
        changed.loc[row, name] = value
    return changed


def lift(boxes=None, depths=DEPTHS, poses=SCENE.world_from_cam, **settings):
    boxes = own_boxes() if boxes is None else boxes
    return imodbatch.lift(boxes, depths, poses, CAMERA, **settings)


def fuse(boxes=None, observations=None, classes=CLASSES, **settings):
    boxes = own_boxes() if boxes is None else boxes
    observations = lifted_boxes() if observations is None else observations
    return imodbatch.fuse(boxes, observations, CAMERA, classes, **settings)


def score(annotations, **settings):
    fused, _ = fuse()
    return imodbatch.score(fused, own_boxes(), annotations, CLASSES, **settings)


def poses(*given, **settings):
    return imodbatch.estimate_poses(*given, **settings)


FAULTS = {
    "a misspelt setting": (lambda: lift(voxel_size=0.1), "lift: voxel_size", "'voxel_size_m'"),
    "a setting of fuse": (lambda: fuse(cell_reduc="max"), "fuse: cell_reduc", "'cell_reduce'"),
    "a setting of score": (lambda: score(own_boxes(), iou=5), "score: iou", "iou_percents"),
    "a setting of slam": (
        lambda: poses(COLORS, DEPTHS, CAMERA, n_feature=500),
        "estimate_poses: n_feature",
        "'n_features'",
    ),
    "a setting of detect": (
        lambda: imodbatch.detect(COLORS, "rgbd5_noview", nms=0.5),
        "detect: nms",
        "'nms_iou'",
    ),
    "a setting where there is none": (
        lambda: poses(None, None, CAMERA, SCENE.world_from_cam, up="+z", n_features=500),
        "estimate_poses: n_features: unknown key",
    ),
    "a source": (lambda: poses(COLORS, DEPTHS, CAMERA, "slamm"), "'slamm'", "'slam'"),
    "a detector": (lambda: imodbatch.detect(COLORS, "rgbd5_3x13"), "'rgbd5_3x12'"),
    "up": (lambda: poses(COLORS, DEPTHS, CAMERA, up="z"), "estimate_poses: up"),
    "no colours": (lambda: poses(None, DEPTHS, CAMERA), "colors: None"),
    "numbers of images": (
        lambda: poses(COLORS[1:], DEPTHS, CAMERA),
        "11 in colors, 12 in depths",
    ),
    "numbers of depths and poses": (
        lambda: lift(depths=DEPTHS[1:]),
        "11 in depths, 12 in poses",
    ),
    "no number of frames": (
        lambda: poses(COLORS.__getitem__, DEPTHS.__getitem__, CAMERA),
        "frame_index=range(n)",
    ),
    "no frames": (lambda: imodbatch.detect([], "rgbd5_noview"), "one frame at least"),
    "frames out of order": (
        lambda: imodbatch.detect(COLORS[:2], "rgbd5_noview", frame_index=[1, 0]),
        "frame_index",
        "rise",
    ),
    "an iterator": (lambda: imodbatch.detect(iter(COLORS), "rgbd5_noview"), "list or array"),
    "colours of floats": (
        lambda: imodbatch.detect([image / 255 for image in COLORS], "rgbd5_noview"),
        "frame 0",
        "float64",
        "255 * image",
    ),
    "colours of another size": (
        lambda: poses([image[:50] for image in COLORS], DEPTHS, CAMERA),
        "(50, 160, 3)",
        "(120, 160, 3)",
    ),
    "a missing colour image": (
        lambda: imodbatch.detect([None, COLORS[0]], "rgbd5_noview"),
        "frame 0 has no image",
        "unreadable_color",
    ),
    "depths of another size": (
        lambda: lift(depths=[image[:50] for image in DEPTHS]),
        "frame 0 is (50, 160), expected (120, 160)",
    ),
    "millimetres": (
        lambda: lift(depths=[np.ones(image.shape, dtype=np.uint16) for image in DEPTHS]),
        "uint16",
        "0.001 * image",
    ),
    "poses of another shape": (lambda: lift(poses=np.zeros((12, 7))), "(F, 4, 4)", "(12, 7)"),
    "no poses": (lambda: lift(poses=None), "(F, 4, 4)"),
    "transposed poses": (
        lambda: lift(poses=np.swapaxes(SCENE.world_from_cam, 1, 2)),
        "transposed",
    ),
    "no table": (lambda: lift(boxes=[1, 2]), "detections: got a list"),
    "a missing column": (
        lambda: lift(boxes=own_boxes().rename(columns={"x0_px": "x0"})),
        "no column x0_px",
    ),
    "a width in place of an edge": (
        lambda: lift(boxes=with_row(own_boxes(), 4, x1_px=3.0)),
        "row 4",
        "x, y, width, height",
    ),
    "a box of text": (
        lambda: lift(boxes=own_boxes().assign(x0_px="a")),
        "something other than numbers",
    ),
    "an unknown frame": (lambda: lift(boxes=own_boxes().assign(frame_index=99)), "99"),
    "two sequences at once": (
        lambda: lift(boxes=own_boxes().assign(sequence_id=["a", "b"] * 18)),
        "2 sequences",
    ),
    "poses of another sequence": (
        lambda: lift(
            boxes=own_boxes().assign(sequence_id="a"),
            poses=poses(None, None, CAMERA, SCENE.world_from_cam, up="+z"),
        ),
        "detections of 'a' and poses of 'sequence'",
    ),
    "no classes": (lambda: fuse(classes=None), "classes=[…]"),
    "classes as one name": (lambda: fuse(classes="mug"), "list of different names"),
    "an unknown class": (
        lambda: fuse(with_row(own_boxes(), 2, class_name="mugg")),
        "unknown class 'mugg'",
        "'mug'",
    ),
    "an unknown class id": (
        lambda: fuse(own_boxes().drop(columns="class_name").assign(class_id=5)),
        "detections: unknown class_id 5",
    ),
    "an unknown class of truth": (
        lambda: score(own_boxes().drop(columns="class_name").assign(class_id=-1)),
        "annotations: unknown class_id -1",
    ),
    "no class": (lambda: fuse(own_boxes().drop(columns="class_name")), "class_id or class_name"),
    "percent": (lambda: fuse(own_boxes().assign(score=50)), "50", "within 0 to 1"),
    "a text as a score": (lambda: fuse(own_boxes().assign(score="high")), "high", "0 to 1"),
    "boxes that were not lifted": (
        lambda: fuse(pd.concat([own_boxes(), own_boxes([3])])),
        "none for 3 of 39 detections",
        "detection_index 3",
    ),
    "boxes taken out, without numbers": (
        lambda: fuse(own_boxes()[own_boxes().class_name == "mug"]),
        "which is whose",
    ),
    "another grid": (
        lambda: fuse(n_azimuths=12),
        "another grid",
    ),
    "fused boxes of other detections": (
        lambda: imodbatch.score(fuse()[0], own_boxes([0, 1]), own_boxes(), CLASSES),
        "none behind",
    ),
    "truth outside the frames": (
        lambda: score(own_boxes(), frames=pd.DataFrame({"frame_index": range(9)})),
        "not among those given",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_line_that_names_the_cure(name):
    call, *mentions = FAULTS[name]
    with pytest.raises(ImodError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    for text in mentions:
        assert text in message


def test_whole_vectors_must_fit_the_classes(run):
    detections, observations = run("detections"), run("observations")
    with pytest.raises(DataError, match="a multiple of the 7 classes"):
        imodbatch.fuse(detections, observations, WALK_CAMERA, list("abcdefg"))
    with pytest.raises(DataError, match="unknown class_id"):
        imodbatch.fuse(detections, observations, WALK_CAMERA, ["ball", "can"])


def test_a_missing_image_may_be_skipped():
    with pytest.warns(UserWarning, match="frame 1 has no image"):
        found = imodbatch.detect(
            [COLORS[0], None], "rgbd5_noview", unreadable_color="skip", score_threshold=0.0
        )
    assert set(found.frame_index) == {0}


def test_no_detection_at_all_gives_empty_tables():
    none = own_boxes()[:0]
    observations = imodbatch.lift(none, DEPTHS, SCENE.world_from_cam, CAMERA)
    fused, objects = imodbatch.fuse(none, observations, CAMERA, CLASSES)
    assert (len(observations), len(fused), len(objects)) == (0, 0, 0)
    assert list(fused.columns) == TABLES["fused"].schema.names
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        metrics = imodbatch.score(fused, none, own_boxes(), CLASSES)
    assert list(metrics.columns) == TABLES["metrics"].schema.names


def test_importing_loads_nothing_but_the_package():
    code = (
        "import sys\n"
        "before = set(sys.modules)\n"
        "import imodbatch\n"
        "assert 'lift' in dir(imodbatch)\n"
        "print(*(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert loaded - set(sys.stdlib_module_names) == {"imodbatch"}
    assert "imodbatch.run.library" not in done.stdout.split()


@pytest.mark.parametrize("name", imodbatch.__all__)
def test_every_name_is_there_and_no_module_hides_it(name):
    assert callable(getattr(imodbatch, name))
    assert find_spec(f"imodbatch.{name}") is None


def test_other_names_are_not():
    with pytest.raises(AttributeError, match="no attribute 'lifts'"):
        imodbatch.lifts  # noqa: B018
    assert issubclass(ConfigError, imodbatch.ImodError)
