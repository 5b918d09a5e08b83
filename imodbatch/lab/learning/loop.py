"""The training: phase 1 on object crops, phase 2 on whole images, validated and kept on disk.

A step is: draw a batch, seed torch by the number of the step, compute the losses, move the weights.
A training can be stopped at any step, by a time limit or by force, and resumed; it then ends with
the same weights as one that ran through. OUT holds

    checkpoint.pt                   everything needed to go on
    <name>.safetensors, <name>.json the detector as it stands, rewritten at each validation,
                                    and each sibling's
    log.csv, events.jsonl, curves.svg
    azimuth_confusion.csv, .svg     of the last validation
"""

import math
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from imodbatch.core.errors import ConfigError
from imodbatch.lab.learning.detectors import Detectors
from imodbatch.lab.learning.loader import CropBatch, Draws, ImageBatch, open_loader, to_float
from imodbatch.lab.learning.log import TIME_NAMES, TrainingLog
from imodbatch.lab.learning.losses import LOSS_NAMES, Losses, crop_losses, detection_losses
from imodbatch.lab.learning.recipes import OptimiserSection, Recipe
from imodbatch.lab.learning.samples import CocoStream, Stream
from imodbatch.lab.learning.start import set_training_mode, start_network
from imodbatch.lab.learning.state import TrainingState, load_state, save_state
from imodbatch.lab.learning.targets import JointViewTargets, ViewTargets
from imodbatch.lab.progress import Progress, silent

LOG_EVERY_STEPS = 20
STEP_SEED_SPACING = 1_000_003  # a prime, so that neighbouring seeds share no step's generator


@dataclass(frozen=True)
class Outcome:
    """How a training ended.

    Attributes:
        weights: the detector written last.
        step: steps done.
        n_steps: steps wanted.
        figures: of the last validation; empty if there was none.
    """

    weights: Path
    step: int
    n_steps: int
    figures: dict[str, Any]

    @property
    def is_done(self) -> bool:
        """Whether no step is left."""
        return self.step >= self.n_steps


def train(
    recipe: Recipe,
    stream: Stream,
    out: Path,
    validation: CocoStream | None = None,
    minutes: float | None = None,
    resume: bool = False,
    progress: Progress = silent,
) -> Outcome:
    """Train a detector, or go on with it.

    Args:
        recipe: what to do.
        stream: what to learn from.
        out: folder for all results.
        validation: images to try it out on; None = none.
        minutes: stop after so long, with a checkpoint; None = run to the end.
        resume: go on from the checkpoint in `out`.
        progress: told the steps done and the steps wanted, after each step.

    Raises:
        ConfigError: `out` holds another training, the recipe or data changed since, the classes of
            the sets differ, pretrained weights are missing, or the training diverged.
    """
    deadline = float("inf") if minutes is None else time.monotonic() + 60 * minutes
    run = _Run(recipe, stream, out, validation, resume)
    while run.state.step < recipe.n_steps and time.monotonic() < deadline:
        run.phase(deadline, progress)
    return run.finish()


