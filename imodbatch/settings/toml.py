"""TOML → a checked model; a fault is one line with the file, the key and a hint.

An unknown key is an error that offers the nearest known one. `apply_settings` lays
``--set stage.key=value`` over what a file says.
"""

import difflib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from imodbatch.core.errors import ConfigError

Model = TypeVar("Model", bound=BaseModel)
UNION_BRANCHES = ("function-", "literal[", "tuple[")  # pydantic's names, of no use to a reader


class StrictModel(BaseModel):
    """Frozen, no unknown keys, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def apply_settings(data: dict[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Lay ``section.key=value`` settings over TOML data; values are TOML, bare words strings."""
    result = {
        name: dict(value) if isinstance(value, dict) else value for name, value in data.items()
    }
    for setting in settings:
        name, equals, text = setting.partition("=")
        section, dot, key = name.strip().partition(".")
        if not equals or not dot:
            raise ConfigError(
                f"--set {setting}: expected STAGE.KEY=VALUE, such as fuse.cell_reduce=max."
            )
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text.strip()
        target = result.setdefault(section, {})
        if not isinstance(target, dict):
            raise ConfigError(f"--set {setting}: {section} is not a section.")
        target[key] = value
    return result


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file as a dictionary, with one-line errors."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file.{_similar_file(path)}") from None
    except IsADirectoryError:
        raise ConfigError(f"{path}: is a folder, expected a TOML file.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error}).") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}.") from None


def validate(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Check TOML data against a model; the first fault becomes a one-line `ConfigError`.

    An unknown key comes before all others: a misspelt key is also a missing one.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults = error.errors()
        first = next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])
        path = ".".join(str(p) for p in first["loc"] if not str(p).startswith(UNION_BRANCHES))
        if first["type"] == "extra_forbidden":
            names = _known_names(model, first["loc"][:-1])
            hint = did_you_mean(str(first["loc"][-1]), names)
            raise ConfigError(f"{where}: {path}: unknown key.{hint}") from None
        message = first["msg"].removeprefix("Value error, ")
        given = "" if first["type"] == "missing" else f" (got {_short(first['input'])})"
        label = f"{path}: " if path else ""
        raise ConfigError(f"{where}: {label}{message}{given}.") from None


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """A closing hint: the nearest known name, or the list of all."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if near:
        return f" Did you mean {near[0]!r}?"
    return f" Known: {', '.join(known)}." if known else ""


def _known_names(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Field names of the model that an error location points into."""
    schema = model.model_json_schema()
    node: dict[str, Any] = schema
    for part in location:
        node = node.get("items", {}) if isinstance(part, int) else node["properties"].get(part, {})
        for option in [node, *node.get("anyOf", []), *node.get("allOf", [])]:
            if "$ref" in option:
                node = schema["$defs"][option["$ref"].rsplit("/", 1)[-1]]
    return list(node.get("properties", {}))


def _similar_file(path: Path) -> str:
    siblings = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    return did_you_mean(path.name, sorted(siblings)) if siblings else ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
