"""SIFT features of the keyframes, written into COLMAP's database.

OpenCV's SIFT finds them: it is about twice as fast as COLMAP's on a processor, and takes images
as the project reads them, so that a file format COLMAP does not know, or a damaged file, is no
matter here. Descriptors are stored as COLMAP stores its own (RootSIFT, Arandjelović 2012).
"""

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.rgbd.gray import HALF_PX, Gray, read_gray
from imodbatch.poses.sfm.colmap import Progress, colmap_camera, pycolmap

CONTRAST = 0.02  # COLMAP's peak threshold, as opencv counts it: 3 layers × 0.0067
QUANTUM = 512.0
Features = tuple[NDArray[np.float32], NDArray[np.uint8]]


def write_features(
    database: Any, frames: RgbdFrames, keyframes: list[int], max_features: int, progress: Progress
) -> None:
    """Write camera, images and features of the keyframes; image ids are positions + 1.

    Args:
        database: an empty COLMAP database.
        frames: the sequence.
        keyframes: positions.
        max_features: strongest features kept per image.
        progress: wraps the loop.
    """
    colmap = pycolmap()
    camera = colmap_camera(frames.camera)
    database.write_camera(camera, use_camera_id=True)
    rig = colmap.Rig(rig_id=1)
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)
    sift = cv2.SIFT.create(
        nfeatures=max_features, contrastThreshold=CONTRAST, enable_precise_upscale=True
    )
    root = image_root(frames)
    for position in progress(keyframes):
        gray = read_gray(frames, position)
        if gray is None:
            continue
        _write_image(database, position, image_name(frames.color_files[position], root))
        keypoints, descriptors = describe(sift, gray)
        database.write_keypoints(position + 1, keypoints)
        kind = colmap.FeatureExtractorType.SIFT
        database.write_descriptors(position + 1, colmap.FeatureDescriptors(kind, descriptors))


def feature_scales(database: Path, keyframes: list[int]) -> dict[int, NDArray[np.float64]]:
    """Sizes (N,) in pixels of the features that `write_features` wrote, by keyframe."""
    opened = pycolmap().Database.open(database)
    try:
        read = {k: np.asarray(opened.read_keypoints(k + 1)) for k in keyframes}
    finally:
        opened.close()
    return {k: keypoints[:, 2].astype(np.float64) for k, keypoints in read.items()}


def image_root(frames: RgbdFrames) -> Path:
    """The folder that all colour images share; COLMAP's image names are relative to it."""
    return Path(os.path.commonpath([path.absolute().parent for path in frames.color_files]))


def image_name(path: Path, root: Path) -> str:
    """Name of an image in COLMAP, whose list of pairs is split at spaces."""
    return path.absolute().relative_to(root).as_posix().replace(" ", "%20")


def describe(sift: Any, gray: Gray) -> Features:
    """Keypoints (n, 4), x, y, scale, angle, and RootSIFT descriptors (n, 128) of an image."""
    found, raw = sift.detectAndCompute(gray, None)
    if raw is None or len(found) == 0:
        return np.zeros((0, 4), dtype=np.float32), np.zeros((0, 128), dtype=np.uint8)
    rows = [(*k.pt, k.size / 2, np.radians(k.angle)) for k in found]
    keypoints = np.array(rows, dtype=np.float32)
    keypoints[:, :2] += HALF_PX
    share = raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-9)
    return keypoints, np.minimum(np.rint(QUANTUM * np.sqrt(share)), 255).astype(np.uint8)


def _write_image(database: Any, position: int, name: str) -> None:
    colmap = pycolmap()
    image = colmap.Image(name=name, camera_id=1, image_id=position + 1)
    frame = colmap.Frame(frame_id=position + 1, rig_id=1)
    frame.add_data_id(image.data_id)
    image.frame_id = database.write_frame(frame, use_frame_id=True)
    database.write_image(image, use_image_id=True)
