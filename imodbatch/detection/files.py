"""The two files of a checkpoint: ``<name>.safetensors``, and its card ``<name>.json`` beside it.

This module imports no torch: a run that is up to date reads cards and digests only.
"""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

from imodbatch.core.errors import ConfigError, one_line
from imodbatch.detection.card import DetectorCard
from imodbatch.settings.toml import validate
from imodbatch.tables.atomic import write_text

FORMAT_VERSION = 1
WEIGHTS_SUFFIX, CARD_SUFFIX = ".safetensors", ".json"


def card_path(path: str | Path) -> Path:
    """Give the path of a checkpoint's card.

    Args:
        path: of the card, or of ``<name>.safetensors``.

    Returns:
        The path of ``<name>.json`` in the same folder.

    Raises:
        ConfigError: the path has another suffix.
    """
    path = Path(path)
    if path.suffix not in (WEIGHTS_SUFFIX, CARD_SUFFIX):
        raise ConfigError(
            f"{path}: a checkpoint is a {WEIGHTS_SUFFIX} file with its card beside it. "
            f"Set detect.weights to such a file."
        )
    return path.with_suffix(CARD_SUFFIX)


def checkpoint_files(path: str | Path) -> tuple[Path, Path]:
    """Find the weights and the card of a checkpoint, both of which are there.

    Args:
        path: of the card, or of ``<name>.safetensors``.

    Returns:
        The paths of the weights (a family's, if the card names one) and of the card.

    Raises:
        ConfigError: one of the two files is missing, or the card is damaged.
    """
    card, weights = card_path(path), Path(path).with_suffix(WEIGHTS_SUFFIX)
    if card.is_file():
        family = read_card(card).family
        weights = weights if family is None else card.with_name(family.file)
    if not weights.is_file():
        raise ConfigError(
            f"{weights}: there is no such weights file. Set detect.weights to an existing one."
        )
    if not card.is_file():
        raise ConfigError(
            f"{card}: the card of {weights.name} is missing. Copy it beside the weights."
        )
    return weights, card


def read_card(path: str | Path) -> DetectorCard:
    """Read and validate a card.

    Args:
        path: of the JSON file.

    Returns:
        The card.

    Raises:
        ConfigError: the file cannot be read, is not JSON, or has an unknown key, a missing key or
            a value that cannot be meant. One line with the file, the key and the cure.
    """
    return _parse_card(_read_bytes(Path(path)), Path(path))


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be read ({error.strerror}). Restore the file, or its permissions."
        ) from error


def _parse_card(content: bytes, path: Path) -> DetectorCard:
    try:
        values = json.loads(content.decode("utf-8"))
    except ValueError as error:
        reason = one_line(error)
        raise ConfigError(
            f"{path}: not a readable JSON card ({reason}). Restore the file that came with the "
            f"weights."
        ) from error
    version = values.get("format_version", FORMAT_VERSION) if isinstance(values, dict) else None
    if version not in (FORMAT_VERSION, None):
        raise ConfigError(
            f"{path}: format_version is {version!r}, this version reads {FORMAT_VERSION}. "
            f"Use the version of imodbatch that wrote the card."
        )
    return validate(DetectorCard, values, f"card {path}")


def write_card(card: DetectorCard, path: str | Path) -> None:
    """Write a card as indented JSON, whole or not at all."""
    alone = {"family"} if card.family is None else None
    write_text(Path(path), card.model_dump_json(indent=2, exclude=alone) + "\n")


@dataclass(frozen=True)
class Checkpoint:
    """Weights and card as they were read; equal = of the same bytes.

    Attributes:
        digest: 64 hexadecimal digits, SHA-256 over the SHA-256 digests of weights and card.
        path: of the weights; a family's file serves several cards.
        weights: that file's bytes.
        card_path: of the card.
        card: what it says.
    """

    digest: str
    path: Path = field(compare=False)
    weights: bytes = field(compare=False, repr=False)
    card_path: Path = field(compare=False)
    card: DetectorCard = field(compare=False)


def read_checkpoint(path: str | Path) -> Checkpoint:
    """Read a checkpoint's two files, each once.

    A family's file counts as a whole: another member's new head is another digest, too.

    Args:
        path: of ``<name>.safetensors``, with ``<name>.json`` beside it.

    Raises:
        ConfigError: the weights or the card are missing, or the card is damaged.
    """
    weights_path, beside = checkpoint_files(path)
    weights, card = _read_bytes(weights_path), _read_bytes(beside)
    parts = (hashlib.sha256(part).digest() for part in (weights, card))
    digest = hashlib.sha256(b"".join(parts)).hexdigest()
    return Checkpoint(digest, weights_path, weights, beside, _parse_card(card, beside))