class _Run:
    """A training on its way."""

    def __init__(
        self,
        recipe: Recipe,
        stream: Stream,
        out: Path,
        validation: CocoStream | None,
        resume: bool,
    ) -> None:
        if validation is not None and validation.classes != stream.classes:
            raise ConfigError(
                f"{validation.path}: its classes are {', '.join(validation.classes)}; the training "
                f"set has {', '.join(stream.classes)}. Give both the same, in the same order."
            )
        checkpoint = out / "checkpoint.pt"
        if checkpoint.exists() and not resume:
            raise ConfigError(
                f"{out}: holds a training already. Add --resume to go on, or name another --out."
            )
        self.recipe, self.stream, self.out = recipe, stream, out
        self.checkpoint = checkpoint
        self.data: dict[str, Any] = {"training": stream.describe(), "classes": list(stream.classes)}
        network = start_network(stream.classes, recipe)
        self.network = network
        learnt = {n: p for n, p in network.named_parameters() if p.requires_grad}
        average = {n: p.detach().clone() for n, p in learnt.items()}
        self.state = TrainingState(
            network,
            self._optimiser_at(0),
            average if recipe.schedule.average_decay else {},
        )
        if resume:
            load_state(self.state, recipe, self.data, checkpoint, self._optimiser_at)
        out.mkdir(parents=True, exist_ok=True)
        self.log = TrainingLog(out, self.state.step)
        self.log.add_event(self.state.step, "resumed" if resume else "started")
        self.detectors = Detectors(recipe, self.state, stream, validation, out, self.log)
        self.targets = JointViewTargets(
            tuple(
                ViewTargets(
                    variant.grid.grid(),
                    math.radians(recipe.targets.azimuth_sigma_deg),
                    math.radians(recipe.targets.elevation_sigma_deg),
                    stream.symmetries if recipe.targets.use_symmetry else (),
                )
                for variant in recipe.variants()
            )
        )
        self._sums: dict[str, float] = defaultdict(float)

    def phase(self, deadline: float, progress: Progress) -> None:
        """Run the phase that the step is in, to its end or to the deadline."""
        recipe, state = self.recipe, self.state
        on_crops = state.step < recipe.n_crop_steps
        if state.step == recipe.n_crop_steps:
            state.optimiser = _optimiser(self.network, recipe.schedule)
        end = recipe.n_crop_steps if on_crops else recipe.n_steps
        set_training_mode(self.network, recipe.start)
        began = time.perf_counter()
        for batch in self._batches(on_crops, state.step, end):
            self._sums["data"] += time.perf_counter() - began
            self._step(batch)
            if state.step % LOG_EVERY_STEPS == 0 or state.step == end:
                self._write_row("crops" if on_crops else "images")
            progress(state.step, recipe.n_steps)
            is_last = state.step == recipe.n_steps
            if not on_crops and (is_last or self._is_due(recipe.validation.every_steps)):
                self.detectors.validate(None if is_last else 1)
            if self._is_due(recipe.checkpoint_every_steps):
                save_state(state, recipe, self.data, self.checkpoint)
            if time.monotonic() >= deadline:
                return
            began = time.perf_counter()

    def _optimiser_at(self, step: int) -> torch.optim.Optimizer:
        """Make the optimiser that is in use when so many steps are done; each phase has its own."""
        recipe = self.recipe
        was_on_crops = 0 < recipe.n_crop_steps >= step
        return _optimiser(self.network, recipe.crops if was_on_crops else recipe.schedule)

    def finish(self) -> Outcome:
        """Write checkpoint and detector, and say how it ended."""
        save_state(self.state, self.recipe, self.data, self.checkpoint)
        weights = self.detectors.write()
        figures = self.detectors.figures.get(self.recipe.name, {})
        outcome = Outcome(weights, self.state.step, self.recipe.n_steps, figures)
        self.log.add_event(self.state.step, "done" if outcome.is_done else "stopped")
        self.log.plot()
        return outcome

    def _batches(self, on_crops: bool, step: int, end: int) -> Any:
        recipe = self.recipe
        section = recipe.crops if on_crops else None
        draws = Draws(self.stream, self.targets, recipe.data, recipe.seed, section)
        size = recipe.crops.batch_size if on_crops else recipe.data.batch_size
        first_step = 0 if on_crops else recipe.n_crop_steps
        first_draw = 0 if on_crops else recipe.n_crop_steps * recipe.crops.batch_size
        return open_loader(
            draws, size, recipe.data.n_workers, first_draw, step - first_step, end - first_step
        )

    def _step(self, batch: ImageBatch | CropBatch) -> None:
        """Move the weights once."""
        recipe, state = self.recipe, self.state
        torch.manual_seed(recipe.seed * STEP_SEED_SPACING + state.step)
        began = time.perf_counter()
        losses = self._losses(batch)
        is_crops = isinstance(batch, CropBatch)
        view_weight = (recipe.crops if is_crops else recipe.targets).view_weight
        total = torch.stack(
            [loss * (view_weight if name == "view" else 1.0) for name, loss in losses.items()]
        ).sum()
        if not torch.isfinite(total):
            raise ConfigError(
                f"{self.out}: the training diverged at step {state.step}. "
                f"Lower schedule.learning_rate and start anew."
            )
        middle = time.perf_counter()
        rate = recipe.learning_rate(state.step)
        for group in state.optimiser.param_groups:
            group["lr"] = rate
        state.optimiser.zero_grad()
        if total.requires_grad:  # a batch of crops without an object has nothing to teach
            torch.autograd.backward(total)
            limit = (recipe.crops if is_crops else recipe.schedule).max_gradient_norm
            if limit:
                parameters = [p for g in state.optimiser.param_groups for p in g["params"]]
                torch.nn.utils.clip_grad_norm_(parameters, limit)
            state.optimiser.step()
        state.step += 1
        if state.average:
            state.update_average(recipe.schedule.average_decay)
        self._sums["forward"] += middle - began
        self._sums["backward"] += time.perf_counter() - middle
        self._sums["images"] += recipe.crops.batch_size if is_crops else recipe.data.batch_size
        self._sums["steps"] += 1
        for name, loss in losses.items():
            self._sums[name] += loss.item()

    def _losses(self, batch: ImageBatch | CropBatch) -> Losses:
        if isinstance(batch, CropBatch):
            if not len(batch.crops):
                return {"class": torch.zeros(())}
            return crop_losses(
                self.network, to_float(batch.crops), batch.rois, batch.class_ids, batch.views
            )
        return detection_losses(
            self.network,
            [to_float(image) for image in batch.images],
            batch.targets,
            len(self.stream.classes),
            self.recipe.targets.rois_per_image,
            self.recipe.targets.object_fraction,
            is_window=self.recipe.data.window_size is not None,
        )

    def _is_due(self, every: int) -> bool:
        return self.state.step % every == 0

    def _write_row(self, phase: str) -> None:
        sums, self._sums = self._sums, defaultdict(float)
        row: dict[str, Any] = {
            "step": self.state.step,
            "phase": phase,
            "learning_rate": f"{self.recipe.learning_rate(self.state.step - 1):.6g}",
        }
        for name in LOSS_NAMES:
            if name in sums:
                row[f"{name}_loss"] = f"{sums[name] / sums['steps']:.5f}"
        for name in TIME_NAMES:
            row[f"{name}_s_per_image"] = f"{sums[name] / sums['images']:.4f}"
        self.log.add_row(row)


def _optimiser(network: torch.nn.Module, section: OptimiserSection) -> torch.optim.Optimizer:
    """Momentum SGD or AdamW; biases and normalisations are not pulled towards zero."""
    learnt = [p for p in network.parameters() if p.requires_grad]
    groups = [
        {"params": [p for p in learnt if p.ndim > 1], "weight_decay": section.weight_decay},
        {"params": [p for p in learnt if p.ndim <= 1], "weight_decay": 0.0},
    ]
    if section.optimiser == "adamw":
        return torch.optim.AdamW(groups, lr=section.learning_rate)
    return torch.optim.SGD(groups, lr=section.learning_rate, momentum=section.momentum)
