"""Blender as renderer: what it is asked for, and that it sees what the ray caster sees.

The second half needs bpy in the interpreter that IMODBATCH_BLENDER_PYTHON names, or in this one.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from imodbatch.core.errors import ConfigError
from imodbatch.lab import scene
from imodbatch.lab.objects import load_object
from imodbatch.lab.pictures.views import fitting_focal_px
from imodbatch.lab.render.blender import PROGRAM_VARIABLE, render_views
from imodbatch.lab.render.blender.program import NO_BPY, SCRIPT, command_of
from imodbatch.lab.render.blender.request import read_light, write_request
from imodbatch.lab.render.blender.views import picture_of
from imodbatch.lab.render.raycast import (
    Mesh,
    RenderSettings,
    Sky,
    SunLight,
    View,
    viewpoint_transform,
)

SUN = SunLight((1.0, 0.5, 2.0), (0.6, 0.6, 0.5), 0.1)
VIEW = View(0.4, 0.3, 32, 1.0, 100.0, lights=(SUN,), settings=RenderSettings(seed=7))
N_AZIMUTHS = 16
OBJECTS = ("building_block_house", "teacup")
ELEVATIONS_DEG = (10, 50)
LEAST_IOU = 0.97


def plate(albedo=255):
    """A square metre that faces up."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32) / 2
    return Mesh(
        corners,
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        np.array([[(0.1, 0.2)] * 3, [(0.3, 0.4)] * 3], np.float32),
        np.full((4, 4, 3), albedo, np.uint8),
        np.array([0.0, 0.2], np.float32),
        np.array([2.0, 30.0], np.float32),
    )


def test_a_request_holds_all_in_blenders_conventions(tmp_path):
    path = write_request(tmp_path, plate(), [VIEW, replace(VIEW, lights=())])
    content = json.loads(path.read_text())
    assert [len(view["suns"]) for view in content["views"]] == [1, 0]
    view = content["views"][0]
    assert (view["size_px"], view["focal_px"], view["seed"]) == (32, 100.0, 7)
    assert view["suns"][0]["irradiance"] == pytest.approx([0.6 * np.pi, 0.6 * np.pi, 0.5 * np.pi])
    assert view["suns"][0]["angle_rad"] == 0.2
    ours = viewpoint_transform(np.zeros(3), 0.4, 0.3, 1.0)
    theirs = np.array(view["object_from_camera"])
    assert theirs[:, 3] == pytest.approx(ours[:, 3])
    assert theirs[:3, :3] == pytest.approx(ours[:3, :3] * [1, -1, -1])
    arrays = np.load(tmp_path / "mesh.npz")
    assert arrays["corner_uvs"][0, 0] == pytest.approx([0.1, 0.8])
    assert arrays["face_material"].tolist() == [0, 1]
    assert "corner_normals" not in arrays
    assert content["materials"][0] == {"specular": 0.0, "roughness": pytest.approx(0.5**0.25)}
    assert not content["does_texture_repeat"]
    assert cv2.imread(str(tmp_path / "texture.png")).shape == (4, 4, 3)


@pytest.mark.parametrize("height", [1.0, 0.3, -1.0])
def test_the_sky_gives_surfaces_what_ours_gives(tmp_path, height):
    """Light from all directions, weighted with the cosine to a normal of some height."""
    sky = Sky((0.6, 0.5, 0.4), (0.3, 0.2, 0.2))
    entry = json.loads(write_request(tmp_path, plate(), [replace(VIEW, sky=sky)]).read_text())
    bottom, top = (entry["views"][0]["sky"][key][0] for key in ("from_bottom", "from_top"))
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    light = bottom + (top - bottom) * (0.5 + 0.5 * directions[:, 2])
    cosine = np.maximum(directions @ [np.sqrt(1 - height**2), 0, height], 0)
    expected = 0.3 + (0.6 - 0.3) * (0.5 + 0.5 * height)
    assert (light * cosine).sum() / cosine.sum() == pytest.approx(expected, abs=0.005)


def test_light_becomes_a_picture_with_straight_alpha():
    light = np.zeros((1, 3, 4), np.float32)
    light[0, 0] = (0.2, 0.1, 0.0, 1.0)
    light[0, 1] = (0.1, 0.05, 0.0, 0.5)
    picture = picture_of(light, 1.0)
    assert picture[0, :, 3].tolist() == [255, 128, 0]
    assert picture[0, 0, :3].tolist() == picture[0, 1, :3].tolist()
    assert not picture[0, 2].any()


def test_an_interpreter_or_blender_itself_runs_the_script():
    request = Path("request.json")
    assert command_of("python3.11", request) == ["python3.11", str(SCRIPT), "request.json"]
    line = command_of("programs/blender", request)
    assert line[1] == "--background"
    assert line[-3:] == [str(SCRIPT), "--", "request.json"]


