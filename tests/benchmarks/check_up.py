"""Up from depth planes against up from edges in the colour images: `check_up.py MANIFEST`.

Rooms have upright edges (cupboards, door frames, table legs) and two ways that level edges run.
Each line segment spans a plane with the camera's centre that holds the direction of its edge, so
a direction is what lies in as many of these planes as possible. Up is known twice: upright edges
run along it, and both kinds of level edges run across it. No depth is used, so edges and planes err
independently, but for the poses. Spreads are those of resampled runs of consecutive frames; the two
are put together by their inverse covariances.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from imodbatch.core.camera import PinholeCamera
from imodbatch.datasets import index
from imodbatch.run.plan import Plan
from imodbatch.run.posing import TRAJECTORY_SOURCES, estimate_up
from imodbatch.settings.config import load_pipeline
from imodbatch.settings.manifest import load_manifest

Array = np.ndarray
MAX_FRAMES = 120
MIN_LENGTH_PX = 40.0
WITHIN_DEG = 45.0  # of the cameras' mean up
INLIER_DEG = 1.5
LEVEL_WITHIN_DEG = 10.0
N_HYPOTHESES, N_DIRECTIONS = 2000, 6
N_RUNS, N_RESAMPLES = 15, 200


@dataclass(frozen=True)
class Segments:
    """Line segments of all frames: unit normals (S, 3) in the world, lengths, and their frames."""

    normals: Array
    length_px: Array
    frame: Array


def segments_of(image: Array, camera: PinholeCamera) -> tuple[Array, Array]:
    """Normals (S, 3) of the planes through the camera and each long segment, and lengths."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector().detect(gray)[0]
    if found is None:
        return np.zeros((0, 3)), np.zeros(0)
    ends = found.reshape(-1, 2, 2).astype(np.float64) + 0.5  # OpenCV counts from pixel centres
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    ends, length = ends[length >= MIN_LENGTH_PX], length[length >= MIN_LENGTH_PX]
    rays = camera.unproject(ends, np.ones(ends.shape[:2]))
    normals = np.cross(rays[:, 0], rays[:, 1])
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True), length


def off_deg(segments: Segments, direction: Array) -> Array:
    """How far each segment's plane is from holding a direction."""
    return np.degrees(np.arcsin(np.clip(np.abs(segments.normals @ direction), 0, 1)))


@dataclass(frozen=True)
class Edges:
    """The directions (3,) of upright edges and of two kinds of level ones."""

    upright: Array
    level: tuple[Array, Array]

    @property
    def across(self) -> Array:
        """Up, as the direction across the level edges."""
        cross = np.cross(*self.level)
        return cross / np.linalg.norm(cross) * np.sign(cross @ self.upright)


def edges_of(segments: Segments, camera_up: Array) -> Edges:
    """The directions that most edges run along.

    They are found one after the other, each without the edges of those before: level edges are
    the most, and many of their planes nearly hold other directions, too.
    """
    rng = np.random.default_rng(0)
    rest, directions = segments, []
    for _ in range(N_DIRECTIONS):
        directions.append(main_direction(rest, rng))
        rest = chosen(rest, off_deg(rest, directions[-1]) >= INLIER_DEG)
    directions.sort(key=lambda d: -length_along(segments, d))
    signed = [d * np.sign(d @ camera_up) for d in directions]
    upright = next(d for d in signed if d @ camera_up > np.cos(np.radians(WITHIN_DEG)))
    level = [d for d in directions if abs(d @ upright) < np.sin(np.radians(LEVEL_WITHIN_DEG))]
    second = next(d for d in level[1:] if abs(d @ level[0]) < np.cos(np.radians(WITHIN_DEG)))
    return Edges(upright, (level[0], second))


def fitted(segments: Segments, edges: Edges) -> Edges:
    """The same directions, fitted to other segments."""
    level = (refined(segments, edges.level[0]), refined(segments, edges.level[1]))
    return Edges(refined(segments, edges.upright), level)


def main_direction(segments: Segments, rng: np.random.Generator) -> Array:
    """The direction that lies in the planes of most length of segments."""
    pairs = rng.integers(len(segments.normals), size=(N_HYPOTHESES, 2))
    crosses = np.cross(segments.normals[pairs[:, 0]], segments.normals[pairs[:, 1]])
    length = np.linalg.norm(crosses, axis=-1, keepdims=True)
    crosses = (crosses / np.where(length > 0, length, 1))[length[:, 0] > 0.05]
    return refined(segments, max(crosses, key=lambda c: length_along(segments, c)))


def length_along(segments: Segments, direction: Array) -> float:
    """Length of the segments that may run along a direction."""
    return float(segments.length_px[off_deg(segments, direction) < INLIER_DEG].sum())


