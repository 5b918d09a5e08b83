"""A room whose table bears the five classes' objects, and others that are none of them.

The splits share no object, no furniture, no surface and no light.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.symmetry import Symmetry
from imodbatch.lab.houses.floorplan import Placed
from imodbatch.lab.houses.world import House, make_house, random_of
from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.variants import RGBD5, make_distractor, make_instance

CLASSES: tuple[str, ...] = RGBD5
SYMMETRY: dict[str, Symmetry] = {"bowl": "full", "soda_can": "full", "cereal_box": 2}
"""Of classes, not of their objects: where an unknown can's print begins cannot be known."""
POOL = {"train": (0, 100), "val": (1000, 1020), "test": (2000, 2020)}
"""First and last number (exclusive) of a split's objects of each class."""
FEWEST_EXTRA, MOST_EXTRA = 2, 5
"""Objects beside one of each class."""
FEWEST_OTHERS, MOST_OTHERS = 7, 12
"""Objects of no class."""
ON_TABLE_SHARE = 0.7
"""Of those, the ones that stand on the table as well."""
MODEL_STREAM, WALK_STREAM = 20, 21


def class_symmetry(class_name: str) -> Symmetry:
    """How a class looks from different azimuths."""
    return SYMMETRY.get(class_name, "none")


def make_tabletop(split: str, index: int, seed: int) -> House:
    """A house whose targets all stand on its island.

    Args:
        split: ``train``, ``val`` or ``test``.
        index: ordinal, from 0.
        seed: decides everything that is random.
    """
    rng = random_of(split, seed, index, MODEL_STREAM)
    targets, numbers = _targets(rng, split)
    others = _others(rng, split)
    n_on_table = len(targets) + round(ON_TABLE_SHARE * len(others))
    house = make_house(split, index, seed, [*targets, *others], n_on_island=n_on_table)
    island = next(k for k, placed in enumerate(house.furniture) if placed.is_island)
    named = [
        replace(
            target,
            class_id=CLASSES.index(target.model.name),
            instance_id=f"{target.model.name}_{number}",
        )
        for target, number in zip(house.targets[: len(targets)], numbers, strict=True)
        # What did not fit on the table stands elsewhere, where the camera hardly looks.
        if target.place == island
    ]
    rest = [target for target in house.targets if target.class_id >= len(targets)]
    scenery = tuple((other.model.mesh, other.world_from_object) for other in rest)
    return replace(house, targets=tuple(named), scenery=(*house.scenery, *scenery))


def table_of(house: House) -> Placed:
    """The table in the middle."""
    return next(placed for placed in house.furniture if placed.is_island)


def middle_of(house: House) -> NDArray[np.float64]:
    """The middle (3,) of what stands on the table, in the world."""
    if house.targets:
        return np.mean([target.middle_world for target in house.targets], axis=0)
    table = table_of(house)
    return np.array([table.x_m, table.y_m, table.piece.supports[0].height_m + 0.06])


def walk_random(house: House) -> np.random.Generator:
    """Random numbers for the walk through a house."""
    return house.random(WALK_STREAM)


def _targets(rng: np.random.Generator, split: str) -> tuple[list[ObjectModel], list[int]]:
    """One object of each class and some more, in random order; no object twice."""
    extra = rng.integers(len(CLASSES), size=int(rng.integers(FEWEST_EXTRA, MOST_EXTRA + 1)))
    ids = rng.permutation(np.concatenate([np.arange(len(CLASSES)), extra])).tolist()
    first, last = POOL[split]
    decks = [(first + rng.permutation(last - first)).tolist() for _ in CLASSES]
    numbers = [int(decks[k].pop()) for k in ids]
    models = [make_instance(CLASSES[k], n) for k, n in zip(ids, numbers, strict=True)]
    return models, numbers


def _others(rng: np.random.Generator, split: str) -> list[ObjectModel]:
    first, last = POOL[split]
    n = int(rng.integers(FEWEST_OTHERS, MOST_OTHERS + 1))
    numbers = first + rng.permutation(last - first)[:n]
    return [make_distractor(int(number)) for number in numbers]
