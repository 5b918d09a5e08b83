"""Tables seen by a hand-held camera, and the layout they are written in."""

import json
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from scipy.io import loadmat

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.lab.tabletop import write_scenes
from imodbatch.lab.tabletop.dataset import UW_SEQUENCES
from imodbatch.lab.tabletop.files import is_annotated
from imodbatch.lab.tabletop.walk import HIGHEST_M, SWEEP_DEG, make_walk
from imodbatch.lab.tabletop.world import CLASSES, POOL, make_tabletop, middle_of

SMALL = PinholeCamera(160, 120, 142.575, 142.575, 79.875, 59.875)


@pytest.fixture(scope="module")
def house():
    return make_tabletop("test", 3, 7)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "scenes_test"
    write_scenes(folder, "test", seed=5, n_worlds=2, n_frames=5, camera=SMALL)
    return folder


def cells_of(path):
    """The boxes of each frame, as plain tuples."""
    cells = loadmat(path)["bboxes"]
    assert cells.shape[0] == 1
    return [
        [
            (
                str(one["category"][0]),
                int(one["instance"].item()),
                *(float(one[edge].item()) for edge in ("left", "top", "right", "bottom")),
            )
            for one in (cell[0] if cell.size else [])
        ]
        for cell in cells[0]
    ]


def test_every_class_stands_on_the_table_and_no_object_stands_twice(house):
    names = [target.instance_id for target in house.targets]
    assert len(set(names)) == len(names)
    assert {target.model.name for target in house.targets} == set(CLASSES)
    assert all(CLASSES[target.class_id] == target.model.name for target in house.targets)
    heights = [target.world_from_object[2, 3] for target in house.targets]
    assert np.ptp(heights) < 0.02
    assert min(heights) > 0.3


def test_splits_share_no_object():
    ranges = sorted(POOL.values())
    assert all(before[1] <= after[0] for before, after in pairwise(ranges))
    of_split = {
        split: {t.instance_id for k in range(3) for t in make_tabletop(split, k, 0).targets}
        for split in POOL
    }
    assert not of_split["train"] & of_split["test"]
    assert not of_split["val"] & of_split["test"]


@pytest.mark.parametrize("kind", SWEEP_DEG)
def test_the_camera_is_carried_round_the_table_without_jumps(house, kind):
    walk = make_walk(house, kind, 120)
    rotation = walk[:, :3, :3]
    assert np.allclose(rotation @ rotation.transpose(0, 2, 1), np.eye(3), atol=1e-9)
    steps = np.linalg.norm(np.diff(walk[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 0.15
    assert walk[:, 2, 3].max() < HIGHEST_M + 0.05
    away = walk[:, :2, 3] - middle_of(house)[:2]
    azimuth = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    low, high = np.deg2rad(SWEEP_DEG[kind])
    assert 0.8 * low < np.ptp(azimuth) < 1.25 * high
    towards = middle_of(house) - walk[:, :3, 3]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert (np.einsum("fi,fi->f", walk[:, :3, 2], towards) > np.cos(np.deg2rad(35))).all()


def test_files_lie_as_in_the_real_dataset(scenes):
    root = scenes / "rgbd-scenes"
    for kind, number in (("desk", 1), ("kitchen_small", 1)):
        name = f"{kind}_{number}"
        images = sorted(path.name for path in (root / kind / name).iterdir())
        wanted = {f"{name}_{n}{end}.png" for n in range(1, 6) for end in ("", "_depth")}
        assert set(images) == wanted
        assert (root / kind / f"{name}.mat").is_file()
        depth = np.asarray(Image.open(root / kind / name / f"{name}_1_depth.png"))
        assert depth.dtype == np.uint16
        assert 300 < np.median(depth[depth > 0]) < 3000


def test_the_mat_file_holds_the_true_boxes_in_whole_pixels(scenes):
    truth = json.loads((scenes / "truth/desk/desk_1/annotations.json").read_text())
    cells = cells_of(scenes / "rgbd-scenes/desk/desk_1.mat")
    assert len(cells) == 5
    n_boxes = 0
    for frame_index, cell in enumerate(cells):
        own = {a["instance"]: a for a in truth["annotations"] if a["image_id"] == frame_index}
        for category, number, left, top, right, bottom in cell:
            x, y, w, h = own[f"{category}_{number}"]["bbox"]
            assert category in CLASSES
            found = np.array([left - 1, top - 1, right, bottom])
            assert np.abs(found - [x, y, x + w, y + h]).max() < 1
            assert left >= 1
            assert right <= SMALL.width_px
            n_boxes += 1
        visible = {a["instance"] for a in own.values() if not a["ignore"]}
        assert visible <= {f"{category}_{number}" for category, number, *_ in cell}
    assert n_boxes > 5


def test_truth_names_the_images_it_belongs_to(scenes):
    path = scenes / "truth/kitchen_small/kitchen_small_1/annotations.json"
    for image in json.loads(path.read_text())["images"]:
        assert (path.parent / image["file_name"]).is_file()
    poses = (path.parent / "poses.pose").read_text().splitlines()
    assert len(poses) == 5
    quaternion = np.array(poses[0].split()[2:6], dtype=float)
    assert np.linalg.norm(quaternion) == pytest.approx(1, abs=1e-6)


def test_what_lies_there_complete_is_kept_and_what_is_lost_is_made_again(scenes):
    image = scenes / "rgbd-scenes/desk/desk_1/desk_1_2.png"
    other = scenes / "rgbd-scenes/kitchen_small/kitchen_small_1/kitchen_small_1_2.png"
    before, unchanged = image.read_bytes(), other.stat().st_mtime_ns
    image.unlink()
    seen = []
    write_scenes(
        scenes, "test", seed=5, n_worlds=2, n_frames=5, camera=SMALL,
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert seen == [(5, 10), (10, 10)]
    assert image.read_bytes() == before
    assert other.stat().st_mtime_ns == unchanged


def test_the_default_is_the_real_dataset_s_eight_sequences():
    assert sum(n for *_, n in UW_SEQUENCES) == 1434
    assert len(UW_SEQUENCES) == 8


@pytest.mark.parametrize(
    ("visibility", "inside", "side", "expected"),
    [(1, 1, 30, True), (0.3, 1, 30, False), (1, 0.4, 30, False), (1, 1, 8, False)],
)
def test_hidden_cut_and_tiny_objects_get_no_box(house, visibility, inside, side, expected):
    from imodbatch.lab.houses.sequence import SeenTarget

    box = (10.0, 10.0, 10.0 + side, 60.0)
    seen = SeenTarget(house.targets[0], box, 100, visibility, inside < 1, inside, 0.0, 0.5)
    assert is_annotated(seen) is expected


def test_bad_requests_are_refused_in_a_line(tmp_path):
    with pytest.raises(DataError, match="No split is called 'tset'"):
        write_scenes(tmp_path / "a", "tset")
    with pytest.raises(DataError, match="at least 1 world and 4 frames"):
        write_scenes(tmp_path / "a", n_worlds=1, n_frames=2)
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="is a file"):
        write_scenes(tmp_path / "file")
