"""The detectors that a training has made so far: tried out, and written for the pipeline.

One training makes a detector and its siblings, which share all but the score head.
"""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imodbatch.detection.checkpoint import save_checkpoint
from imodbatch.detection.inference import Detector
from imodbatch.detection.network import MultiViewFasterRCNN
from imodbatch.lab.learning.log import TrainingLog, write_confusions
from imodbatch.lab.learning.recipes import Recipe
from imodbatch.lab.learning.samples import CocoStream, Stream
from imodbatch.lab.learning.state import TrainingState
from imodbatch.lab.learning.validation import validate_detector


class Detectors:
    """The main detector, number 0, and its siblings, as they stand.

    Attributes:
        figures: of each detector's last validation, by its name.
    """

    def __init__(
        self,
        recipe: Recipe,
        state: TrainingState,
        stream: Stream,
        validation: CocoStream | None,
        out: Path,
        log: TrainingLog,
    ) -> None:
        self.recipe, self.state, self.stream = recipe, state, stream
        self.validation, self.out, self.log = validation, out, log
        self.figures: dict[str, dict[str, Any]] = {}

    def validate(self, first: int | None) -> None:
        """Try out the first so many, or all (None), then write all; nothing without images."""
        if self.validation is None:
            return
        for number in range(len(self.recipe.variants()))[:first]:
            self._validate_one(number, self.validation)
        self.log.plot()
        self.write()

    def write(self) -> Path:
        """Write all, for `make_detector`; returns the main one's file."""
        paths = []
        for number, recipe in enumerate(self.recipe.variants()):
            figures: dict[str, Any] = {"n_steps": self.state.step}
            if recipe.name in self.figures:
                name = "validation" if self.validation is None else self.validation.name
                figures |= {"validation_set": name, "validation": self.figures[recipe.name]}
            card = recipe.card(self.stream.classes, self.stream.describe(), figures)
            paths.append(self.out / f"{recipe.name}.safetensors")
            save_checkpoint(self._averaged(number), card, paths[-1])
        return paths[0]

    def _averaged(self, number: int) -> MultiViewFasterRCNN:
        """Copy a detector, with averaged weights if any."""
        network = copy.deepcopy(self.state.network)
        network.load_state_dict(self.state.average, strict=False)
        if number:
            network.head = network.siblings[number - 1]
        network.siblings = torch.nn.ModuleList()
        return network

    def _validate_one(self, number: int, validation: CocoStream) -> None:
        config, recipe = self.recipe.validation, self.recipe.variants()[number]
        detector = Detector(self._averaged(number), recipe.card(self.stream.classes, {}, {}))
        limit = config.max_images or validation.n_images
        spread = np.linspace(0, validation.n_images - 1, min(limit, validation.n_images))
        found = validate_detector(
            detector,
            map(validation.read, spread.round().astype(int).tolist()),
            self.stream.classes,
            self.stream.symmetries,
            recipe.grid.grid(),
            config,
        )
        figures = self.figures[recipe.name] = found.figures()
        if number == 0:
            self.log.add_event(self.state.step, "validated", figures=figures)
            write_confusions(found, self.out)
