"""The shipped detectors: a card NAME.json each, and the weights of a whole family in one file.

`detect.weights` names one of them, or any checkpoint by its path.
"""

from importlib import resources
from pathlib import Path

from imodbatch.settings import shipped

FOLDER = Path(str(resources.files(__name__)))
SUFFIX = ".json"


def find_weights(name_or_path: str) -> Path:
    """Where the detector is that `detect.weights` names.

    Args:
        name_or_path: a shipped detector's name, or a path relative to the working directory; ``~``
            is the home folder.

    Returns:
        The card of a shipped detector; any other path as it is, of weights or of a card.

    Raises:
        ConfigError: a bare name that no shipped detector bears.
    """
    return shipped.find_shipped(name_or_path, "detect.weights", FOLDER, SUFFIX)
