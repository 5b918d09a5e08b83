"""docs/python.md: its code runs as it stands, block after block, and prints what it says."""

import re
from pathlib import Path

import pandas as pd
import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.lab.analytic.catalogue import CLASSES
from imodbatch.lab.analytic.render import shade, trace
from imodbatch.lab.analytic.sequence import make_walk
from imodbatch.lab.analytic.truth import true_objects

REPOSITORY = Path(__file__).parents[2]
PAGE = (REPOSITORY / "docs/python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)
N_FRAMES = 6


@pytest.fixture(scope="module")
def namespace():
    """What the page takes for given: a short walk past simulated objects, and what is true."""
    walk = make_walk(0, 0, 60)
    world_from_cam = walk.world_from_cam[:N_FRAMES]
    colors, depths, rows = [], [], []
    for frame_index, pose in enumerate(world_from_cam):
        traced = trace(walk.world, CAMERA, pose)
        colors.append(shade(walk.world, CAMERA, pose, traced))
        depths.append(traced.depth_m)
        for true in true_objects(walk.world, pose, traced):
            corners = dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), true.box_px, strict=True))
            name = {"class_name": CLASSES[true.class_id], "is_ignored": true.is_ignored}
            rows.append({"frame_index": frame_index, **name, **corners})
    annotations = pd.DataFrame(rows)

    def my_detector(image):
        frame = next(i for i, color in enumerate(colors) if color is image)
        for row in annotations[annotations.frame_index == frame].itertuples():
            yield (row.x0_px, row.y0_px, row.x1_px, row.y1_px), row.class_name, 0.8

    return {
        "colors": colors,
        "depths": depths,
        "world_from_cam": world_from_cam,
        "annotations": annotations,
        "my_detector": my_detector,
    }


def test_the_code_on_the_page_runs(namespace, capsys):
    for block in BLOCKS:
        exec(compile(block, "docs/python.md", "exec"), namespace)
    printed = capsys.readouterr().out
    said = re.findall(r"print\(.*\)  # (.*)", PAGE)
    assert len(said) == 2
    for line in said:
        assert line in printed
    assert (namespace["means"].value == 1.0).all()
    assert (namespace["poses"].status == "tracked").all()
    assert set(namespace["some"].frame_index) <= {0, 3}
    assert len(namespace["detections"]) > 0


def test_files_and_sections_that_the_page_names_are_there():
    for path in re.findall(r"\]\(([^)]+)\)", PAGE):
        assert (REPOSITORY / "docs" / path).exists(), path
    known = set(re.findall(r"(?m)^\[(\w+)\]", (REPOSITORY / "pipelines/default.toml").read_text()))
    named = set(re.findall(r"`\[(\w+)\]`", PAGE))
    assert named
    assert named <= known
    assert "(docs/python.md)" in (REPOSITORY / "README.md").read_text(encoding="utf-8")
