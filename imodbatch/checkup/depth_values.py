"""The numbers of depth images: enough of them, and none for "unknown" that is taken for metres."""

import numpy as np
from numpy.typing import NDArray

from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, setting, skipped
from imodbatch.checkup.views import View
from imodbatch.datasets.base import CameraModel

FEWEST_KNOWN = 0.1
SPIKE_SHARE = 0.002
SPIKE_RATIO = 3.0
"""Of the largest number against the next one below it, which a surface would not leave so far."""
STRIDE_PX = 4


def check_depth_values(model: CameraModel, views: list[View]) -> Outcome:
    """The check `depth_values`."""
    check = "depth_values"
    if not views:
        return skipped(check, "no frame with readable depth")
    sampled = [view.depth_m[::STRIDE_PX, ::STRIDE_PX] for view in views]
    known = float(np.mean([np.isfinite(depth).mean() for depth in sampled]))
    numbers = np.concatenate([depth[np.isfinite(depth)] for depth in sampled])
    summary = f"{100 * known:.0f} % of the pixels have a depth"
    if len(numbers) == 0:
        return Outcome(check, summary, (Finding(ERROR, "No depth pixel is known in any frame."),))
    findings = []
    if known < FEWEST_KNOWN:
        seen = f"Only {100 * known:.1f} % of the depth pixels are known. Check depth.invalid."
        findings.append(Finding(WARNING, seen, figures={"known_share": known}))
    spike = unknown_as_number(np.rint(numbers / model.depth_scale_m))
    if spike is not None:
        share = float((np.rint(numbers / model.depth_scale_m) == spike).mean())
        seen = (
            f"The depth images hold the number {spike} in {100 * share:.1f} % of their pixels and "
            f"nothing near it: it seems to mean 'unknown', not {spike * model.depth_scale_m:.3g} m."
        )
        invalid = sorted({*model.depth_invalid, spike})
        mend = (setting("camera", "depth.invalid", invalid),)
        findings.append(Finding(ERROR, seen, mend, {"share": share}))
    return Outcome(check, summary, tuple(findings))


def unknown_as_number(numbers: NDArray[np.floating]) -> int | None:
    """The largest number if it is frequent and far above all others."""
    largest = float(numbers.max())
    others = numbers[numbers < largest]
    if len(others) == 0 or float((numbers == largest).mean()) < SPIKE_SHARE:
        return None
    return int(largest) if largest > SPIKE_RATIO * float(others.max()) else None


def median_depth_m(views: list[View]) -> float:
    """Median over frames of their median depth; NaN without any."""
    medians = [
        float(np.median(depth[np.isfinite(depth)]))
        for view in views
        if np.isfinite(depth := view.depth_m[::STRIDE_PX, ::STRIDE_PX]).any()
    ]
    return float(np.median(medians)) if medians else float("nan")
