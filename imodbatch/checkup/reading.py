"""From what the images say of the poses to findings: convention, timing, units."""

import numpy as np

from imodbatch.checkup.claims import Claim, Order, Verdict
from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, failed, setting
from imodbatch.checkup.motions import Motions
from imodbatch.checkup.subject import Subject
from imodbatch.checkup.units import (
    FARTHEST_M,
    NEAREST_M,
    POSE_UNITS_M,
    Units,
    explain_scale,
    likely_depth_scale,
    snapped,
)
from imodbatch.datasets.base import NS_PER_MS
from imodbatch.settings.sections import OdometrySection

OTHER_CONVENTION = {"world_from_cam": "cam_from_world", "cam_from_world": "world_from_cam"}
OTHER_ORDER = {"xyzw": "wxyz", "wxyz": "xyzw"}
UNEXPLAINED_RATIO, UNEXPLAINED_PX = 8.0, 10.0
SURELY_NOT_A_ROOM = 3.0
"""A median depth this many times beyond the usual range is an error, less a warning."""


def order_of(section: OdometrySection | None) -> Order | None:
    """The order that quaternions of a file were read with; None = it has none."""
    if section is None or section.format not in ("tum", "uw"):
        return None
    return "xyzw" if section.scalar_is_last else "wxyz"


def odometry_lines(subject: Subject, changes: dict[str, object]) -> tuple[str, ...]:
    """Lines for `[odometry]`; all keys of the section where the manifest has none yet."""
    section = subject.odometry_section
    if subject.manifest.odometry is None and section is not None:
        given = section.model_dump(exclude_unset=True)
        changes = {**given, **changes}
    return tuple(setting("odometry", key, value) for key, value in changes.items())


def check_convention(subject: Subject, verdict: Verdict, motions: Motions) -> Outcome:
    """The check `pose_convention`: inverse or not, and where the quaternion's w stands."""
    section, best = subject.odometry_section, verdict.best
    changes: dict[str, object] = {}
    said = []
    if best.claim.is_inverse:
        convention = "world_from_cam" if section is None else section.convention
        changes["convention"] = OTHER_CONVENTION[convention]
        said.append(f"they are {OTHER_CONVENTION[convention]}, not {convention}")
    if best.claim.has_other_order:
        order = order_of(section) or "xyzw"
        changes["quaternion_order"] = OTHER_ORDER[order]
        said.append(f"their quaternions are {OTHER_ORDER[order]}, not {order}")
    figures = {
        "error_px": verdict.given.error_px,
        "best_error_px": best.error_px,
        "floor_px": verdict.floor_px,
    }
    findings = []
    if said:
        seen = (
            f"The poses do not mean what the manifest says: {' and '.join(said)}. Features lie "
            f"{verdict.given.error_px:.1f} px from where depth and poses put them, "
            f"{best.error_px:.1f} px when read so."
        )
        findings.append(Finding(ERROR, seen, odometry_lines(subject, changes), figures))
    elif verdict.rivals:
        seen = (
            f"Images do not tell the poses as read ({best.error_px:.1f} px) from "
            f"{' or '.join(_named(rival) for rival in verdict.rivals)}: between the sampled views "
            f"the camera moves {np.median(motions.baseline_m):.3f} m and turns "
            f"{np.degrees(np.median(motions.angle_rad)):.1f}° only."
        )
        findings.append(Finding(WARNING, seen, figures=figures))
    elif _is_unexplained(verdict):
        seen = (
            f"Poses and images disagree: features lie {best.error_px:.1f} px from where depth and "
            f"poses put them, {verdict.floor_px:.1f} px by the images alone, and no other reading "
            "of the poses does better. Estimate them (poses.source = 'slam'), or check that they "
            "belong to this sequence."
        )
        findings.append(Finding(WARNING, seen, figures=figures))
    summary = (
        f"features lie {best.error_px:.1f} px from where depth and poses put them "
        f"({verdict.floor_px:.1f} px by images alone, {verdict.n_pairs} pairs)"
    )
    return Outcome("pose_convention", summary, tuple(findings))


def _named(rival: Claim) -> str:
    names = ["their inverse"] * rival.is_inverse + ["the other quaternion order"] * (
        rival.has_other_order
    )
    return " with ".join(names) or "the manifest's reading"


def _is_unexplained(verdict: Verdict) -> bool:
    limit = max(UNEXPLAINED_RATIO * verdict.floor_px, UNEXPLAINED_PX)
    return verdict.best.error_px > limit


