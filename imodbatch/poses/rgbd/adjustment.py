"""Bundle adjustment of keyframes, the points they see and the surfaces they share.

Levenberg–Marquardt on three kinds of errors: pixels, depths, and ties, which are relative poses of
two keyframes by their surfaces with an inverse covariance of their own. Points are eliminated first
(Schur complement, Triggs et al. 2000, Sec. 6.1), which leaves six unknowns per moving keyframe, in
a system that is filled only where two keyframes see a point or share a tie.
Depth is a measurement like any other, so that every sighting with depth holds the scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import adjoint, exp_twist, invert, orthonormal, twist_between
from imodbatch.poses.rgbd import measurement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_TRIES = 3
MIN_GAIN = 1e-3


@dataclass(frozen=True)
class Tie:
    """Relative pose (4, 4) of two cameras; inverse covariance (6, 6) of a twist on its left."""

    first: int
    second: int
    first_from_second: Array
    information: Array


def among(ties: Sequence[Tie], numbers: Sequence[int]) -> list[Tie]:
    """Those of the ties that bind two of these cameras, by their positions in `numbers`."""
    slot = {number: position for position, number in enumerate(numbers)}
    inside = [t for t in ties if t.first in slot and t.second in slot]
    return [replace(t, first=slot[t.first], second=slot[t.second]) for t in inside]


@dataclass(frozen=True)
class Network:
    """O sightings and ties that bind F cameras and P points.

    Attributes:
        cam_from_world: (F, 4, 4).
        moves: (F,) whether a camera may move; at least one should not.
        points: (P, 3).
        camera_of, point_of: (O,) who saw what.
        measurements, sigma: (O, 3).
        ties: between cameras.
    """

    cam_from_world: Array
    moves: NDArray[np.bool_]
    points: Array
    camera_of: Indices
    point_of: Indices
    measurements: Array
    sigma: Array
    ties: Sequence[Tie]


@dataclass(frozen=True)
class Adjusted:
    """Better cameras (F, 4, 4) and points (P, 3), and which sightings (O,) fit them."""

    cam_from_world: Array
    points: Array
    fits: NDArray[np.bool_]


def adjust(camera: PinholeCamera, network: Network, rounds: Sequence[int] = (3, 3)) -> Adjusted:
    """Move cameras and points so that sightings and ties fit best.

    Args:
        camera: of all frames.
        network: what binds them.
        rounds: most iterations of each round; after it, sightings that do not fit are left out.
    """
    cameras, points = network.cam_from_world, network.points
    problem = _Problem(camera, network)
    good = np.ones(len(network.camera_of), dtype=np.bool_)
    damping = 1e-4
    for n_iterations in rounds:
        for _ in range(n_iterations):
            step = _Step(problem, cameras, points, good)
            for _ in range(MAX_TRIES):
                moved = step.solve(damping)
                cost = step.cost_of(*moved)
                if cost < step.cost:
                    damping = max(damping / 5, 1e-7)
                    cameras, points = moved
                    break
                damping *= 10
            if cost > (1 - MIN_GAIN) * step.cost:
                break
        good = measurement.fits(problem.residuals(problem.in_cameras(cameras, points)))
    return Adjusted(orthonormal(cameras), points, good)


class _Problem:
    """A network with what stays the same in every iteration."""

    def __init__(self, camera: PinholeCamera, network: Network) -> None:
        self.camera, self.network, self.moves = camera, network, network.moves
        self.n_moving, self.n_points = int(self.moves.sum()), len(network.points)
        slot_of = np.where(self.moves, np.cumsum(self.moves) - 1, -1)
        self.rows = np.flatnonzero(self.moves[network.camera_of])
        self.rows = self.rows[np.argsort(network.camera_of[self.rows], kind="stable")]
        self.slot, self.point = slot_of[network.camera_of[self.rows]], network.point_of[self.rows]
        self.sum_by_point = _sum_by(network.point_of, self.n_points)
        self.sum_by_camera = _sum_by(self.slot, self.n_moving)
        self._starts = np.searchsorted(self.slot, np.arange(self.n_moving + 1))
        ties = network.ties
        self.tied = np.array([(t.first, t.second) for t in ties], dtype=np.int64).reshape(-1, 2)
        self.tie_slots = slot_of[self.tied]
        self.measured_ties = np.array([t.first_from_second for t in ties]).reshape(-1, 4, 4)
        self.information = np.array([t.information for t in ties]).reshape(-1, 6, 6)

    def across(self, blocks: Array) -> Any:
        """Blocks (n, 6, 3) of the moving cameras' sightings as a sparse matrix (6M, 3P)."""
        return sparse.bsr_array(
            (blocks, self.point, self._starts), shape=(6 * self.n_moving, 3 * self.n_points)
        )

    def in_cameras(self, cameras: Array, points: Array) -> Array:
        """Points (O, 3) in the cameras that see them."""
        seen_by = cameras[self.network.camera_of]
        moved = (seen_by[:, :3, :3] @ points[self.network.point_of][:, :, None])[:, :, 0]
        return moved + seen_by[:, :3, 3]

    def residuals(self, in_camera: Array) -> Array:
        """Whitened residuals (O, 3)."""
        seen = self.network
        return measurement.residuals(self.camera, in_camera, seen.measurements, seen.sigma)

    def tie_errors(self, cameras: Array) -> tuple[Array, Array]:
        """Twists (N, 6) by which ties are off, and first_from_second (N, 4, 4) as cameras stand."""
        found = cameras[self.tied[:, 0]] @ invert(cameras[self.tied[:, 1]])
        return twist_between(found, self.measured_ties), found


