"""Several objects of a class, and objects of no class."""

from dataclasses import replace

import numpy as np
import pytest

from imodbatch.core.errors import ConfigError
from imodbatch.lab.pictures import Composer, ComposeSettings, load_cutouts, sources
from imodbatch.lab.pictures.composition import DISTRACTOR_SHARE
from imodbatch.lab.pictures.dataset import recipe_digest
from imodbatch.lab.pictures.views import ViewSettings, plan_view, view_digest
from imodbatch.lab.tabletop.world import CLASSES, POOL


@pytest.fixture(scope="module")
def with_distractor(recipe):
    return replace(recipe, cutouts=recipe.cutouts[:2], distractors=recipe.cutouts[2:])


def test_distractors_are_pasted_without_a_label(with_distractor):
    composer = with_distractor.composer()
    alone = replace(with_distractor, distractors=()).composer()
    assert composer.class_names == alone.class_names
    rng = np.random.default_rng(3)
    drawn = [composer.random_cutout(rng)[0] for _ in range(400)]
    assert np.mean(np.array(drawn) == -1) == pytest.approx(DISTRACTOR_SHARE, abs=0.08)
    pictures = [composer.compose(i) for i in range(30)]
    for picture in pictures:
        assert (picture.class_ids >= 0).all()
        assert len(picture.boxes) == len(picture.class_ids) == len(picture.instances)
        assert len(picture.visibility) == len(picture.boxes)
    name = load_cutouts(with_distractor.distractors[0]).instance
    assert name not in {instance for picture in pictures for instance in picture.instances}
    n_labelled = sum(len(picture.boxes) for picture in pictures)
    n_alone = sum(len(alone.compose(i).boxes) for i in range(30))
    assert 0.3 * n_alone < n_labelled < 0.85 * n_alone


def test_a_distractor_in_front_hides_what_is_behind(recipe):
    """Two pasted objects within the picture, one labelled: only the other can have hidden it."""
    cutouts = [load_cutouts(path) for path in recipe.cutouts]
    how = ComposeSettings(min_objects=2, max_objects=2, min_inside=1.0, scale_range=(0.4, 0.8))
    composer = Composer(cutouts[:1], recipe.backgrounds, recipe.grid, how, distractors=cutouts[1:])
    single = [p for p in map(composer.compose, range(60)) if len(p.boxes) == 1]
    assert min(float(p.visibility[0]) for p in single) < 0.9


def test_without_distractors_recipes_keep_their_names(recipe, with_distractor):
    assert recipe_digest(recipe) == recipe_digest(replace(recipe, distractors=()))
    assert recipe_digest(with_distractor) != recipe_digest(replace(with_distractor, distractors=()))


def test_objects_of_one_class_differ_in_look_and_light():
    models = sources.rgbd5_models(2)
    assert [model.name for model in models[::2]] == list(CLASSES)
    first, second = models[:2]
    settings = ViewSettings(n_variants=1, first_is_center=False)
    assert view_digest(first, settings) != view_digest(second, settings)
    one, other = (plan_view(model, settings, 0, 0, 0) for model in (first, second))
    assert one.lights != other.lights
    symmetries = {model.name: model.symmetry for model in models}
    assert symmetries["bowl"] == symmetries["soda_can"] == "full"
    assert symmetries["coffee_mug"] == "none"


def test_the_first_variant_is_the_bin_s_middle_unless_all_are_turned():
    model = sources.rgbd5_models(1)[0]
    middle = plan_view(model, ViewSettings(n_variants=1), 1, 3, 0)
    turned = plan_view(model, ViewSettings(n_variants=1, first_is_center=False), 1, 3, 0)
    step = ViewSettings().grid.azimuth_step_rad
    assert middle.azimuth_rad == pytest.approx(3 * step)
    assert 0 < abs(turned.azimuth_rad - 3 * step) < step / 2


def test_only_training_objects_are_for_training():
    first, last = POOL["train"]
    with pytest.raises(ConfigError, match=f"At most {last - first} objects"):
        sources.rgbd5_models(last - first + 1)
    names = {model.instance for model in sources.distractor_models(3)}
    assert names == {"distractor_0", "distractor_1", "distractor_2"}
