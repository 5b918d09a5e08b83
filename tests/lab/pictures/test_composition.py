"""Composed pictures: labels fit the pixels, bounds hold, and picture i is always the same."""

import pickle

import numpy as np
import pytest

from imodbatch.core.boxes import iou_matrix
from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.pictures import Composer, ComposeSettings, Recipe
from imodbatch.lab.pictures.backgrounds import list_backgrounds, random_background
from imodbatch.lab.pictures.blending import (
    BLENDINGS,
    SILHOUETTE,
    Patch,
    contact_shadow,
    line_kernel,
)
from imodbatch.lab.pictures.cutouts import resize_cutout

N = 60


@pytest.fixture(scope="module")
def pictures(recipe):
    composer = recipe.composer()
    return [composer.compose(i) for i in range(N)]


def same(first, second):
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_a_picture_depends_on_seed_and_index_alone(recipe, pictures):
    again = recipe.composer()
    assert all(same(again.compose(i), pictures[i]) for i in (17, 3, 40))
    other = Recipe(recipe.cutouts, recipe.backgrounds, recipe.grid, seed=1).composer()
    assert not np.array_equal(other.compose(3).image, pictures[3].image)


def test_a_composer_sent_to_another_process_carries_no_pictures(recipe, pictures):
    sent = pickle.dumps(recipe.composer())
    assert len(sent) < 20_000 < sum(len(c.pngs) for own in recipe.composer().instances for c in own)
    assert same(pickle.loads(sent)(9), pictures[9])


def test_other_grids_label_the_same_pictures(recipe, pictures):
    coarse = Recipe(recipe.cutouts, recipe.backgrounds, ViewGrid(4, (0.5,))).composer()
    for i in range(5):
        picture = coarse.compose(i)
        assert np.array_equal(picture.image, pictures[i].image)
        assert np.array_equal(picture.azimuth_rad, pictures[i].azimuth_rad)
        assert not picture.elevation_bins.any()


def test_bins_are_those_of_the_continuous_angles(recipe, pictures):
    for p in pictures:
        assert np.array_equal(p.azimuth_bins, recipe.grid.azimuth_bins(p.azimuth_rad))
        assert np.array_equal(p.elevation_bins, recipe.grid.elevation_bins(p.elevation_rad))
    seen = {(e, a) for p in pictures for e, a in zip(p.elevation_bins, p.azimuth_bins, strict=True)}
    assert seen == {(e, a) for e in range(2) for a in range(8)}


def test_bounds_of_the_paper_hold_and_are_reached(pictures):
    counts = [len(p.boxes) for p in pictures]
    assert max(counts) == 5
    overlaps = [
        iou_matrix(p.boxes, p.boxes)[np.triu_indices(len(p.boxes), 1)]
        for p in pictures
        if len(p.boxes) > 1
    ]
    assert 0.2 < np.concatenate(overlaps).max() <= 0.75
    scales = np.concatenate([p.scales for p in pictures])
    assert scales.min() < 0.15
    assert scales.max() > 0.75
    # Sizes are whole pixels, and the silhouette ends where alpha falls below a half.
    assert scales.min() > 0.1 - 3 / 360
    assert scales.max() < 1.0 + 3 / 360
    boxes = np.concatenate([p.boxes for p in pictures])
    assert boxes.min() >= 0
    assert boxes[:, [0, 2]].max() <= 480
    assert boxes[:, [1, 3]].max() <= 360
    whole = [p for p in pictures if len(p.boxes) == 1 and p.visibility[0] == 1]
    for p in whole:
        x0, y0, x1, y1 = p.boxes[0]
        assert max(x1 - x0, y1 - y0) / 360 == pytest.approx(p.scales[0])


def test_max_iou_is_a_bound_of_its_own(recipe):
    settings = ComposeSettings(max_iou=0.05, scale_range=(0.3, 0.6), photometric=False)
    composer = Recipe(recipe.cutouts, recipe.backgrounds, recipe.grid, settings).composer()
    for i in range(15):
        boxes = composer.compose(i).boxes
        assert not np.triu(iou_matrix(boxes, boxes), 1).max(initial=0) > 0.05


def test_visibility_and_ignore(pictures):
    visibility = np.concatenate([p.visibility for p in pictures])
    ignore = np.concatenate([p.ignore for p in pictures])
    assert np.array_equal(ignore, visibility < 0.4)
    assert ignore.any()
    assert (visibility == 1).any()
    assert not ((visibility < 0) | (visibility > 1)).any()


@pytest.mark.parametrize("blending", BLENDINGS)
def test_box_encloses_the_silhouette_and_the_rest_is_untouched(recipe, blending):
    settings = ComposeSettings(
        max_objects=1, empty_share=0, shadow_share=0, photometric=False, blendings=(blending,)
    )
    composer = Recipe(recipe.cutouts, recipe.backgrounds, recipe.grid, settings).composer()
    for i in range(12):
        picture = composer.compose(i)
        assert picture.blending == blending
        background = random_background(recipe.backgrounds, 480, 360, np.random.default_rng([0, i]))
        changed = (picture.image != background).any(axis=2)
        x0, y0, x1, y1 = picture.boxes[0].astype(int)
        assert changed[y0:y1, x0:x1].mean() > 0.2
        margin = 14
        changed[max(y0 - margin, 0) : y1 + margin, max(x0 - margin, 0) : x1 + margin] = False
        assert not changed.any()


