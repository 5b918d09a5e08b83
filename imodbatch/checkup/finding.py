"""What a check says: passed, skipped with a reason, or findings with the line that mends them."""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["error", "warning"]
ERROR: Severity = "error"
WARNING: Severity = "warning"


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or may be.

    Attributes:
        severity: an error spoils the results; a warning deserves a look.
        seen: what was seen, with its figures, a sentence.
        mend: lines for the manifest, ``[section] key = value`` each; empty where no manifest line
            can mend it (then `seen` says what can).
        figures: the figures by name, unit in the name.
    """

    severity: Severity
    seen: str
    mend: tuple[str, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The same for a JSON file, which knows no NaN."""
        figures = {k: v if math.isfinite(v) else None for k, v in self.figures.items()}
        return {**vars(self), "mend": list(self.mend), "figures": figures}


@dataclass(frozen=True)
class Outcome:
    """What became of one check.

    Attributes:
        check: its name.
        summary: in a few words what was measured, or why nothing could be.
        findings: none = passed.
        is_skipped: nothing could be measured.
    """

    check: str
    summary: str
    findings: tuple[Finding, ...] = ()
    is_skipped: bool = False

    @property
    def has_error(self) -> bool:
        """Whether an error is among the findings."""
        return any(finding.severity == ERROR for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """The same for a JSON file."""
        return {
            "check": self.check,
            "state": "skipped" if self.is_skipped else "found" if self.findings else "passed",
            "summary": self.summary,
            "findings": [finding.as_json() for finding in self.findings],
        }


def skipped(check: str, why: str) -> Outcome:
    """A check that could not be made."""
    return Outcome(check, why, is_skipped=True)


def failed(check: str, seen: str, mend: tuple[str, ...] = (), **figures: float) -> Outcome:
    """A check that found one error and has nothing else to tell."""
    return Outcome(check, "", (Finding(ERROR, seen, mend, figures),))


def setting(section: str, key: str, value: object) -> str:
    """A line for the manifest: ``[camera] depth.scale_m = 0.001``."""
    return f"[{section}] {key} = {_toml(value)}"


def camera_settings(kind: str, **values: float) -> tuple[str, ...]:
    """Lines for one of the cameras, ``[camera] depth.fx_px = 525.0`` each."""
    return tuple(setting("camera", f"{kind}.{key}", value) for key, value in values.items())


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    if isinstance(value, float):
        return repr(float(f"{value:.6g}"))
    if isinstance(value, dict):
        inner = ", ".join(f"{_toml(str(k))} = {_toml(v)}" for k, v in value.items())
        return "{ " + inner + " }"
    return str(value)
