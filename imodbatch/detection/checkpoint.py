"""Weights in and out of a file: float16 safetensors beside a JSON card.

float16 halves the file; its rounding (about 1e-3 relative) is far below what training noise does.
Computation is in float32. safetensors holds tensors only, so opening a foreign file runs no code.
"""

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from imodbatch.core.errors import ConfigError, one_line
from imodbatch.detection.card import DetectorCard
from imodbatch.detection.files import Checkpoint, card_path, write_card
from imodbatch.detection.network import MultiViewFasterRCNN, build_detector
from imodbatch.tables.atomic import write_bytes


def save_checkpoint(model: nn.Module, card: DetectorCard, path: str | Path) -> None:
    """Write weights and card, each whole or not at all.

    Args:
        model: the network of `card`, on any device.
        card: what the network is.
        path: of ``<name>.safetensors``; the card becomes ``<name>.json`` beside it.

    Raises:
        ConfigError: the path has another suffix, or a weight is not finite.
    """
    path, json_path = Path(path), card_path(path)
    tensors = {name: _compact(name, tensor, path) for name, tensor in model.state_dict().items()}
    write_tensors(tensors, path)
    write_card(card, json_path)


def write_tensors(tensors: dict[str, Tensor], path: Path) -> None:
    """Write tensors whole or not at all; the same tensors give the same bytes."""
    # One metadata entry at most: safetensors writes several in random order, and the digest of the
    # same weights would differ from one writing to the next.
    write_bytes(path, save(tensors, metadata={"format": "pt"}))


def stored_tensors(checkpoint: Checkpoint) -> dict[str, Tensor]:
    """A checkpoint's tensors by their names in the network; those of other members are left out.

    Raises:
        ConfigError: the weights are damaged.
    """
    family = checkpoint.card.family
    own = "" if family is None else f"{family.member}/"
    try:
        tensors = load(checkpoint.weights)
    except SafetensorError as error:
        reason = one_line(error)
        raise ConfigError(
            f"{checkpoint.path}: not a readable safetensors file ({reason}). Copy or download it "
            "again."
        ) from error
    names = {name.removeprefix(own): name for name in tensors}
    return {name: tensors[stored] for name, stored in names.items() if "/" not in name}


def make_network(checkpoint: Checkpoint) -> tuple[MultiViewFasterRCNN, DetectorCard]:
    """The network of a checkpoint, on the CPU, float32, in training mode, and its card.

    Raises:
        ConfigError: the weights are damaged or do not fit the card.
    """
    card, tensors = checkpoint.card, stored_tensors(checkpoint)
    network = build_detector(card)
    misfit = _first_misfit(network.state_dict(), tensors)
    if misfit:
        raise ConfigError(
            f"{checkpoint.path}: the weights do not fit {checkpoint.card_path.name}: {misfit}. "
            f"Put the card that was saved with these weights beside them."
        )
    network.load_state_dict(tensors)  # copies into float32
    return network, card


def _compact(name: str, tensor: Tensor, path: Path) -> Tensor:
    """Round to float16 where its range allows; integers (batch counters) stay as they are."""
    tensor = tensor.detach().cpu().contiguous()
    if not tensor.is_floating_point():
        return tensor
    if not torch.isfinite(tensor).all():
        raise ConfigError(
            f"{path}: not written, {name} holds values that are not finite. "
            f"The training diverged: lower its learning rate."
        )
    half = tensor.half()
    return half if torch.isfinite(half).all() else tensor


def _first_misfit(expected: dict[str, Tensor], found: dict[str, Tensor]) -> str:
    """Describe the first tensor that is missing, of another shape or not known; "" if all fit."""
    for name, tensor in expected.items():
        if name not in found:
            return f"{name} is missing"
        if found[name].shape != tensor.shape:
            return f"{name} is {tuple(found[name].shape)}, expected {tuple(tensor.shape)}"
    return next((f"{name} is not in the network" for name in found if name not in expected), "")
