"""Variants of household classes: real sizes, sound meshes, one orientation, and true symmetries."""

import hashlib
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from imodbatch.core.errors import ConfigError
from imodbatch.lab.scene import render_view
from imodbatch.lab.variants import RGBD5, make_distractor, make_instance

NUMBERS = range(8)
SYMMETRY_NUMBERS = range(12)
KINDS = (*RGBD5, "distractor")

# Centimetres: along x, along y, up; each from, to.
REAL_SIZES = {
    "bowl": ((10.5, 22.6), (10.5, 22.6), (4.4, 9.3)),
    "cap": ((21, 32), (14, 19), (7.5, 13.5)),
    "cereal_box": ((3, 10.5), (10.5, 27), (14.5, 39)),
    "coffee_mug": ((6.8, 10.2), (8.5, 14.5), (7.9, 12)),
    "soda_can": ((5, 7), (5, 7), (8.5, 17)),
    "distractor": ((0.5, 50), (0.5, 50), (0.5, 40)),
}

SAME = 4.0
"""Views that should be the same differ by less: mean over the object's pixels, of 255."""


@cache
def instance(kind, number):
    return make_distractor(number) if kind == "distractor" else make_instance(kind, number)


def fingerprint(model):
    parts = (model.mesh.vertices, model.mesh.faces, model.mesh.corner_uvs, model.mesh.texture)
    digest = hashlib.sha256()
    for part in parts:
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def view(model, azimuth_deg):
    image = render_view(model, np.deg2rad(azimuth_deg), np.deg2rad(35.0), 64).astype(np.float64)
    return image[..., :3] * image[..., 3:] / 255, image[..., 3] > 0


def difference(model, one_deg, other_deg):
    (one, one_mask), (other, other_mask) = view(model, one_deg), view(model, other_deg)
    return float(np.abs(one - other)[one_mask | other_mask].mean())


@pytest.mark.parametrize("kind", KINDS)
def test_name_and_real_size(kind):
    for number in NUMBERS:
        model = instance(kind, number)
        assert model.name == kind
        for value, (low, high) in zip(100 * model.mesh.extent_m, REAL_SIZES[kind], strict=True):
            assert low <= value <= high, number


@pytest.mark.parametrize("kind", KINDS)
def test_stands_on_the_origin(kind):
    for number in NUMBERS:
        vertices = instance(kind, number).mesh.vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        assert abs(low[2]) < 1e-6
        np.testing.assert_allclose((low + high)[:2], 0, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_meshes_are_closed_and_face_outward(kind):
    for number in NUMBERS:
        mesh = instance(kind, number).mesh
        assert len(mesh.faces) < 20_000
        start, end = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
        there = np.sort((start * len(mesh.vertices) + end).ravel())
        back = np.sort((end * len(mesh.vertices) + start).ravel())
        assert np.array_equal(there, back), number
        assert (np.diff(there) > 0).all(), number
        a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
        assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0, number
        assert mesh.corner_uvs.min() >= 0
        assert mesh.corner_uvs.max() <= 1
        assert np.isfinite(mesh.vertices).all()


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_differ(kind):
    assert len({fingerprint(instance(kind, number)) for number in NUMBERS}) == len(NUMBERS)


def test_colours_of_a_class_vary_widely():
    for kind in RGBD5:
        textures = [instance(kind, number).mesh.texture for number in NUMBERS]
        means = [texture.reshape(-1, 3).mean(axis=0) for texture in textures]
        assert np.std(means, axis=0).max() > 18, kind


def test_another_process_makes_the_same():
    code = (
        "import sys; sys.path.insert(0, {!r}); from test_variants import *; "
        "print(*(fingerprint(instance(kind, 3)) for kind in KINDS))"
    ).format(str(__file__).rsplit("/", 1)[0])
    command = [sys.executable, "-c", code]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert printed == [fingerprint(instance(kind, 3)) for kind in KINDS]


def test_the_order_of_making_does_not_matter():
    make_instance("cap", 5)
    assert fingerprint(make_instance("coffee_mug", 2)) == fingerprint(instance("coffee_mug", 2))


def test_the_mugs_handle_is_on_the_left():
    for number in NUMBERS:
        vertices = instance("coffee_mug", number).mesh.vertices
        # A round body reaches as far towards +x as towards −y of its axis; the handle lies beyond.
        radius = vertices[:, 0].max()
        axis_y = vertices[:, 1].min() + radius
        beyond = vertices[vertices[:, 1] > axis_y + radius + 0.005]
        assert len(beyond) > 20, number
        assert np.abs(beyond[:, 0]).max() < 0.02, number


def test_mugs_and_bowls_are_hollow():
    for kind in ("bowl", "coffee_mug"):
        seen_from_above = 0
        for number in NUMBERS:
            mesh = instance(kind, number).mesh
            axis_y = mesh.vertices[:, 1].min() + mesh.vertices[:, 0].max()
            near = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1] - axis_y) < 0.005
            highest = mesh.vertices[near, 2].max() / mesh.extent_m[2]
            assert highest < 0.95, (kind, number)
            seen_from_above += highest < 0.25
        assert seen_from_above > len(NUMBERS) / 3, kind


def test_the_caps_brim_is_in_front():
    for number in NUMBERS:
        vertices = instance("cap", number).mesh.vertices
        top = vertices[vertices[:, 2].argmax()]
        low = vertices[vertices[:, 2] < 0.3 * vertices[:, 2].max()]
        assert top[0] < 0, number  # The brim moves the crown back from the footprint's middle.
        assert vertices[vertices[:, 0] > 0.8 * low[:, 0].max(), 2].max() < 0.06, number


def test_the_boxs_largest_faces_look_along_x():
    for number in NUMBERS:
        extent = instance("cereal_box", number).mesh.extent_m
        assert extent[0] == extent.min(), number
        assert extent[0] < 0.6 * extent[2], number


def test_fronts_carry_prints():
    for kind in ("cereal_box", "soda_can"):
        for number in range(4):
            image = render_view(instance(kind, number), 0.0, 0.1, 64)[20:44, 24:40, :3]
            assert image.reshape(-1, 3).std(axis=0).max() > 8, (kind, number)


@pytest.mark.parametrize("kind", ["bowl", "cereal_box"])
def test_claimed_symmetries_are_true(kind):
    claims = 0
    for number in SYMMETRY_NUMBERS:
        model = instance(kind, number)
        if model.symmetry == "none":
            continue
        claims += 1
        steps = (45.0, 112.5) if model.symmetry == "full" else (360 / model.symmetry,)
        # The light moves with the camera, so that it tells no azimuth from another.
        assert max(difference(model, 30.0, 30.0 + step) for step in steps) < SAME, number
    assert claims > 2


def test_other_objects_have_a_front():
    for kind in ("cap", "coffee_mug", "soda_can"):
        assert all(instance(kind, number).symmetry == "none" for number in NUMBERS)
        for number in range(3):
            assert difference(instance(kind, number), 0.0, 90.0) > SAME, (kind, number)


def test_errors_say_what_is_expected():
    with pytest.raises(ConfigError, match=r"'mug'.*coffee_mug"):
        make_instance("mug", 0)
    with pytest.raises(ConfigError, match=r"-1.*bowl"):
        make_instance("bowl", -1)
    with pytest.raises(ConfigError, match="distractor"):
        make_distractor(-1)
