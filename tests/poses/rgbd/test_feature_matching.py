"""Matching: against counting bits and measuring distances one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imodbatch.poses.rgbd.features import Features
from imodbatch.poses.rgbd.matching import (
    Expected,
    hamming,
    mutual_matches,
    near,
    projection_matches,
)


def descriptors(rng, n):
    return rng.integers(0, 2**64, (n, 4), dtype=np.uint64)


def flipped(rng, descriptor, n_bits):
    """The same with some bits turned over."""
    bits = np.unpackbits(descriptor.view(np.uint8))
    bits[rng.permutation(256)[:n_bits]] ^= 1
    return np.packbits(bits).view(np.uint64)


def features_at(pixels, words, octave=None):
    n = len(pixels)
    octave = np.zeros(n, dtype=np.int64) if octave is None else np.asarray(octave)
    return Features(np.asarray(pixels, dtype=np.float64), octave, words, np.full((n, 3), np.nan))


def test_hamming_counts_bits():
    rng = np.random.default_rng(0)
    a, b = descriptors(rng, 20), descriptors(rng, 20)
    expected = [
        sum((int(x) ^ int(y)).bit_count() for x, y in zip(p, q, strict=True))
        for p, q in zip(a, b, strict=True)
    ]
    assert hamming(a, b).tolist() == expected
    assert hamming(a, ~a).tolist() == [256] * 20
    assert hamming(a, a).tolist() == [0] * 20


@pytest.mark.parametrize("seed", range(5))
def test_mutual_matches_find_the_pairs(seed):
    rng = np.random.default_rng(seed)
    a = descriptors(rng, 60)
    order = rng.permutation(60)[:40]
    b = np.concatenate([[flipped(rng, a[i], 25) for i in order], descriptors(rng, 15)])
    found_a, found_b = mutual_matches(a, b)
    assert found_b.tolist() == [order.tolist().index(i) for i in found_a]
    assert sorted(found_a) == sorted(order)
    back_b, back_a = mutual_matches(b, a)
    assert set(zip(back_a, back_b, strict=True)) == set(zip(found_a, found_b, strict=True))


def test_what_is_not_clear_is_no_match():
    rng = np.random.default_rng(1)
    one = descriptors(rng, 1)
    a = np.concatenate([one, descriptors(rng, 5)])
    twins = np.stack([flipped(rng, one[0], 20), flipped(rng, one[0], 21)])
    assert len(mutual_matches(a, np.concatenate([twins, descriptors(rng, 3)]))[0]) == 0
    assert len(mutual_matches(a, descriptors(rng, 200))[0]) == 0  # nothing is near enough


@pytest.mark.parametrize(("n_a", "n_b"), [(0, 0), (0, 5), (5, 0), (1, 5), (5, 1)])
def test_too_few_to_compare(n_a, n_b):
    rng = np.random.default_rng(2)
    assert [len(p) for p in mutual_matches(descriptors(rng, n_a), descriptors(rng, n_b))] == [0, 0]


@given(
    st.integers(0, 2**31), st.integers(1, 150), st.integers(1, 70), st.floats(0.5, 60),
    st.sampled_from([(320, 240), (100, 61), (16, 16), (33, 31)]),
)  # fmt: skip
@settings(max_examples=60)
def test_near_is_brute_force(seed, n_features, n_queries, radius, size):
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(0, size, (n_features, 2))
    # some in the same place
    pixels[::5] = np.round(pixels[::5] / 16) * 16
    pixels = np.minimum(pixels, np.array(size) - 1e-9)
    queries = rng.uniform(-40, np.array(size) + 40, (n_queries, 2))
    queries[::4] = np.round(queries[::4] / 16) * 16
    radii = rng.uniform(0.2, 1, n_queries) * radius
    query, feature = near(features_at(pixels, descriptors(rng, n_features)), queries, radii)
    distance = np.linalg.norm(queries[:, None] - pixels[None], axis=2)
    expected = np.argwhere(distance < radii[:, None])
    found = sorted(zip(query.tolist(), feature.tolist(), strict=True))
    clear = np.abs(distance - radii[:, None]).min() > 1e-9
    assert len(found) == len(set(found))
    assert found == [tuple(pair) for pair in expected.tolist()] or not clear


def test_near_with_nothing_there():
    nothing = features_at(np.zeros((0, 2)), np.zeros((0, 4), dtype=np.uint64))
    query, feature = near(nothing, np.array([[5.0, 5.0]]), np.array([9.0]))
    assert len(query) == len(feature) == 0
    some = features_at([[5, 5]], np.zeros((1, 4), dtype=np.uint64))
    query, _ = near(some, np.zeros((0, 2)), np.zeros(0))
    assert len(query) == 0


def project(expected_pixels, words, features, octave=None, radius=10.0):
    n = len(expected_pixels)
    octave = np.zeros(n) if octave is None else np.asarray(octave, dtype=np.float64)
    expected = Expected(np.asarray(expected_pixels, dtype=np.float64), octave, words)
    point, feature = projection_matches(expected, features, radius)
    return dict(zip(point.tolist(), feature.tolist(), strict=True))


def test_a_point_gets_the_likest_feature_nearby():
    rng = np.random.default_rng(3)
    words = descriptors(rng, 2)
    like = np.stack(
        [flipped(rng, words[0], 30), flipped(rng, words[0], 10), words[0], descriptors(rng, 1)[0]]
    )
    features = features_at([[101, 100], [104, 100], [120, 100], [50, 52]], like)
    # the third is too far away, the fourth is unlike
    assert project([[100, 100], [50, 50]], words, features) == {0: 1}


def test_one_to_one():
    rng = np.random.default_rng(4)
    word = descriptors(rng, 1)[0]
    words = np.stack([flipped(rng, word, n) for n in (30, 12, 25)])
    features = features_at([[100, 100], [200, 100]], np.stack([word, descriptors(rng, 1)[0]]))
    assert project([[99, 100], [100, 101], [102, 100]], words, features) == {1: 0}


@pytest.mark.parametrize("seed", range(4))
def test_many_are_one_to_one_and_allowed(seed):
    rng = np.random.default_rng(seed)
    words = descriptors(rng, 40)
    pixels = rng.uniform(0, (320, 240), (40, 2))
    pick = rng.integers(0, 40, 120)
    features = features_at(
        pixels[pick] + rng.normal(0, 4, (120, 2)),
        np.stack([flipped(rng, words[i], rng.integers(0, 90)) for i in pick]),
        rng.integers(0, 4, 120),
    )
    octave = rng.uniform(0, 3, 40)
    found = project(pixels, words, features, octave)
    assert len(set(found.values())) == len(found) > 5
    for point, feature in found.items():
        assert pick[feature] == point
        assert hamming(words[point], features.descriptors[feature]) <= 64
        assert abs(octave[point] - features.octave[feature]) <= 1.5


def test_octaves_that_do_not_fit():
    rng = np.random.default_rng(5)
    words = descriptors(rng, 1)
    features = features_at([[100, 100]], words, [3])
    assert project([[100, 100]], words, features, [3.0]) == {0: 0}
    assert project([[100, 100]], words, features, [1.6]) == {0: 0}
    assert project([[100, 100]], words, features, [1.4]) == {}


def test_no_points_or_no_features():
    rng = np.random.default_rng(6)
    none = np.zeros((0, 4), dtype=np.uint64)
    assert project(np.zeros((0, 2)), none, features_at([[5, 5]], descriptors(rng, 1))) == {}
    assert project([[5, 5]], descriptors(rng, 1), features_at(np.zeros((0, 2)), none)) == {}
