"""Focal lengths of both cameras: by how features move, and by whether edges fall on edges.

The edges give the ratio of the two focal lengths, the features that of the colour camera. Of the
simple explanations (swapped, registered, one of them wrong) the one that fits both is named.
"""

from dataclasses import replace

import numpy as np

from imodbatch.checkup.edges import EdgeFit
from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, camera_settings, skipped
from imodbatch.checkup.focal import FocalFit
from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets.base import CameraModel

LEAST_EDGE_LOG, LEAST_EDGE_GAIN = float(np.log(1.03)), 1.08
LEAST_FOCAL_LOG, LEAST_FOCAL_GAIN = float(np.log(1.06)), 1.05
SURE_FOCAL_GAIN = 1.1
"""Below it a focal length off is a warning: lens distortion and odometry that turns too far or too
little look alike."""
SIGMAS = 4.0
EDGE_SIGMA, FOCAL_SIGMA = 0.015, 0.025
"""Least standard deviations of the logarithms when explanations are compared: cameras a few
centimetres apart and noisy poses bias both."""
FREE_COST = 6.0
"""What an explanation costs that can take any value, against one that is named."""
SQUARE_LOG = float(np.log(1.02))


def edges_differ(fit: EdgeFit | None) -> bool:
    """Whether edges say clearly that the ratio of the focal lengths is wrong."""
    if fit is None or fit.gain < LEAST_EDGE_GAIN:
        return False
    return abs(float(np.log(fit.size))) > max(LEAST_EDGE_LOG, SIGMAS * fit.sigma)


def focal_differs(fit: FocalFit | None) -> bool:
    """Whether features say clearly that the colour camera's focal length is wrong."""
    if fit is None or fit.gain < LEAST_FOCAL_GAIN:
        return False
    return abs(float(np.log(fit.factor))) > max(LEAST_FOCAL_LOG, SIGMAS * fit.sigma)


def check_registration(
    model: CameraModel, edges: EdgeFit | None, focal: FocalFit | None
) -> Outcome:
    """The check `registration`: do depth edges fall on colour edges?"""
    if edges is None:
        return skipped("registration", "too few depth edges in the sampled frames")
    across, down = edges.shift_px
    beside = f"; {across:+.0f}, {down:+.0f} px beside them" if (across or down) else ""
    summary = (
        f"depth edges fall on colour edges at {100 * edges.size:.0f} % of their size{beside} "
        f"({edges.n_views} views)"
    )
    if not edges_differ(edges):
        return Outcome("registration", summary)
    why, mend = _explain(model, edges, focal)
    seen = (
        f"Depth edges fall on colour edges when drawn at {100 * edges.size:.0f} % of their size, "
        f"{100 * (edges.gain - 1):.0f} % more of them than as the manifest has the cameras: {why}."
    )
    figures = {"size": edges.size, "gain": edges.gain}
    return Outcome("registration", summary, (Finding(ERROR, seen, mend, figures),))


def check_focal(
    model: CameraModel, edges: EdgeFit | None, focal: FocalFit | None, unsquare: Finding | None
) -> Outcome:
    """The check `focal_length` of the colour camera."""
    if unsquare is not None:
        return Outcome("focal_length", "", (unsquare,))
    if focal is None:
        return skipped("focal_length", "too few pairs of views whose features tell a motion")
    summary = (
        f"features move as with {100 * focal.factor:.0f} ± {100 * focal.sigma:.0f} % of the "
        f"manifest's ({focal.n_pairs} pairs)"
    )
    if not focal_differs(focal):
        return Outcome("focal_length", summary)
    if edges_differ(edges):
        return Outcome("focal_length", summary + ": see registration")
    fx, fy = model.color.fx_px * focal.factor, model.color.fy_px * focal.factor
    seen = (
        f"Features move as with a focal length of {fx:.0f} ± {fx * focal.sigma:.0f} px in place of "
        f"{model.color.fx_px:.0f} px (error {100 * (focal.gain - 1):.0f} % larger with the "
        "manifest's)."
    )
    mend = _lines("color", fx, fy)
    if model.depth != model.color:
        mend += _lines("depth", model.depth.fx_px * focal.factor, model.depth.fy_px * focal.factor)
        seen += " The edges of depth fit those of colour, so that of depth is as wrong."
    figures = {"factor": focal.factor, "gain": focal.gain}
    severity = ERROR if focal.gain >= SURE_FOCAL_GAIN else WARNING
    return Outcome("focal_length", summary, (Finding(severity, seen, mend, figures),))


