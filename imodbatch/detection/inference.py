"""From images to raw detections: the detector that a stage calls.

No score threshold and no suppression per category happen here: a RoI's whole softmax is kept, and
what is dropped is decided later in plain numpy. The only suppression is the proposals' own.
"""

import copy
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imodbatch.core.detections import Detections
from imodbatch.core.errors import ConfigError
from imodbatch.detection.card import DetectorCard
from imodbatch.detection.checkpoint import make_network
from imodbatch.detection.files import Checkpoint
from imodbatch.detection.folding import fold_batch_norm
from imodbatch.detection.network import MultiViewFasterRCNN, ScoredRois


class Detector:
    """A network made ready for inference: eval mode, batch normalisation folded, on one device.

    The network is copied first, so a training can look at its progress and go on with its own.

    Attributes:
        card: classes, viewpoint grid and architecture.
        network: the copy; it can't be saved as a checkpoint.
        device: where it computes.
    """

    def __init__(
        self, network: MultiViewFasterRCNN, card: DetectorCard, device: str = "cpu"
    ) -> None:
        self.card = card
        self.device = _require_device(device)
        self.network = copy.deepcopy(network).to(self.device).eval()
        fold_batch_norm(self.network.backbone.body)
        # Channels last is the layout in which CPUs run depthwise convolutions fast.
        self.network.to(memory_format=torch.channels_last)

    def __call__(self, images: Sequence[NDArray[np.uint8]]) -> list[Detections]:
        """Detect in images.

        Images of one size are computed as one batch. Sizes are never mixed, so that no image's
        result depends on the padding another one would need.

        Args:
            images: (H, W, 3) uint8 RGB each; sizes may differ. They are not written into.

        Returns:
            One `Detections` per image, in the order given, each with at most
            `card.architecture.n_rois` rows: float32 boxes in the image's own pixels, inside it and
            of positive area, and a whole softmax; `scores` and `background` of a row sum to 1.

        Raises:
            ValueError: an image has another shape or type.
        """
        results: dict[int, Detections] = {}
        for indices in _indices_by_size(images):
            batch = [_to_tensor(images[index]).to(self.device) for index in indices]
            with torch.inference_mode():
                scored = self.network(batch)
            for index, rois in zip(indices, scored, strict=True):
                results[index] = _to_detections(rois, images[index].shape)
        return [results[index] for index in range(len(images))]


def make_detector(checkpoint: Checkpoint, device: str = "cpu") -> Detector:
    """A checkpoint made ready for inference.

    Args:
        checkpoint: as it was read.
        device: as torch names it: "cpu", "cuda", "cuda:1", "mps".

    Raises:
        ConfigError: the weights are damaged or do not fit the card, or the device is not there.
    """
    _require_device(device)  # before minutes may go into the weights
    network, card = make_network(checkpoint)
    return Detector(network, card, device)


def _require_device(name: str) -> torch.device:
    """Turn a name into a device that computes, by computing on it."""
    try:
        device = torch.device(name)
        torch.zeros(1, device=device).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ConfigError(
            f'detect.device: "{name}" is not available on this machine. Set detect.device = "cpu".'
        ) from error
    return device


def _indices_by_size(images: Sequence[NDArray[np.uint8]]) -> list[list[int]]:
    """Group the indices of images of equal size, after checking that they are images."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for index, image in enumerate(images):
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
            raise ValueError(
                f"images[{index}] is {image.shape} {image.dtype}, expected (H, W, 3) uint8 RGB"
            )
        groups.setdefault(image.shape, []).append(index)
    return list(groups.values())


def _to_tensor(image: NDArray[np.uint8]) -> Tensor:
    """Turn (H, W, 3) uint8 into (3, H, W) float in 0 to 1."""
    # The copy lets torch take read-only and flipped arrays, which it cannot wrap.
    pixels = torch.from_numpy(np.array(image, order="C"))
    return pixels.permute(2, 0, 1).to(torch.float32) / 255


def _to_detections(rois: ScoredRois, image_shape: tuple[int, ...]) -> Detections:
    """Clip the boxes to the image; a RoI of which nothing is left inside the image is left out."""
    height, width = image_shape[:2]
    corner = np.array([width, height, width, height], dtype=np.float32)
    boxes = np.clip(rois.boxes.cpu().numpy(), np.float32(0), corner)
    inside = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
    probabilities = rois.log_probabilities.exp().cpu().numpy()[inside]
    return Detections(
        boxes=boxes[inside],
        scores=np.ascontiguousarray(probabilities[:, :-1]),
        background=np.ascontiguousarray(probabilities[:, -1]),
    )