def test_without_bpy_one_line_says_what_to_do(monkeypatch, tmp_path):
    bare = tmp_path / "bare"
    bare.write_text(f"#!/bin/sh\nexit {NO_BPY}\n")
    bare.chmod(0o755)
    for program, found in ((bare, "has no module bpy"), (tmp_path / "none", "does not start")):
        monkeypatch.setenv(PROGRAM_VARIABLE, str(program))
        with pytest.raises(ConfigError, match=found) as error:
            next(render_views(plate(), [VIEW]))
        assert "pip install 'imodbatch[blender]' (Python 3.11), or name an" in str(error.value)
        assert PROGRAM_VARIABLE in str(error.value)
        assert "\n" not in str(error.value)


def test_the_script_says_that_there_is_no_bpy(tmp_path):
    (tmp_path / "bpy.py").write_text("raise ImportError")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, SCRIPT, "none.json"], env=environment, check=False)
    assert done.returncode == NO_BPY


def test_when_blender_fails_its_last_words_are_told(monkeypatch, tmp_path):
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\necho first\necho out of memory\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv(PROGRAM_VARIABLE, str(broken))
    with pytest.raises(ConfigError, match="status 1: out of memory"):
        next(render_views(plate(), [VIEW]))
    with pytest.raises(ConfigError, match="no picture of view 0"):
        read_light(tmp_path, 0)


@pytest.fixture(scope="module")
def _blender():
    program = os.environ.get(PROGRAM_VARIABLE) or sys.executable
    if Path(program).name.lower().startswith("blender"):
        return
    done = subprocess.run([program, "-c", "import bpy"], capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f"{program} has no module bpy; name one that has in {PROGRAM_VARIABLE}")


def turntable(model, elevation_rad, azimuth_bins, size_px=96, roll_rad=0.05):
    azimuths = [b * 2 * np.pi / N_AZIMUTHS for b in azimuth_bins]
    focal_px = min(
        fitting_focal_px(model.mesh, a, elevation_rad, 0.6, roll_rad, size_px) for a in azimuths
    )
    return [
        View(a, elevation_rad, size_px, 0.6, focal_px, roll_rad, (SUN,), Sky()) for a in azimuths
    ]


def grey_crop(rgba):
    """Brightness (48, 48) of what lies within the box around the object, black around it."""
    x, y, width, height = cv2.boundingRect((rgba[..., 3] > 127).astype(np.uint8))
    grey = cv2.cvtColor(rgba, cv2.COLOR_RGB2GRAY) * (rgba[..., 3] / 255.0)
    return cv2.resize(grey[y : y + height, x : x + width], (48, 48), interpolation=cv2.INTER_AREA)


def correlation(first, second):
    return float(np.corrcoef(first.ravel(), second.ravel())[0, 1])


@pytest.mark.usefixtures("_blender")
@pytest.mark.parametrize("name", OBJECTS)
def test_blender_sees_the_same_object_from_the_same_side(name):
    """Outlines overlap, and of 16 azimuths the ray caster's best match is the right one."""
    model = load_object(name)
    chosen = range(0, N_AZIMUTHS, 2)
    rows = [turntable(model, np.deg2rad(e), range(N_AZIMUTHS)) for e in ELEVATIONS_DEG]
    asked = [row[a] for row in rows for a in chosen]
    pictures = iter(list(scene.render_views(model, asked, "blender")))
    for row in rows:
        references = list(scene.render_views(model, row))
        crops = [grey_crop(reference) for reference in references]
        for azimuth_bin in chosen:
            picture = next(pictures)
            ours, theirs = references[azimuth_bin][..., 3] > 127, picture[..., 3] > 127
            iou = (ours & theirs).sum() / (ours | theirs).sum()
            assert iou >= LEAST_IOU, (azimuth_bin, iou)
            scores = [correlation(grey_crop(picture), crop) for crop in crops]
            assert int(np.argmax(scores)) == azimuth_bin, scores


@pytest.mark.usefixtures("_blender")
def test_a_plate_is_as_bright_as_by_the_ray_caster():
    dull = replace(plate(128), face_specular=np.zeros(2, np.float32))
    dark = Sky((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    from_sun = replace(VIEW, elevation_rad=0.9, sky=dark, focal_px=300.0)
    from_sky = replace(from_sun, sky=Sky((0.6, 0.5, 0.4), (0.2, 0.2, 0.2)), lights=())
    views = [from_sun, from_sky]
    for view, picture in zip(views, render_views(dull, views), strict=True):
        ours = scene.raycast.render_views(dull, [view])
        expected = next(ours)[8:24, 8:24, :3].mean(axis=(0, 1))
        found = picture[8:24, 8:24, :3].mean(axis=(0, 1))
        assert found == pytest.approx(expected, abs=3)
