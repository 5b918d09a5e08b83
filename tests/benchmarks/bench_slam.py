"""SLAM beside open3d's hybrid RGB-D odometry, and its time per frame as a sequence grows.

    python tests/benchmarks/bench_slam.py MANIFEST [--frames N] [--repeat N] [--skip-open3d]

Both get the same images from memory, one after the other in one run. The manifest's sequences need
true poses (`[reference]`, or the dataset's own). With `--repeat`, each sequence is walked to and
fro until it has that many frames, which come in as new ones; the last column says how long a frame
took in the first, a middle and the last fifth of them.
"""

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.alignment import absolute_errors_m, align_poses
from imodbatch.core.frames import invert
from imodbatch.datasets import index
from imodbatch.datasets.registry import layout_of
from imodbatch.libraries.open3d_library import intrinsics, open3d, rgbd_image
from imodbatch.poses import association as poses
from imodbatch.poses import slam
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.run.plan import Plan
from imodbatch.run.posing import rgbd_frames
from imodbatch.settings.config import Pipeline, SlamConfig
from imodbatch.settings.manifest import load_manifest

Poses = NDArray[np.float64]
MAX_DEPTH_M = 4.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--frames", type=int, default=10**9, help="the first so many")
    parser.add_argument("--repeat", type=int, default=0, help="frames to walk to and fro")
    parser.add_argument("--skip-open3d", action="store_true")
    options = parser.parse_args()
    manifest = load_manifest(options.manifest)
    plan = Plan(manifest, Pipeline(), Path("bench"), manifest.sequences)
    for sequence in manifest.sequences:
        table = index.run(manifest, sequence).tables["frames"].slice(0, options.frames)
        layout = layout_of(manifest)
        reference = layout.reference(manifest, sequence) or layout.odometry(manifest, sequence)
        true = poses.from_odometry(table, reference, Pipeline().poses).poses.world_from_cam
        frames = in_memory(rgbd_frames(plan, table))
        if options.repeat:
            walk(frames, options.repeat)
            continue
        report(sequence.id, "slam", frames, true, slam_poses)
        if not options.skip_open3d:
            report(sequence.id, "open3d hybrid odometry", frames, true, open3d_poses)


def in_memory(frames: RgbdFrames) -> RgbdFrames:
    """The same frames, read before any clock runs."""
    color = [frames.read_color(i) for i in range(len(frames))]
    depth_m = [frames.read_depth(i) for i in range(len(frames))]
    return RgbdFrames(
        frames.sequence_id,
        frames.frame_index,
        frames.timestamp_ns,
        frames.camera,
        frames.color_files,
        color.__getitem__,
        depth_m.__getitem__,
    )


def report(
    name: str, method: str, frames: RgbdFrames, true: Poses, run: Callable[[RgbdFrames], Poses]
) -> None:
    start = time.perf_counter()
    found = run(frames)
    seconds = time.perf_counter() - start
    known = np.isfinite(found[:, 0, 0]) & np.isfinite(true[:, 0, 0])
    aligned = align_poses(true[known], found[known])
    errors = absolute_errors_m(true[known], found[known], aligned)
    rmse = float(np.sqrt(np.mean(np.square(errors))))
    print(
        f"{name} {method}: {len(frames)} frames, {known.sum()} located, ATE {100 * rmse:.2f} cm "
        f"(worst {100 * errors.max():.1f}), {len(frames) / seconds:.1f} frames/s",
        flush=True,
    )


def slam_poses(frames: RgbdFrames) -> Poses:
    return slam.estimate(frames, SlamConfig()).poses.world_from_cam


def open3d_poses(frames: RgbdFrames) -> Poses:
    """Frame to frame, at open3d's defaults; a pair that fails repeats the last pose."""
    odometry = open3d().pipelines.odometry
    images = []
    for position in range(len(frames)):
        depth_m = frames.read_depth(position)
        images.append(rgbd_image(frames.read_color(position), depth_m, MAX_DEPTH_M))
    found = [np.eye(4)]
    for old, new in pairwise(images):
        good, new_from_old, _ = odometry.compute_rgbd_odometry(
            old,
            new,
            intrinsics(frames.camera),
            np.eye(4),
            odometry.RGBDOdometryJacobianFromHybridTerm(),
            odometry.OdometryOption(),
        )
        found.append(found[-1] @ invert(new_from_old) if good else found[-1])
    return np.stack(found)


def walk(frames: RgbdFrames, n: int) -> None:
    """Time per frame on a walk to and fro."""
    there_and_back = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    order = [there_and_back[i % len(there_and_back)] for i in range(n)]
    longer = RgbdFrames(
        frames.sequence_id,
        np.arange(n),
        None,
        frames.camera,
        (),
        lambda i: frames.read_color(order[i]),
        lambda i: frames.read_depth(order[i]),
    )
    moments: list[float] = []

    def clock(items: range) -> range:
        for item in items:
            moments.append(time.perf_counter())
            yield item

    start = time.perf_counter()
    trajectory = slam.estimate(longer, SlamConfig(), clock)
    seconds = time.perf_counter() - start
    per_frame = np.diff(moments)
    fifths = [1000 * float(part.mean()) for part in np.array_split(per_frame, 5)]
    after = seconds - (moments[-1] - start)
    print(
        f"{frames.sequence_id}: {n} frames, {n / seconds:.1f} frames/s; ms per frame by fifths "
        f"{[round(f, 1) for f in fifths]}, {after:.1f} s at the end; {trajectory.summary}",
        flush=True,
    )


if __name__ == "__main__":
    main()