def chosen(segments: Segments, rows: Array) -> Segments:
    """Some of the segments."""
    return Segments(segments.normals[rows], segments.length_px[rows], segments.frame[rows])


def refined(segments: Segments, direction: Array) -> Array:
    """Least squares with Tukey's weights, so that leaning edges have no say."""
    for _ in range(20):
        ratio = np.clip(off_deg(segments, direction) / (2 * INLIER_DEG), 0, 1)
        weights = segments.length_px * (1 - ratio**2) ** 2
        scatter = (segments.normals * weights[:, None]).T @ segments.normals
        smallest = np.linalg.eigh(scatter)[1][:, 0]
        direction = smallest * np.sign(smallest @ direction)
    return direction


def resampled(segments: Segments, edges: Edges) -> list[Edges]:
    """Edges fitted to runs of consecutive frames, drawn with replacement."""
    rng = np.random.default_rng(1)
    run = segments.frame * N_RUNS // (segments.frame.max() + 1)
    rows_of = [np.flatnonzero(run == r) for r in range(N_RUNS)]
    draws = rng.integers(N_RUNS, size=(N_RESAMPLES, N_RUNS))
    return [
        fitted(chosen(segments, np.concatenate([rows_of[r] for r in draw])), edges)
        for draw in draws
    ]


def together(a: Array, b: Array, spread_a: Array, spread_b: Array) -> tuple[Array, float]:
    """Mean of two directions by the inverse covariances of their resamples (R, 3), and its std."""
    across = np.linalg.svd(a[None])[2][1:]
    inverse_a = np.linalg.inv(np.cov((spread_a @ across.T).T))
    inverse_b = np.linalg.inv(np.cov((spread_b @ across.T).T))
    covariance = np.linalg.inv(inverse_a + inverse_b)
    mean = a + (covariance @ inverse_b @ across @ (b - a)) @ across
    worst = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return mean / np.linalg.norm(mean), float(np.degrees(worst))


def spread_deg(directions: Array, mean: Array) -> float:
    """Root mean square angle of directions (R, 3) to one."""
    return float(np.sqrt(np.mean([angle_deg(d, mean) ** 2 for d in directions])))


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two unit vectors."""
    return float(np.degrees(2 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b), 0, 1))))


def collect(plan: Plan, rows: list, world_from_cam: Array) -> Segments:
    """Segments of frames with poses, spread over the sequence."""
    usable = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
    picked = np.unique(np.linspace(0, len(usable) - 1, MAX_FRAMES).astype(int))
    normals, lengths, frames = [], [], []
    for position, i in enumerate(usable[picked]):
        names = PinholeCamera.__dataclass_fields__
        camera = PinholeCamera(**{name: rows[i][name] for name in names})
        found, length = segments_of(plan.read_color(rows[i]["color_path"]), camera)
        normals.append(found @ world_from_cam[i, :3, :3].T)
        lengths.append(length)
        frames.append(np.full(len(length), position))
    return Segments(np.concatenate(normals), np.concatenate(lengths), np.concatenate(frames))


def main() -> None:
    """Print the directions, and the angles between them, for each sequence."""
    manifest = load_manifest(Path(sys.argv[1]))
    plan = Plan(manifest, load_pipeline(None, []), Path(), manifest.sequences)
    for part in plan.each():
        sequence = part.sequence
        frames = index.run(manifest, sequence, iter).tables["frames"]
        trajectory = TRAJECTORY_SOURCES["odometry"](part, frames, iter)
        poses = trajectory.poses.world_from_cam
        start = time.perf_counter()
        planes = estimate_up(part, frames, poses, iter)
        seconds = time.perf_counter() - start
        segments = collect(part, frames.to_pylist(), poses)
        camera_up = -np.nanmean(poses[:, :3, 1], axis=0)
        edges = edges_of(segments, camera_up / np.linalg.norm(camera_up))
        draws = resampled(segments, edges)
        uprights = np.stack([draw.upright for draw in draws])
        levels = np.stack([draw.across for draw in draws])
        both, both_deg = together(edges.upright, edges.across, uprights, levels)
        rows = [
            ("upright edges", edges.upright, spread_deg(uprights, edges.upright)),
            ("level edges", edges.across, spread_deg(levels, edges.across)),
            ("both", both, both_deg),
        ]
        print(f"{sequence.id}: {planes} ({seconds:.1f} s)")
        given = manifest.world.direction()
        if given is not None:
            rows.append(("up as given", np.array(given) / np.linalg.norm(given), 0.0))
        for name, direction, off in rows:
            print(
                f"    {name:14} {np.round(direction, 4)} ± {off:.2f}°: "
                f"{angle_deg(planes.direction, direction):.2f}° from the planes' up"
            )


if __name__ == "__main__":
    main()
