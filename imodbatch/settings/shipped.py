"""What ships with the package and goes by its name: pipelines, manifests and detectors.

A name has neither suffix nor slash. What has one of them, or is a file that is there, is a path.
"""

from importlib import resources
from pathlib import Path

from imodbatch.core.errors import ConfigError
from imodbatch.settings.toml import did_you_mean

PACKAGE = Path(str(resources.files("imodbatch")))


def shipped_folder(name: str) -> Path:
    """Where `manifests` or `pipelines` lie: in the package, or beside it in a checkout."""
    inside = PACKAGE / name
    return inside if inside.is_dir() else PACKAGE.parent / name


def is_name(name_or_path: str | Path) -> bool:
    """Whether it is a bare name: no folder, no suffix, no file of the working directory."""
    path = Path(name_or_path)
    return path.name == str(name_or_path) and not path.suffix and not path.is_file()


def shipped_names(folder: Path, suffix: str) -> list[str]:
    """What ships in a folder, sorted."""
    return sorted(path.stem for path in folder.glob(f"*{suffix}"))


def find_shipped(name_or_path: str | Path, what: str, folder: Path, suffix: str = ".toml") -> Path:
    """The file that a name or a path means.

    Args:
        name_or_path: a shipped file's name, or a path relative to the working directory; ``~`` is
            the home folder.
        what: is named, for the error.
        folder: that holds what is shipped.
        suffix: of the files in it.

    Returns:
        The path. That of a shipped file exists; another one is not looked at.

    Raises:
        ConfigError: a name that nothing shipped bears.
    """
    if not is_name(name_or_path):
        return Path(name_or_path).expanduser()
    name, known = str(name_or_path), shipped_names(folder, suffix)
    if name not in known:
        near = did_you_mean(name, known)
        listed = f" Known: {', '.join(known)}." if near.startswith(" Did") else ""
        raise ConfigError(
            f"{what} {name!r}: none of that name is shipped.{near}{listed} "
            f"One of your own goes by its path: ./{name}{suffix}"
        )
    return folder / f"{name}{suffix}"
