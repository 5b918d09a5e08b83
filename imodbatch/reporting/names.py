"""How methods, metrics and numbers are called and shown, the same in every table and plot."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import get_args

from imodbatch.core.fusion import Method

DASH = "\N{EN DASH}"
OFFLINE = "_offline"
NAMES = {
    "single": "single view",
    "naive": "naive sum",
    "naive_log": "log-odds sum (SLAM-aware rule)",
    "imod": "imod (Konno 2020)",
}
COLORS = {"single": "#57534e", "naive": "#d97706", "naive_log": "#9d4edd", "imod": "#0369a1"}
UNKNOWN_COLOR = "#111827"
AP_METRICS = {
    "ap_voc07_11pt": "AP, 11 points (VOC 2007)",
    "ap_area": "AP, area under the curve",
    "ap_coco": "AP@[.50:.95] (COCO)",
}


@dataclass(frozen=True)
class MethodStyle:
    """A method's name and its looks in every plot."""

    method: str
    name: str
    color: str
    is_dashed: bool


def method_style(method: str) -> MethodStyle:
    """Name and looks of a method; an unknown one keeps its own name."""
    base = method.removesuffix(OFFLINE)
    is_offline = base != method
    name = NAMES.get(base, base) + (", all frames" if is_offline else "")
    return MethodStyle(method, name, COLORS.get(base, UNKNOWN_COLOR), is_offline)


def in_order(methods: Iterable[str]) -> tuple[str, ...]:
    """Methods without repeats: baselines before imod, online before offline, unknown ones last."""
    order = {name: i for i, name in enumerate(get_args(Method))}

    def place(method: str) -> tuple[bool, int, str]:
        base = method.removesuffix(OFFLINE)
        return method != base, order.get(base, len(order)), method

    return tuple(sorted(set(methods), key=place))


def number(value: float | None, digits: int = 3) -> str:
    """A figure, or a dash where it is unknown."""
    if value is None or math.isnan(value):
        return DASH
    return f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A share in percent with one decimal, without the sign."""
    return number(None if value is None else 100 * value, 1)


def plural(n: int, noun: str) -> str:
    """``3 boxes`` but ``1 box``; thousands are set apart."""
    if n != 1:
        noun += "es" if noun.endswith(("x", "s")) else "s"
    return f"{n:,} {noun}"
