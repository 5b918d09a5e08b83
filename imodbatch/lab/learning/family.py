"""Join the detectors of one training: what they share is stored once, the rest per member."""

from collections.abc import Sequence
from pathlib import Path

from torch import Tensor

from imodbatch.core.errors import ConfigError
from imodbatch.detection.card import Family
from imodbatch.detection.checkpoint import stored_tensors, write_tensors
from imodbatch.detection.files import read_checkpoint, write_card


def join_family(members: Sequence[str | Path], file: str | Path) -> list[Path]:
    """Store checkpoints as one file of weights and a card each; the members' files stay.

    A tensor that all members hold bit by bit alike is written once, under its name; any other as
    ``<member>/<name>``. A member is called as its file, and loads as before to the bit.

    Args:
        members: their weights or cards.
        file: to write, such as ``robot17.safetensors``; the cards become ``<member>.json`` beside
            it.

    Returns:
        The cards written.

    Raises:
        ConfigError: a member cannot be read, two have one name, or they have no tensor in common.
    """
    file = Path(file)
    found = {Path(member).stem: read_checkpoint(member) for member in members}
    read = {name: (stored_tensors(one), one.card) for name, one in found.items()}
    if len(read) < max(2, len(members)) or file.stem in read:
        raise ConfigError(
            f"{file}: a family has two members or more, of names that differ from each other and "
            f"from the file's; got {', '.join(Path(member).stem for member in members) or 'none'}."
        )
    first, *others = [tensors for tensors, _ in read.values()]
    shared = [
        name
        for name, tensor in first.items()
        if all(name in other and _is_same(tensor, other[name]) for other in others)
    ]
    if not shared:
        raise ConfigError(
            f"{file}: {', '.join(read)} have no tensor in common. Join detectors of one training."
        )
    joined = {name: first[name] for name in shared}
    for member, (tensors, _) in read.items():
        joined |= {f"{member}/{n}": tensor for n, tensor in tensors.items() if n not in shared}
    write_tensors(joined, file)
    cards = []
    for member, (_, card) in read.items():
        family = Family(file=file.name, member=member)
        cards.append(file.with_name(f"{member}.json"))
        write_card(card.model_copy(update={"family": family}), cards[-1])
    return cards


def _is_same(a: Tensor, b: Tensor) -> bool:
    """Of one type and shape, and the same to the bit: −0 is not 0."""
    if a.dtype != b.dtype or a.shape != b.shape:
        return False
    return a.numpy().tobytes() == b.numpy().tobytes()
