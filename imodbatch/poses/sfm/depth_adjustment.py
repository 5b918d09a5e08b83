"""A last bundle adjustment in which depth has a say, and single frames settled likewise.

Images alone tell turning from stepping sideways only by small differences, so a reconstruction can
be slightly bent, or flattened along the line of sight, and still fit every pixel; and it follows
whatever the colour camera's calibration says. Depth knows better. It is used as slam uses it:
behind each pixel that sees a point, and as a surface that ties keyframes which look at the same
side of things (`imodbatch.poses.rgbd.adjustment`, `imodbatch.poses.rgbd.registration`).
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.depth import DepthImage
from imodbatch.core.frames import invert
from imodbatch.core.pairs import nearest_views
from imodbatch.poses.rgbd import RgbdFrames, measurement
from imodbatch.poses.rgbd.adjustment import Network, Tie, adjust
from imodbatch.poses.rgbd.features import SCALE_FACTOR, smooth_depth
from imodbatch.poses.rgbd.registration import bind, settle
from imodbatch.poses.rgbd.resection import MIN_FITTING, Sightings, refine
from imodbatch.poses.rgbd.surfaces import Surface, surface
from imodbatch.poses.sfm.colmap import Progress
from imodbatch.poses.sfm.mapping import Model, Sights

Array = NDArray[np.float64]
Target = tuple[Surface, Array]
N_NEXT, N_NEAREST = 3, 8  # keyframes that one is tied to: that follow it, and nearest in pose
N_PASSES, ROUNDS = 2, (6, 6)


def adjust_to_depth(frames: RgbdFrames, model: Model, progress: Progress) -> None:
    """Move a model's poses and points so that they fit pixels, depth and each other's surfaces.

    The first keyframe stays. Ties are measured once more where the first pass has put the
    keyframes, because surfaces find each other only from nearby.

    Args:
        frames: for their depth.
        model: in metres; it is changed.
        progress: wraps the keyframes.
    """
    keyframes = model.keyframes()
    surfaces, seen = [], []
    for keyframe in progress(keyframes):
        depth_m = _depth(frames, keyframe)
        surfaces.append(surface(depth_m, frames.camera))
        seen.append(_sightings(model.sights(keyframe), depth_m, frames.camera))
    all_ids = np.concatenate([model.point_ids(k) for k in keyframes])
    ids, point_of = np.unique(all_ids, return_inverse=True)
    points = np.zeros((len(ids), 3))
    points[point_of] = np.concatenate([s.points for s in seen])
    poses = np.stack([model.cam_from_world(k) for k in keyframes])
    for _ in range(N_PASSES):
        network = Network(
            cam_from_world=poses,
            moves=np.arange(len(keyframes)) > 0,
            points=points,
            camera_of=np.repeat(np.arange(len(keyframes)), [len(s.points) for s in seen]),
            point_of=point_of,
            measurements=np.concatenate([s.measurements for s in seen]),
            sigma=np.concatenate([s.sigma for s in seen]),
            ties=_ties(surfaces, poses),
        )
        adjusted = adjust(frames.camera, network, ROUNDS)
        poses, points = adjusted.cam_from_world, adjusted.points
    model.move(
        dict(zip(keyframes, poses, strict=True)), dict(zip(ids.tolist(), points, strict=True))
    )


def target(frames: RgbdFrames, model: Model, keyframe: int) -> Target:
    """Surface of a keyframe and its cam_from_world (4, 4), to settle frames on."""
    return surface(_depth(frames, keyframe), frames.camera), model.cam_from_world(keyframe)


def settle_on(
    targets: list[Target], frames: RgbdFrames, position: int, cam_from_world: Array, sights: Sights
) -> Array:
    """Better pose (4, 4) of a frame, by what it sees, the depth there, and its surface.

    Args:
        targets: of keyframes nearby.
        frames: for the frame's depth.
        position: of the frame.
        cam_from_world: (4, 4) where it was found by pixels.
        sights: what it was found by.
    """
    depth_m = _depth(frames, position)
    seen = _sightings(sights, depth_m, frames.camera)
    refined, good = refine(frames.camera, cam_from_world, seen)
    if good.sum() < MIN_FITTING:
        return cam_from_world
    samples = surface(depth_m, frames.camera).samples
    return settle(frames.camera, refined, seen.take(good), samples, targets).cam_from_world


def _depth(frames: RgbdFrames, position: int) -> DepthImage:
    """Depth (H, W) of a frame, all unknown where there is none."""
    depth_m = frames.read_depth(position)
    if depth_m is None:
        return np.full((frames.camera.height_px, frames.camera.width_px), np.nan, dtype=np.float32)
    return depth_m


def _sightings(sights: Sights, depth_m: DepthImage, camera: PinholeCamera) -> Sightings:
    """Pixels with the depth behind them; a feature twice as large is known half as well."""
    points_cam = camera.unproject(sights.pixels, smooth_depth(depth_m, sights.pixels))
    measurements = measurement.measured(sights.pixels, points_cam)
    octave = np.log(sights.scale_px) / np.log(SCALE_FACTOR)
    return Sightings(sights.points, measurements, measurement.sigmas(measurements, octave))


def _ties(surfaces: list[Surface], cam_from_world: Array) -> list[Tie]:
    """Relative poses of keyframes that follow each other or look at the same side from nearby."""
    numbers, world_from_cam = range(len(surfaces)), invert(cam_from_world)
    pairs = {(i, j) for i in numbers for j in range(i + 1, min(i + 1 + N_NEXT, len(surfaces)))}
    for i in numbers:
        pairs |= {(min(i, j), max(i, j)) for j in nearest_views(world_from_cam, i)[:N_NEAREST]}
    found = [bind(surfaces, cam_from_world, *pair) for pair in sorted(pairs)]
    return [tie for tie in found if tie is not None]
