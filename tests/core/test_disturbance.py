"""Noise on poses has the size it claims, and points go where the disturbed camera takes them."""

import numpy as np
import pytest

from imodbatch.core.disturbance import KINDS, carried_along, unit_noise
from imodbatch.core.frames import apply, exp_twist, invert, make_transform

N_FRAMES, N_DRAWS = 40, 4000


def many_draws(kind):
    """(draws, F, 3)."""
    rng = np.random.default_rng(7)
    return np.stack([unit_noise(N_FRAMES, kind, rng) for _ in range(N_DRAWS)])


def rms(vectors):
    """(draws, F, 3) → RMS length of each frame's vector (F,)."""
    return np.sqrt((vectors**2).sum(axis=-1).mean(axis=0))


def test_jitter_has_its_level_in_every_frame_and_every_direction():
    noise = many_draws("jitter")
    assert rms(noise) == pytest.approx(np.ones(N_FRAMES), abs=0.04)
    one_axis = np.sqrt((noise**2).mean(axis=(0, 1)))
    assert one_axis == pytest.approx(np.full(3, 1 / np.sqrt(3)), abs=0.01)
    neighbours = (noise[:, 1:] * noise[:, :-1]).sum(axis=-1).mean()
    assert neighbours == pytest.approx(0.0, abs=0.01)


def test_drift_starts_at_nothing_and_reaches_its_level_as_a_random_walk():
    noise = many_draws("drift")
    assert not noise[:, 0].any()
    assert rms(noise) == pytest.approx(np.sqrt(np.linspace(0, 1, N_FRAMES)), abs=0.04)
    steps = np.diff(noise, axis=1)
    assert rms(steps) == pytest.approx(np.full(N_FRAMES - 1, (N_FRAMES - 1) ** -0.5), rel=0.05)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_frames", [0, 1, 2])
def test_few_frames_are_no_trouble(kind, n_frames):
    assert unit_noise(n_frames, kind, np.random.default_rng(0)).shape == (n_frames, 3)


def rotation_from_vector(vector_rad):
    return exp_twist(np.concatenate([np.zeros_like(vector_rad), vector_rad], axis=-1))[..., :3, :3]


def test_rotations_turn_by_the_length_of_their_vector():
    vectors = np.random.default_rng(1).normal(size=(50, 3))
    rotations = rotation_from_vector(vectors)
    assert rotations @ np.swapaxes(rotations, -1, -2) == pytest.approx(
        np.broadcast_to(np.eye(3), (50, 3, 3))
    )
    assert np.einsum("nij,nj->ni", rotations, vectors) == pytest.approx(vectors)  # the axis stays
    cosine = (np.trace(rotations, axis1=1, axis2=2) - 1) / 2
    assert cosine == pytest.approx(np.cos(np.linalg.norm(vectors, axis=1)))
    quarter = rotation_from_vector(np.array([0, 0, np.pi / 2]))
    assert quarter @ [1, 0, 0] == pytest.approx([0, 1, 0])
    assert np.array_equal(rotation_from_vector(np.zeros(3)), np.eye(3))


def test_points_stay_where_they_were_in_the_camera():
    rng = np.random.default_rng(2)
    points, centers, shifts, turns = rng.normal(size=(4, 30, 3))
    world_from_cam = make_transform(rotation_from_vector(rng.normal(size=(30, 3))), centers)
    rotation = rotation_from_vector(turns) @ world_from_cam[:, :3, :3]
    disturbed = make_transform(rotation, centers + shifts)
    expected = apply(disturbed, apply(invert(world_from_cam), points))
    assert carried_along(points, centers, shifts, turns) == pytest.approx(expected)


def test_no_disturbance_changes_no_bit():
    points, centers = np.random.default_rng(3).normal(size=(2, 30, 3))
    still = np.zeros((30, 3))
    assert np.array_equal(carried_along(points, centers, still, still), points)
