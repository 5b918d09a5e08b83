"""The map: points and keyframes, places seen again, and finding a frame in it."""

import numpy as np
import pytest
from rooms import CAMERA, Room, filmed, look, off, render

from imodbatch.core.frames import apply, exp_twist, invert
from imodbatch.poses.rgbd.features import FeatureExtractor, Features
from imodbatch.poses.rgbd.matching import hamming
from imodbatch.poses.rgbd.resection import MIN_FITTING
from imodbatch.poses.rgbd.surfaces import surface
from imodbatch.poses.slam.frame import Frame
from imodbatch.poses.slam.landmarks import MIN_SHARED, NO_POINT, Keyframe, Landmarks
from imodbatch.poses.slam.places import Places
from imodbatch.poses.slam.refinement import move_keyframe, refine_around
from imodbatch.poses.slam.tracking import follow, recognise


def features(rng, n, share_with_depth=1.0):
    pixels = rng.uniform((0, 0), (320, 240), (n, 2))
    depth = np.where(rng.uniform(size=n) < share_with_depth, rng.uniform(1, 3, n), np.nan)
    return Features(
        pixels,
        rng.integers(0, 8, n),
        rng.integers(0, 2**64, (n, 4), dtype=np.uint64),
        CAMERA.unproject(pixels, depth),
    )


NOWHERE = surface(np.full((240, 320), np.nan, dtype=np.float32), CAMERA)


def add(landmarks, some, point_ids=None, pose=None, part=0):
    ids = np.full(len(some), NO_POINT) if point_ids is None else np.array(point_ids)
    pose = np.eye(4) if pose is None else pose
    frame = Frame(some, NOWHERE, CAMERA)
    return landmarks.add_keyframe(Keyframe(len(landmarks.keyframes), frame, pose, ids, part))


def test_a_keyframe_makes_points_of_what_has_depth():
    rng = np.random.default_rng(0)
    landmarks, some = Landmarks(), features(rng, 3000, 0.7)  # more than fit at first
    pose = exp_twist(rng.normal(size=6))
    assert add(landmarks, some, pose=pose) == 0
    keyframe = landmarks.keyframes[0]
    assert landmarks.n_points == some.has_depth.sum()
    assert ((keyframe.point_ids != NO_POINT) == some.has_depth).all()
    assert (landmarks.anchor == 0).all()
    places = apply(pose, landmarks.positions[keyframe.seen])
    assert places == pytest.approx(some.points_cam[some.has_depth])


def test_points_it_already_has_are_not_made_again():
    rng = np.random.default_rng(1)
    landmarks = Landmarks()
    add(landmarks, features(rng, 40))
    ids = np.where(np.arange(30) < 20, np.arange(30), NO_POINT)
    add(landmarks, features(rng, 30), ids)
    assert landmarks.n_points == 50
    assert landmarks.keyframes[1].point_ids.tolist() == [*range(20), *range(40, 50)]
    assert landmarks.anchor.tolist() == [0] * 40 + [1] * 10


def test_neighbours_share_points_most_first():
    rng = np.random.default_rng(2)
    landmarks = Landmarks()
    add(landmarks, features(rng, 100))
    for shared in (30, MIN_SHARED - 1, 60):
        add(landmarks, features(rng, 80), [*range(shared), *[NO_POINT] * (80 - shared)])
    landmarks.update_neighbours(0)
    assert landmarks.keyframes[0].neighbours == [3, 1]
    assert landmarks.surroundings(0) == [0, 3, 1]
    assert landmarks.n_shared(np.arange(100)).tolist() == [100, 30, MIN_SHARED - 1, 60]
    first, second = landmarks.keyframes[1].seen, landmarks.keyframes[3].seen
    assert set(landmarks.points_of([1, 3])) == {*first, *second}