def check_timing(subject: Subject, verdict: Verdict) -> Outcome:
    """The check `pose_timing`: whether images fit the poses of other frames better."""
    lag, best = verdict.best.claim.lag, verdict.best
    if lag == 0:
        return Outcome("pose_timing", "no other lag of poses fits the images better")
    stamps, section = subject.timestamp_ns, subject.odometry_section
    n = abs(lag)
    order = "late" if lag > 0 else "early"
    seen = (
        f"Poses come {n} frame{'s' if n > 1 else ''} {order}: image i fits the pose given to image "
        f"i {'+' if lag > 0 else '−'} {n} ({best.error_px:.1f} px in place of "
        f"{verdict.given.error_px:.1f} px)"
    )
    figures = {"lag_frames": float(lag), "error_px": verdict.given.error_px}
    mend: tuple[str, ...] = ()
    if stamps is not None and len(stamps) > 1:
        late_ms = lag * float(np.median(np.diff(stamps))) / NS_PER_MS
        figures["lag_ms"] = late_ms
        seen += f", that is {abs(late_ms):.0f} ms"
        if section is not None and section.format in ("tum", "csv"):
            offset_ms = float(round(section.clock_offset_ms - late_ms))
            mend = odometry_lines(subject, {"clock_offset_ms": offset_ms})
    if not mend:
        seen += (
            f". The file's poses belong {n} frames {'earlier' if lag > 0 else 'later'}: renumber"
        )
        seen += " them, or check that no frame is missing"
    return failed("pose_timing", seen + ".", mend, **figures)


def check_units(subject: Subject, verdict: Verdict | None, median_depth_m: float) -> Outcome:
    """The check `units`: of depth and of poses, by parallax and by what a room looks like."""
    section = subject.odometry_section
    given = Units(subject.cameras.depth_scale_m, 1.0 if section is None else section.unit_m)
    scale = float("nan") if verdict is None else verdict.best.claim.scale
    if verdict is not None and scale != 1.0:
        return Outcome("units", "", (_scale_finding(subject, verdict, given, median_depth_m),))
    ratio = float("nan") if verdict is None else verdict.scale
    summary = f"median depth {median_depth_m:.2f} m"
    summary += (
        f"; baselines by images are {ratio:.2f} of those by poses"
        if np.isfinite(ratio)
        else "; too little parallax to compare with poses"
    )
    if NEAREST_M <= median_depth_m <= FARTHEST_M:
        return Outcome("units", summary)
    likely = likely_depth_scale(given.depth_scale_m, median_depth_m)
    beyond = max(median_depth_m / FARTHEST_M, NEAREST_M / median_depth_m)
    change = likely / given.depth_scale_m
    severity = ERROR if beyond > SURELY_NOT_A_ROOM and change != 1.0 else WARNING
    seen = (
        f"The median depth is {median_depth_m:.4g} m; rooms and tables are seen from "
        f"{NEAREST_M} to {FARTHEST_M:.0f} m."
    )
    mend: tuple[str, ...] = ()
    if change != 1.0:
        seen += f" It would be {median_depth_m * change:.2f} m with another unit."
        mend = (setting("camera", "depth.scale_m", likely),)
        if np.isfinite(ratio):
            unit_m = snapped(given.pose_unit_m * change, POSE_UNITS_M)
            mend += odometry_lines(subject, {"unit_m": unit_m})
            seen += " The poses agree with the depth, so both units must change."
    return Outcome(
        "units", summary, (Finding(severity, seen, mend, {"median_depth_m": median_depth_m}),)
    )


def _scale_finding(
    subject: Subject, verdict: Verdict, given: Units, median_depth_m: float
) -> Finding:
    scale = verdict.best.claim.scale
    cure = explain_scale(scale, given, median_depth_m)
    depth_m = median_depth_m * cure.depth_scale_m / given.depth_scale_m
    seen = (
        f"Depth and poses disagree on scale: baselines by images and depth are {scale:.4g} times "
        f"those of the poses; the median depth is {median_depth_m:.4g} m. "
    )
    mend: tuple[str, ...]
    if cure.pose_unit_m == given.pose_unit_m:
        seen += f"The unit of depth is wrong: the median would be {depth_m:.2f} m."
        mend = (setting("camera", "depth.scale_m", cure.depth_scale_m),)
    else:
        seen += "The unit of the poses is wrong."
        mend = odometry_lines(subject, {"unit_m": cure.pose_unit_m})
    figures = {"scale": scale, "median_depth_m": median_depth_m}
    return Finding(ERROR, seen, mend, figures)
