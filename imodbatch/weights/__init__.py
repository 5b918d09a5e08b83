"""The shipped detectors, two files each: NAME.safetensors and its card NAME.json.

`detect.weights` names one of them, or any checkpoint by its path. A name has neither suffix nor
slash, and a path to a checkpoint has a suffix at least, so the two cannot be confused.
"""

from importlib import resources
from pathlib import Path

from imodbatch.config import did_you_mean
from imodbatch.errors import ConfigError

FOLDER = Path(str(resources.files(__name__)))
SUFFIX = ".safetensors"


def shipped_names() -> list[str]:
    """The detectors that came with the package, sorted."""
    return sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}"))


def find_weights(name_or_path: str) -> Path:
    """Where the weights are that `detect.weights` names.

    Args:
        name_or_path: a shipped detector's name, or a path relative to the working directory; ``~``
            is the home folder.

    Returns:
        The path. That of a shipped detector exists; another one is not looked at.

    Raises:
        ConfigError: a bare name that no shipped detector bears.
    """
    path = Path(name_or_path).expanduser()
    if not is_name(name_or_path):
        return path
    known = shipped_names()
    if name_or_path not in known:
        raise ConfigError(
            f"detect.weights: {name_or_path!r} is no shipped detector.{_hint(name_or_path, known)} "
            f"A checkpoint of your own is a path: {name_or_path}{SUFFIX}."
        )
    return FOLDER / f"{name_or_path}{SUFFIX}"


def is_name(name_or_path: str) -> bool:
    """Whether it is a bare name: no folder, no suffix."""
    return Path(name_or_path).name == name_or_path and not Path(name_or_path).suffix


def _hint(name: str, known: list[str]) -> str:
    """The nearest name, and all of them."""
    if not known:
        return " None is shipped."
    near = did_you_mean(name, known)
    return near if near.startswith(" Known") else f"{near} Known: {', '.join(known)}."
