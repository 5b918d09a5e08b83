"""Boxes on paper and in the world: sound ones pass, and each wrong reading is told."""

import numpy as np
import pytest

from imodbatch.checkup.boxes import is_sound, other_readings
from imodbatch.checkup.lifted import BoxFrame, check_lifted, mirrored
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import exp_twist, make_transform

CAMERA = PinholeCamera(320, 240, 300.0, 300.0, 160.0, 120.0)


def box_scene(change: str | None) -> list[BoxFrame]:
    """Two things before a wall, seen by a moving camera; boxes changed as named."""
    things = np.array([[-0.4, 0.1, 2.0], [0.3, -0.2, 1.6]])
    frames = []
    for step in range(12):
        world_from_cam = make_transform(
            exp_twist([0, 0, 0, 0, 0.04 * step - 0.2, 0])[:3, :3], [0.05 * step, 0.02 * step, 0.0]
        )
        in_cam = (things - world_from_cam[:3, 3]) @ world_from_cam[:3, :3]
        middle = CAMERA.project(in_cam)
        boxes = np.hstack([middle - 12, middle + 12])
        depth = np.full((240, 320), 3.0, dtype=np.float32)
        for box, point in zip(boxes.round().astype(int), in_cam, strict=True):
            depth[max(box[1], 0) : box[3], max(box[0], 0) : box[2]] = point[2]
        if change is not None:
            boxes = mirrored(boxes, 320, 240)[change]
        frames.append(BoxFrame(depth, world_from_cam, boxes, ("cup", "bowl")))
    return frames


def test_sound_boxes_meet_in_the_world() -> None:
    outcome = check_lifted(box_scene(None), CAMERA)
    assert outcome.findings == ()
    assert not outcome.is_skipped


@pytest.mark.parametrize("change", list(mirrored(np.zeros((1, 4)), 1, 1))[:3])
def test_mirrored_boxes_are_told(change: str) -> None:
    outcome = check_lifted(box_scene(change), CAMERA)
    assert outcome.has_error
    assert change in outcome.findings[0].seen


def test_a_single_view_tells_nothing_of_boxes() -> None:
    assert check_lifted(box_scene(None)[:1], CAMERA).is_skipped
    assert check_lifted([], CAMERA).is_skipped


def test_each_reading_undoes_its_fault() -> None:
    boxes = np.array([[100.0, 50, 150, 90], [10, 20, 60, 200]])
    corner, other = boxes[:, :2], boxes[:, 2:]
    readings = other_readings(np.hstack([corner, other - corner]))
    np.testing.assert_allclose(
        readings["their last two numbers are width and height, read as a corner"], boxes
    )
    readings = other_readings(np.hstack([corner, corner + other]))
    np.testing.assert_allclose(
        readings["their last two numbers are a corner, read as width and height"], boxes
    )
    for name in mirrored(boxes, 320, 240):
        if "counts from" in name or "180" in name or "swapped" in name:
            twice = mirrored(mirrored(boxes, 320, 240)[name], 320, 240)[name]
            np.testing.assert_allclose(twice, boxes)


def test_sound_boxes() -> None:
    boxes = np.array(
        [[0.0, 0, 320, 240], [-1, -1, 5, 5], [5, 5, 5, 9], [-9, 0, 9, 9], [0, 0, 9, 250]]
    )
    assert is_sound(boxes, 320, 240).tolist() == [True, True, False, False, False]
