"""Endless variants of five household classes, and of things that are none of them.

An instance is decided by its class and number alone, in every run and on every machine.
"""

import zlib
from collections.abc import Callable

import numpy as np

from imodbatch.core.errors import ConfigError
from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.variants.bowls import make_bowl
from imodbatch.lab.variants.caps import make_cap
from imodbatch.lab.variants.cereal_boxes import make_cereal_box
from imodbatch.lab.variants.coffee_mugs import make_coffee_mug
from imodbatch.lab.variants.distractors import make_any_distractor
from imodbatch.lab.variants.palettes import Rng
from imodbatch.lab.variants.soda_cans import make_soda_can

RGBD5: tuple[str, ...] = ("bowl", "cap", "cereal_box", "coffee_mug", "soda_can")
"""The classes of the University of Washington's RGB-D scenes that are modelled here."""

_MAKERS: dict[str, Callable[[Rng], ObjectModel]] = {
    "bowl": make_bowl,
    "cap": make_cap,
    "cereal_box": make_cereal_box,
    "coffee_mug": make_coffee_mug,
    "soda_can": make_soda_can,
}


def make_instance(class_name: str, number: int) -> ObjectModel:
    """The instance of a class that has this number.

    Args:
        class_name: one of `RGBD5`.
        number: 0 or above; different numbers look widely different.

    Returns:
        An object of that name. Its front (+x): the mug's print, with the handle at +y; the cap's
        brim; the box's printed front; the middle of the can's print.

    Raises:
        ConfigError: unknown class, or a negative number.
    """
    if class_name not in _MAKERS:
        raise ConfigError(f"Unknown class {class_name!r}; expected one of {', '.join(RGBD5)}.")
    return _MAKERS[class_name](_random(class_name, number))


def make_distractor(number: int) -> ObjectModel:
    """A household thing, named ``distractor``, that is of none of the classes.

    Args:
        number: 0 or above.

    Raises:
        ConfigError: a negative number.
    """
    return make_any_distractor(_random("distractor", number))


def _random(name: str, number: int) -> Rng:
    """The random numbers that decide an instance."""
    if number < 0:
        raise ConfigError(f"Instance number {number} of {name}; expected 0 or above.")
    return np.random.default_rng([zlib.crc32(name.encode()), number])