def test_box_is_exact(recipe):
    """On a black background a white object, unblended, fills its box to the pixel."""
    composer = recipe.composer()
    rng = np.random.default_rng(4)
    for _ in range(20):
        placed = composer._place([], rng)
        canvas = np.zeros((360, 480), bool)
        (rows, columns), own = placed.patch.window(canvas)
        canvas[rows, columns] = placed.patch.rgba[own][..., 3] >= SILHOUETTE
        ys, xs = np.nonzero(canvas)
        found = [xs.min(), ys.min(), xs.max() + 1, ys.max() + 1]
        inside = placed.clipped_box
        # A box cut by the border may be larger than what is left of the silhouette.
        cut = [inside[0] == 0, inside[1] == 0, inside[2] == 480, inside[3] == 360]
        if not any(cut):
            assert found == inside.tolist()
        assert found[0] >= inside[0]
        assert found[1] >= inside[1]
        assert found[2] <= inside[2]
        assert found[3] <= inside[3]


def test_every_blending_occurs_and_so_do_pictures_without_objects(recipe, pictures):
    assert {p.blending for p in pictures} == set(BLENDINGS)
    settings = ComposeSettings(empty_share=1.0)
    empty = Recipe(recipe.cutouts, recipe.backgrounds, recipe.grid, settings).composer().compose(0)
    assert empty.boxes.shape == (0, 4)
    assert empty.visibility.shape == empty.ignore.shape == (0,)


def test_poisson_takes_on_the_light_behind_and_keeps_the_colour():
    ramp = np.linspace(60, 200, 120).astype(np.uint8)
    image = np.ascontiguousarray(np.broadcast_to(ramp[None, :, None], (120, 120, 3)))
    red = np.zeros((60, 60, 4), np.uint8)
    red[..., 0], red[..., 1:3], red[..., 3] = 160, 60, 255
    BLENDINGS["poisson"](image, Patch(red, 30, 30), np.random.default_rng(0))
    inside = image[40:80, 34:86].astype(int)
    assert (inside[:, -6:].mean(axis=(0, 1)) - inside[:, :6].mean(axis=(0, 1)) > 8).all()
    assert (inside[..., 0] - inside[..., 1] > 60).all()
    assert (image[:, :20] == ramp[:20, None]).all()


@pytest.mark.parametrize("blending", BLENDINGS)
@pytest.mark.parametrize("corner", [(-50, 5), (5, -50), (60, 5), (5, 60), (55, 55), (-9, 48)])
def test_patches_at_and_beyond_the_border(blending, corner):
    """What lies outside is left out; a shadow may do so while its object does not."""
    rng = np.random.default_rng(0)
    image = np.full((50, 50, 3), 99, np.uint8)
    patch = Patch(np.full((12, 12, 4), 255, np.uint8), *corner)
    contact_shadow(image, patch, 0.3, rng)
    BLENDINGS[blending](image, patch, rng)
    (rows, columns), own = patch.window(image)
    assert image[rows, columns].shape[:2] == patch.rgba[own].shape[:2]
    is_near = all(-12 < start < 50 for start in corner)
    assert (image > 150).any() == is_near


def test_motion_does_not_move_the_object():
    for angle in (0.0, 0.7, 1.57, 2.4):
        kernel = line_kernel(7.0, angle)
        assert kernel.sum() == pytest.approx(1)
        assert np.allclose(kernel, kernel[::-1, ::-1])
        assert np.count_nonzero(kernel) >= 5


def test_resizing_keeps_colours_at_the_edge():
    rgba = np.zeros((40, 40, 4), np.uint8)
    rgba[10:31, 10:31] = (200, 100, 50, 255)
    small = resize_cutout(rgba, 17)
    edge = (small[..., 3] > 40) & (small[..., 3] < 250)
    assert edge.any()
    assert np.abs(small[edge][:, :3].astype(int) - (200, 100, 50)).max() <= 4


def test_symmetry_is_that_of_the_class(recipe):
    composer = recipe.composer()
    assert dict(zip(composer.class_names, composer.symmetries, strict=True)) == {
        "kidney_beans_doll": "none",
        "ball_pink": "full",
        "square_bowl": 4,
    }


def test_errors_are_one_line(recipe, tmp_path):
    with pytest.raises(ConfigError, match="scale_range"):
        ComposeSettings(scale_range=(0.5, 0.1))
    with pytest.raises(ConfigError, match="blendings"):
        ComposeSettings(blendings=("glue",))
    with pytest.raises(ConfigError, match="background"):
        Composer([], recipe.backgrounds, recipe.grid)
    with pytest.raises(DataError, match="no pictures"):
        list_backgrounds(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        list_backgrounds(tmp_path / "nowhere")
    (tmp_path / "bad.jpg").write_bytes(b"not a picture")
    composer = Recipe(recipe.cutouts, (tmp_path / "bad.jpg",), recipe.grid).composer()
    with pytest.raises(DataError, match=r"bad\.jpg") as error:
        composer.compose(0)
    assert "\n" not in str(error.value)
