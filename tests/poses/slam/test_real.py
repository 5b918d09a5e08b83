"""Real frames of a kitchen: the engine against the dataset's own poses."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rooms import frames_of, freeze

from imodbatch.core.alignment import absolute_errors_m, align_poses, summarise
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import register
from imodbatch.datasets import index
from imodbatch.datasets.images import read_color, read_depth
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.poses.slam import estimate
from imodbatch.settings.config import SlamConfig
from imodbatch.settings.manifest import load_manifest

pytestmark = pytest.mark.skipif(
    not os.environ.get("IMODBATCH_DATA"), reason="IMODBATCH_DATA is not set: no real frames"
)
MANIFEST = Path(__file__).parents[3] / "manifests" / "redkitchen.toml"
BLANKED = slice(20, 40)


@cache
def kitchen():
    """Colour, registered depth, camera and true poses of the first 60 frames."""
    manifest = load_manifest(MANIFEST)
    section = manifest.sequences[0].model_copy(update={"frames": "0:60"})
    rows = index.run(manifest, section).tables["frames"].to_pylist()
    invalid = camera_model(manifest).depth_invalid
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    camera, of_depth = (
        PinholeCamera(*(rows[0][prefix + name] for name in names)) for prefix in ("", "depth_")
    )
    colors, depths = [], []
    for row in rows:
        colors.append(freeze(read_color(manifest.root_path / row["color_path"])))
        depth = read_depth(manifest.root_path / row["depth_path"], row["depth_scale_m"], invalid)
        depths.append(freeze(register(depth, of_depth, camera, None)))
    odometry = layout_of(manifest).odometry(manifest, section)
    return colors, depths, camera, odometry.world_from_color


def ate_m(poses, truth):
    return summarise(absolute_errors_m(truth, poses, align_poses(truth, poses)))


def test_sixty_frames_of_a_kitchen():
    colors, depths, camera, truth = kitchen()
    trajectory = estimate(frames_of(colors, depths, camera), SlamConfig())
    assert (trajectory.poses.status == "tracked").all()
    error = ate_m(trajectory.poses.world_from_cam, truth)
    assert error.n == 60
    assert error.rmse < 0.02
    assert error.largest < 0.04


def test_a_third_of_a_kitchen_goes_missing():
    colors, depths, camera, truth = kitchen()
    black = freeze(np.zeros_like(colors[0]))
    unknown = freeze(np.full_like(depths[0], np.nan))
    n = BLANKED.stop - BLANKED.start
    colors = [*colors[: BLANKED.start], *[black] * n, *colors[BLANKED.stop :]]
    depths = [*depths[: BLANKED.start], *[unknown] * n, *depths[BLANKED.stop :]]
    trajectory = estimate(frames_of(colors, depths, camera), SlamConfig())
    status = trajectory.poses.status
    assert (status[: BLANKED.start] == "tracked").all()
    assert (status[BLANKED] == "lost").all()
    assert (status[BLANKED.stop + 2 :] == "tracked").all()
    assert trajectory.figures["slam_relocalised"] >= 1
    assert trajectory.figures["slam_parts"] == 1
    assert ate_m(trajectory.poses.world_from_cam, truth).rmse < 0.02