def _sum_by(group: Indices, n_groups: int) -> Any:
    """A sparse matrix (G, n) that sums rows by their group (n,)."""
    return sparse.csr_array(
        (np.ones(len(group)), (group, np.arange(len(group)))), shape=(n_groups, len(group))
    )


class _Step:
    """The normal equations at one place, to be solved with several dampings."""

    def __init__(
        self, problem: _Problem, cameras: Array, points: Array, good: NDArray[np.bool_]
    ) -> None:
        self._problem, self._cameras, self._points = problem, cameras, points
        network, rows = problem.network, problem.rows
        in_camera = problem.in_cameras(cameras, points)
        error = problem.residuals(in_camera)
        self._weight = measurement.huber_weights(error) * good[:, None]
        image = measurement.image_jacobian(
            problem.camera, in_camera, network.measurements, network.sigma
        )
        by_point = image @ cameras[network.camera_of, :3, :3]
        weighted = np.swapaxes(by_point * self._weight[:, :, None], 1, 2)
        self._v = _summed(problem.sum_by_point, weighted @ by_point)
        self._g_point = _summed(problem.sum_by_point, (weighted @ error[:, :, None])[:, :, 0])

        by_camera = measurement.pose_jacobian(image[rows], in_camera[rows])
        weighted = np.swapaxes(by_camera * self._weight[rows, :, None], 1, 2)
        self._u = _summed(problem.sum_by_camera, weighted @ by_camera)
        g_camera = _summed(problem.sum_by_camera, (weighted @ error[rows, :, None])[:, :, 0])
        self._w_blocks = weighted @ by_point[rows]
        self._w = problem.across(self._w_blocks)
        self._of_ties, tie_gradient = self._ties()
        self._g_camera = g_camera.ravel() + tie_gradient
        self.cost = self._squares(error, cameras)

    def _ties(self) -> tuple[Any, Array]:
        """What ties add to the reduced system (6M, 6M) and its gradient (6M,)."""
        problem = self._problem
        error, found = problem.tie_errors(self._cameras)
        by_second = -adjoint(found)
        blocks = np.stack([np.broadcast_to(np.eye(6), by_second.shape), by_second], axis=1)
        tie, side = np.nonzero(problem.tie_slots >= 0)
        starts = np.searchsorted(tie, np.arange(len(error) + 1))
        jacobian = sparse.bsr_array(
            (blocks[tie, side], problem.tie_slots[tie, side], starts),
            shape=(6 * len(error), 6 * problem.n_moving),
        )
        information = _block_diagonal(problem.information)
        weighted = jacobian.T @ information
        return weighted @ jacobian, weighted @ error.ravel()

    def solve(self, damping: float) -> tuple[Array, Array]:
        """Cameras and points after one damped step."""
        problem = self._problem
        v_inverse = np.linalg.inv(_damped(self._v, damping))
        y = problem.across(self._w_blocks @ v_inverse[problem.point])
        system = _block_diagonal(_damped(self._u, damping)) + self._of_ties - y @ self._w.T
        right = y @ self._g_point.ravel() - self._g_camera
        twist = splu(system.tocsc()).solve(right)
        change = self._g_point + (self._w.T @ twist).reshape(-1, 3)
        cameras = self._cameras.copy()
        cameras[problem.moves] = exp_twist(twist.reshape(-1, 6)) @ cameras[problem.moves]
        return cameras, self._points - (v_inverse @ change[:, :, None])[:, :, 0]

    def cost_of(self, cameras: Array, points: Array) -> float:
        """Weighted squares with the weights of this step."""
        problem = self._problem
        return self._squares(problem.residuals(problem.in_cameras(cameras, points)), cameras)

    def _squares(self, error: Array, cameras: Array) -> float:
        of_ties, _ = self._problem.tie_errors(cameras)
        tied = np.einsum("ni,nij,nj->", of_ties, self._problem.information, of_ties)
        return float((self._weight * error**2).sum() + tied)


def _summed(sum_by: Any, values: Array) -> Array:
    """Sums of values (n, …) by group (G, …)."""
    size = int(np.prod(values.shape[1:]))
    return (sum_by @ values.reshape(-1, size)).reshape(-1, *values.shape[1:])


def _block_diagonal(blocks: Array) -> Any:
    """Blocks (B, n, n) as a sparse matrix."""
    n_blocks, n, _ = blocks.shape
    return sparse.bsr_array(
        (blocks, np.arange(n_blocks), np.arange(n_blocks + 1)), shape=(n * n_blocks, n * n_blocks)
    )


def _damped(blocks: Array, damping: float) -> Array:
    """Blocks (B, n, n) with their diagonals grown, and never singular."""
    diagonal = np.einsum("bii->bi", blocks)
    return blocks + np.eye(blocks.shape[-1]) * (damping * diagonal + 1e-6)[:, :, None]
