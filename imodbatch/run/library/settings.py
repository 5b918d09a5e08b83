"""Settings of the library's calls: keyword arguments → the stages' models; what tables bring along.

A call takes the keys of its stage's sections of a pipeline file. `detect` notes in its table's
`attrs` which classes and which grid of viewpoints it is of; the calls after it find them there,
unless they are told otherwise.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel

from imodbatch.core.errors import ConfigError
from imodbatch.settings.config import (
    FuseConfig,
    LiftConfig,
    MatchingConfig,
    MetricsConfig,
    ViewpointConfig,
)
from imodbatch.settings.toml import validate

Model = TypeVar("Model", bound=BaseModel)
GRID = ("n_azimuths", "elevations_deg")


class LiftSettings(LiftConfig, ViewpointConfig):
    """`[lift]` and `[viewpoint]`."""


class FuseSettings(FuseConfig, ViewpointConfig):
    """`[fuse]` and `[viewpoint]`."""


class ScoreSettings(MatchingConfig, MetricsConfig):
    """`[matching]` and `[metrics]`."""


def settings_of(
    model: type[Model],
    given: dict[str, Any],
    call: str,
    *tables: object,
    brought: Sequence[str] = (),
) -> Model:
    """The settings of a call, checked.

    Args:
        model: the keys that it takes.
        given: its keyword arguments.
        call: its name, for errors.
        tables: its tables; the first that brings a key decides.
        brought: keys that tables may bring along.

    Raises:
        ConfigError: a key is unknown, or a value has the wrong form.
    """
    found = {name: value for name in brought if (value := _brought(name, tables)) is not None}
    plain = {
        name: value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
        for name, value in given.items()
    }
    return validate(model, {**found, **plain}, call)


def classes_of(given: Sequence[str] | None, call: str, *tables: object) -> tuple[str, ...]:
    """Names by class id, as given or as the tables bring them along.

    Raises:
        ConfigError: nothing says them, or they are no list of different names.
    """
    classes = _brought("classes", tables) if given is None else given
    if classes is None:
        raise ConfigError(f"{call}: which classes are there? Give classes=[…], names by class id.")
    names = () if isinstance(classes, str) else tuple(classes)
    if not names or len(set(names)) < len(names) or not all(isinstance(n, str) for n in names):
        raise ConfigError(f"{call}: classes: expected a list of different names, got {classes!r}.")
    return names


def _brought(name: str, tables: Sequence[object]) -> Any:
    for table in tables:
        if isinstance(table, pd.DataFrame) and name in table.attrs:
            return table.attrs[name]
    return None
