"""The checkpoint of a training that is not done: everything that the next step depends on.

All chance comes from generators seeded by the recipe's seed and the number of the step or draw, so
the step stands for the state of every random generator: a training that was stopped and resumed
ends with the same bits as one that ran through.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from imodbatch.core.errors import ConfigError
from imodbatch.detection.network import MultiViewFasterRCNN
from imodbatch.lab.learning.recipes import Recipe, first_difference
from imodbatch.tables.atomic import replacing

FORMAT_VERSION = 1


@dataclass
class TrainingState:
    """What changes from step to step.

    Attributes:
        network: in training.
        optimiser: of its parameters.
        average: exponential average of the parameters in training; empty = none is kept.
        step: steps done.
    """

    network: MultiViewFasterRCNN
    optimiser: torch.optim.Optimizer
    average: dict[str, Tensor]
    step: int = 0

    def update_average(self, decay: float) -> None:
        """Move the average towards the network; faster in the first steps, which soon mean nothing.

        Args:
            decay: share of the old average that is kept, in the long run.
        """
        keep = min(decay, (1 + self.step) / (10 + self.step))
        current = dict(self.network.named_parameters())
        for name, value in self.average.items():
            value.lerp_(current[name].detach(), 1 - keep)


def save_state(state: TrainingState, recipe: Recipe, data: dict[str, Any], path: Path) -> None:
    """Write a checkpoint; a break leaves the old one."""
    content = {
        "format_version": FORMAT_VERSION,
        "recipe": recipe.model_dump(mode="json"),
        "data": data,
        "network": state.network.state_dict(),
        "optimiser": state.optimiser.state_dict(),
        "average": state.average,
        "step": state.step,
    }
    with replacing(path) as file:
        torch.save(content, file)


def load_state(
    state: TrainingState,
    recipe: Recipe,
    data: dict[str, Any],
    path: Path,
    optimiser_at: Callable[[int], torch.optim.Optimizer],
) -> None:
    """Read a checkpoint into a freshly built state.

    Args:
        state: to be filled.
        recipe: that the checkpoint must come from.
        data: likewise.
        path: of the checkpoint.
        optimiser_at: makes the optimiser that is in use when so many steps are done.

    Raises:
        ConfigError: it is not there or damaged, or the recipe or the data have changed since.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no checkpoint to resume. Leave --resume out to start.")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        version = content["format_version"]
    except Exception as error:  # torch.load raises what its unpickler raises
        raise ConfigError(
            f"{path}: not a readable checkpoint ({type(error).__name__}). Start again elsewhere."
        ) from None
    if version != FORMAT_VERSION:
        raise ConfigError(f"{path}: format {version}, this version reads {FORMAT_VERSION}.")
    for ours, theirs in (
        (_what_matters(recipe.model_dump(mode="json")), _what_matters(content["recipe"])),
        (data, content["data"]),
    ):
        difference = first_difference(ours, theirs)
        if difference:
            raise ConfigError(
                f"{path}: cannot resume: {difference} when the training began. "
                f"Change it back, or start anew with another --out."
            )
    state.network.load_state_dict(content["network"])
    state.optimiser = optimiser_at(content["step"])
    state.optimiser.load_state_dict(content["optimiser"])
    for name, value in state.average.items():
        value.copy_(content["average"][name])
    state.step = content["step"]


def _what_matters(recipe: dict[str, Any]) -> dict[str, Any]:
    """Leave out what does not change the weights: workers, validation, when to write."""
    rest = {k: v for k, v in recipe.items() if k not in ("validation", "checkpoint_every_steps")}
    rest["data"] = {k: v for k, v in recipe["data"].items() if k != "n_workers"}
    return rest