def test_merging_makes_one_of_two():
    rng = np.random.default_rng(3)
    landmarks = Landmarks()
    add(landmarks, features(rng, 10))
    add(landmarks, features(rng, 10))
    add(landmarks, features(rng, 4), [2, 12, 15, NO_POINT])
    landmarks.merge(np.array([2, 5]), np.array([12, 15]))
    assert landmarks.keyframes[0].point_ids.tolist() == list(range(10))
    expected = [10, 11, 2, 13, 14, 5, 16, 17, 18, 19]
    assert landmarks.keyframes[1].point_ids.tolist() == expected
    # saw both of a pair: once is enough
    assert landmarks.keyframes[2].point_ids.tolist() == [2, NO_POINT, 5, 20]


def test_merging_nothing():
    landmarks = Landmarks()
    add(landmarks, features(np.random.default_rng(4), 5))
    landmarks.merge(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    assert landmarks.keyframes[0].point_ids.tolist() == list(range(5))


def test_what_a_camera_should_see():
    rng = np.random.default_rng(5)
    landmarks, some = Landmarks(), features(rng, 50)
    pose = exp_twist(rng.normal(size=6))
    add(landmarks, some, pose=pose)
    ids, places, expected = landmarks.expected(np.arange(50), pose)
    assert ids.tolist() == list(range(50))
    assert places == pytest.approx(some.points_cam)
    assert expected.octave == pytest.approx(some.octave)
    assert (hamming(expected.descriptors, some.descriptors) == 0).all()
    # from twice as far a point looks as from a coarser octave
    back = exp_twist(np.array([0, 0, 3.0, 0, 0, 0])) @ pose
    ids, places, expected = landmarks.expected(np.arange(50), back)
    ratio = np.linalg.norm(places, axis=1) / np.linalg.norm(some.points_cam[ids], axis=1)
    assert expected.octave == pytest.approx(some.octave[ids] - np.log(ratio) / np.log(1.2))


def test_what_is_behind_or_seen_from_the_other_side_is_not_expected():
    landmarks, some = Landmarks(), features(np.random.default_rng(6), 50)
    add(landmarks, some)
    turned = exp_twist(np.array([0, 0, 0, 0, np.pi, 0]))
    assert len(landmarks.expected(np.arange(50), turned)[0]) == 0
    opposite = turned @ exp_twist(np.array([0, 0, -8.0, 0, 0, 0]))
    assert (apply(opposite, some.points_cam)[:, 2] > 1).all()
    assert len(landmarks.expected(np.arange(50), opposite)[0]) == 0


def test_a_keyframe_moves_with_its_points_and_the_sides_they_are_seen_from():
    landmarks, some = Landmarks(), features(np.random.default_rng(7), 50)
    add(landmarks, some)
    elsewhere = exp_twist(np.array([3.0, -1, 2, 0.4, 2.5, -0.3]))
    move_keyframe(landmarks, 0, elsewhere)
    assert apply(elsewhere, landmarks.positions) == pytest.approx(some.points_cam)
    ids, places, _ = landmarks.expected(np.arange(50), elsewhere)
    assert len(ids) == 50
    assert places == pytest.approx(some.points_cam)


def test_points_that_stay_and_points_of_others_do_not_move():
    rng = np.random.default_rng(8)
    landmarks = Landmarks()
    add(landmarks, features(rng, 10))
    add(landmarks, features(rng, 10))
    before = landmarks.positions.copy()
    move_keyframe(landmarks, 0, exp_twist(np.ones(6)), np.arange(20) % 2 == 0)
    moved = np.abs(landmarks.positions - before).max(axis=1) > 1e-9
    assert moved.tolist() == [i < 10 and i % 2 == 0 for i in range(20)]


def altered(rng, descriptors, n_bits):
    bits = np.unpackbits(descriptors.view(np.uint8), axis=1)
    for row in bits:
        row[rng.permutation(256)[:n_bits]] ^= 1
    return np.packbits(bits, axis=1).view(np.uint64)


@pytest.mark.parametrize("seed", range(5))
def test_a_seen_place_ranks_first_among_fifty(seed):
    """A third of its features again, each with a tenth of its bits turned over."""
    rng = np.random.default_rng(seed)
    places = Places()
    seen = [rng.integers(0, 2**64, (300, 4), dtype=np.uint64) for _ in range(51)]
    for descriptors in seen:
        places.add(descriptors)
    wanted = int(rng.integers(0, 51))
    new = rng.integers(0, 2**64, (200, 4), dtype=np.uint64)
    scores = places.scores(np.concatenate([altered(rng, seen[wanted][:100], 26), new]))
    assert scores.shape == (51,)
    assert scores.argmax() == wanted
    assert scores[wanted] > 1.2 * np.median(scores)


def test_real_features_of_a_place_rank_first():
    extractor = FeatureExtractor(CAMERA, 400)
    places = Places()
    views = [(0.0, 0), (40.0, 1), (80.0, 0), (120.0, 0), (160.0, 1), (200.0, 0), (240.0, 2)]
    for azimuth, seed in views:
        shown = render(Room(seed=seed), look([-0.2, -0.2, 1.3], azimuth))
        places.add(extractor.extract(*shown).descriptors)
    for number, (azimuth, seed) in enumerate(views):
        shown = render(Room(seed=seed), look([-0.15, -0.23, 1.33], azimuth + 4, 12))
        assert places.scores(extractor.extract(*shown).descriptors).argmax() == number


def test_places_of_nothing():
    none = np.zeros((0, 4), dtype=np.uint64)
    places = Places()
    assert places.scores(none).shape == (0,)
    places.add(none)
    some = np.random.default_rng(0).integers(0, 2**64, (5, 4), dtype=np.uint64)
    assert places.scores(some).tolist() == [0]
    places.add(some)
    assert places.scores(none).tolist() == [0, 0]
    assert places.scores(some).argmax() == 1


def seen_frames(positions):
    """Features of some frames of the walk, and their true cam_from_world."""
    colors, depths, poses = filmed(Room(), "walk")
    extractor = FeatureExtractor(CAMERA, 600)
    found = [
        extractor.extract(np.ascontiguousarray(colors[i][..., 0]), depths[i]) for i in positions
    ]
    return [Frame(some, NOWHERE, CAMERA) for some in found], invert(poses[list(positions)])


def mapped(frame, pose):
    landmarks = Landmarks()
    add(landmarks, frame.features, pose=pose)
    return landmarks


def pose_errors(found, truth):
    metres, radians = off(
        np.stack([np.eye(4), invert(found)]), np.stack([np.eye(4), invert(truth)])
    )
    return metres[1], radians[1]


def test_following_from_a_wrong_guess():
    (one, other), truth = seen_frames((0, 4))
    landmarks = mapped(one, truth[0])
    everything = np.arange(landmarks.n_points)
    located = follow(other, landmarks, everything, everything, [truth[0]] * 2, 10**6)
    metres, radians = pose_errors(located.cam_from_world, truth[1])
    assert metres < 0.006
    assert radians < 0.004
    assert len(np.unique(located.point_ids)) == len(located.rows) == len(np.unique(located.rows))
    assert len(located.rows) >= MIN_FITTING


def test_recognising_without_a_guess():
    (one, other), truth = seen_frames((0, 12))
    landmarks = mapped(one, truth[0])
    located = recognise(other, landmarks, landmarks.keyframes[0], np.arange(landmarks.n_points))
    metres, radians = pose_errors(located.cam_from_world, truth[1])
    assert metres < 0.02
    assert radians < 0.012


def test_another_room_is_neither_followed_nor_recognised():
    (one,), truth = seen_frames((0,))
    landmarks = mapped(one, truth[0])
    everything = np.arange(landmarks.n_points)
    shown = render(Room(seed=9), invert(truth[0]))
    stranger = Frame(FeatureExtractor(CAMERA, 600).extract(*shown), NOWHERE, CAMERA)
    assert follow(stranger, landmarks, everything, everything, [truth[0]] * 2, 100) is None
    assert recognise(stranger, landmarks, landmarks.keyframes[0], everything) is None


def test_refining_one_keyframe_alone_changes_nothing():
    (one,), truth = seen_frames((0,))
    landmarks = mapped(one, truth[0])
    before = landmarks.positions.copy()
    refine_around(landmarks, 0)
    assert np.array_equal(landmarks.positions, before)
    assert np.array_equal(landmarks.keyframes[0].cam_from_world, truth[0])