def square_candidates(camera: PinholeCamera) -> dict[str, PinholeCamera]:
    """Cameras with square pixels, by the key that would change; empty if they are square."""
    if abs(np.log(camera.fx_px / camera.fy_px)) <= SQUARE_LOG:
        return {}
    return {
        "fx_px": replace(camera, fx_px=camera.fy_px),
        "fy_px": replace(camera, fy_px=camera.fx_px),
    }


def unsquare_finding(camera: PinholeCamera, costs: dict[str, float], as_given: float) -> Finding:
    """What to say of pixels that are not square.

    Args:
        camera: the colour camera.
        costs: log pixel errors of `square_candidates` by their keys; empty = unknown.
        as_given: that of the manifest's.
    """
    seen = (
        f"camera.color has fx = {camera.fx_px:g} and fy = {camera.fy_px:g} px: pixels of cameras "
        "are square, unless the images were resized unevenly."
    )
    if not costs:
        return Finding(WARNING, seen)
    key = min(costs, key=lambda k: costs[k])
    gain = float(np.exp(as_given - costs[key]))
    if gain < LEAST_FOCAL_GAIN:
        return Finding(WARNING, seen, figures={"gain": gain})
    value = camera.fy_px if key == "fx_px" else camera.fx_px
    seen += f" With {key} = {value:g} features fit {100 * (gain - 1):.0f} % better."
    return Finding(ERROR, seen, camera_settings("color", **{key: value}), {"gain": gain})


def _explain(
    model: CameraModel, edges: EdgeFit, focal: FocalFit | None
) -> tuple[str, tuple[str, ...]]:
    """The likeliest explanation and the lines that mend it."""
    color, depth = model.color, model.depth
    # images of two sizes: focal lengths are compared at the size of the colour image
    enlarged = color.width_px / depth.width_px
    depth_fx, depth_fy = depth.fx_px * enlarged, depth.fy_px * enlarged
    color_fx, color_fy = color.fx_px / enlarged, color.fy_px / enlarged
    ratio = float(np.log(depth_fx / color.fx_px))
    size = float(np.log(edges.size))
    # (log of the size of edges, log of the colour factor, cost, sentence, lines)
    options = [(size, 0.0, FREE_COST, *_depth_wrong(model, edges.size))]
    if depth != color:  # else both change together and edges stay where they are
        options.append((size, size, FREE_COST, *_color_wrong(color, edges.size)))
    if abs(ratio) > LEAST_EDGE_LOG:
        color_lines = _lines("color", depth_fx, depth_fy)
        depth_lines = _lines("depth", color_fx, color_fy)
        swapped = "the focal lengths of colour and depth are swapped"
        registered = "depth is registered to colour and has its focal length"
        both_depth = "both images have the focal length of depth"
        options += [
            (2 * ratio, ratio, 0.0, swapped, color_lines + depth_lines),
            (ratio, 0.0, 0.0, registered, depth_lines),
            (ratio, ratio, 0.0, both_depth, color_lines),
        ]

    def cost(option: tuple[float, float, float, str, tuple[str, ...]]) -> float:
        of_edges = (option[0] - size) / max(edges.sigma, EDGE_SIGMA)
        of_focal = 0.0
        if focal is not None:
            of_focal = (option[1] - np.log(focal.factor)) / max(focal.sigma, FOCAL_SIGMA)
        return float(of_edges**2 + of_focal**2 + option[2])

    best = min(options, key=cost)
    return best[3], best[4]


def _color_wrong(color: PinholeCamera, size: float) -> tuple[str, tuple[str, ...]]:
    fx, fy = color.fx_px * size, color.fy_px * size
    return f"the focal length of colour is about {fx:.0f} px", _lines("color", fx, fy)


def _depth_wrong(model: CameraModel, size: float) -> tuple[str, tuple[str, ...]]:
    depth = model.depth
    fx, fy = depth.fx_px / size, depth.fy_px / size
    lines = _lines("depth", fx, fy)
    if depth == model.color:
        lines = (
            *camera_settings("depth", width_px=depth.width_px, height_px=depth.height_px),
            *lines,
            *camera_settings("depth", cx_px=depth.cx_px, cy_px=depth.cy_px),
        )
    return f"the focal length of depth is about {fx:.0f} px", lines


def _lines(kind: str, fx_px: float, fy_px: float) -> tuple[str, ...]:
    return camera_settings(kind, fx_px=float(f"{fx_px:.5g}"), fy_px=float(f"{fy_px:.5g}"))
