"""Bundle adjustment of keyframes, the points they see and the surfaces they share.

Levenberg–Marquardt on three kinds of errors: pixels, depths, and ties, which are relative poses of
two keyframes by their surfaces with an inverse covariance of their own. Points are eliminated first
(Schur complement, Triggs et al. 2000, Sec. 6.1), which leaves six unknowns per moving keyframe.
Depth is a measurement like any other, so that every sighting with depth holds the scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.frames import adjoint, exp_twist, invert, orthonormal, twist_between
from imodbatch.engines.slam import measurement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_TRIES = 3
MIN_GAIN = 1e-3


@dataclass(frozen=True)
class Ties:
    """N relative poses of pairs of cameras.

    Attributes:
        first, second: (N,) cameras.
        first_from_second: (N, 4, 4) measured.
        information: (N, 6, 6) inverse covariance of a twist on its left.
    """

    first: Indices
    second: Indices
    first_from_second: Array
    information: Array


@dataclass(frozen=True)
class Network:
    """O sightings and N ties that bind F cameras and P points.

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
    ties: Ties


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
    good = np.ones(len(network.camera_of), dtype=np.bool_)
    layout = _Layout(network)
    damping = 1e-4
    for n_iterations in rounds:
        for _ in range(n_iterations):
            step = _Step(camera, network, layout, cameras, points, good)
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
        good = measurement.fits(_residuals(camera, network, cameras, points))
    return Adjusted(orthonormal(cameras), points, good)


def _in_cameras(network: Network, cameras: Array, points: Array) -> Array:
    seen_by = cameras[network.camera_of]
    moved = (seen_by[:, :3, :3] @ points[network.point_of][:, :, None])[:, :, 0]
    return moved + seen_by[:, :3, 3]


def _residuals(camera: PinholeCamera, network: Network, cameras: Array, points: Array) -> Array:
    in_camera = _in_cameras(network, cameras, points)
    return measurement.residuals(camera, in_camera, network.measurements, network.sigma)


def _tie_errors(ties: Ties, cameras: Array) -> Array:
    found = cameras[ties.first] @ invert(cameras[ties.second])
    return twist_between(found, ties.first_from_second)


class _Sum:
    """Sums of values by group, for many values of the same groups."""

    def __init__(self, group: Indices, n_groups: int) -> None:
        self._order = np.argsort(group, kind="stable")
        starts = np.searchsorted(group[self._order], np.arange(n_groups))
        self._present = np.flatnonzero(np.diff(np.r_[starts, len(group)]))
        self._starts = starts[self._present]
        self._n_groups = n_groups

    def __call__(self, values: Array) -> Array:
        result = np.zeros((self._n_groups, *values.shape[1:]))
        if len(self._present):
            result[self._present] = np.add.reduceat(values[self._order], self._starts, axis=0)
        return result


class _Layout:
    """Which sighting goes into which block: the same in every iteration."""

    def __init__(self, network: Network) -> None:
        self.n_moving = int(network.moves.sum())
        slot_of = np.where(network.moves, np.cumsum(network.moves) - 1, -1)
        self.rows = np.flatnonzero(network.moves[network.camera_of])
        self.slot = slot_of[network.camera_of[self.rows]]
        n_points = len(network.points)
        self.by_point = _Sum(network.point_of, n_points)
        self.by_camera = _Sum(self.slot, self.n_moving)
        self.point = network.point_of[self.rows]
        self.rows_by_point = _Sum(self.point, n_points)
        self.left, self.right = _pairs(self.point, n_points)
        block = self.slot[self.left] * self.n_moving + self.slot[self.right]
        self.by_block = _Sum(block, self.n_moving**2)
        self.tie_first, self.tie_second = slot_of[network.ties.first], slot_of[network.ties.second]


def _pairs(group: Indices, n_groups: int) -> tuple[Indices, Indices]:
    """All ordered pairs of members of the same group, each with itself too."""
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(n_groups + 1))
    size = np.diff(starts)[group[order]]
    left = np.repeat(np.arange(len(group)), size)
    within = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
    right = np.repeat(starts[group[order]], size) + within
    return order[left], order[right]


class _Step:
    """The normal equations at one place, to be solved with several dampings."""

    def __init__(
        self,
        camera: PinholeCamera,
        network: Network,
        layout: _Layout,
        cameras: Array,
        points: Array,
        good: NDArray[np.bool_],
    ) -> None:
        self._camera, self._network, self._layout = camera, network, layout
        self._cameras, self._points = cameras, points
        in_camera = _in_cameras(network, cameras, points)
        error = measurement.residuals(camera, in_camera, network.measurements, network.sigma)
        self._weight = measurement.huber_weights(error) * good[:, None]
        image = measurement.image_jacobian(camera, in_camera, network.measurements, network.sigma)

        by_point = image @ cameras[network.camera_of, :3, :3]
        weighted = np.swapaxes(by_point * self._weight[:, :, None], 1, 2)
        self._v = layout.by_point(weighted @ by_point)
        self._g_point = layout.by_point((weighted @ error[:, :, None])[:, :, 0])

        rows = layout.rows
        by_camera = measurement.pose_jacobian(image[rows], in_camera[rows])
        weighted = np.swapaxes(by_camera * self._weight[rows, :, None], 1, 2)
        self._u = layout.by_camera(weighted @ by_camera)
        self._g_camera = layout.by_camera((weighted @ error[rows, :, None])[:, :, 0])
        self._w = weighted @ by_point[rows]
        self._tie_system, self._tie_gradient = self._ties()
        self.cost = self._squares(error, cameras)

    def _ties(self) -> tuple[Array, Array]:
        """What ties add to the reduced system (6M, 6M) and its gradient (6M,)."""
        ties, layout = self._network.ties, self._layout
        system = np.zeros((layout.n_moving, 6, layout.n_moving, 6))
        gradient = np.zeros((layout.n_moving, 6))
        if len(ties.first):
            cameras = self._cameras
            error = _tie_errors(ties, cameras)
            by_second = -adjoint(cameras[ties.first] @ invert(cameras[ties.second]))
            sides = [(layout.tie_first, np.eye(6)), (layout.tie_second, by_second)]
            for slot_a, by_a in sides:
                left = np.swapaxes(np.broadcast_to(by_a, ties.information.shape), 1, 2)
                weighted = left @ ties.information
                for n in np.flatnonzero(slot_a >= 0):
                    gradient[slot_a[n]] += weighted[n] @ error[n]
                for slot_b, by_b in sides:
                    block = weighted @ by_b
                    for n in np.flatnonzero((slot_a >= 0) & (slot_b >= 0)):
                        system[slot_a[n], :, slot_b[n]] += block[n]
        size = 6 * layout.n_moving
        return system.reshape(size, size), gradient.ravel()

    def solve(self, damping: float) -> tuple[Array, Array]:
        """Cameras and points after one damped step."""
        layout = self._layout
        n, size = layout.n_moving, 6 * layout.n_moving
        v_inverse = np.linalg.inv(_damped(self._v, damping))
        y = self._w @ v_inverse[layout.point]
        product = y[layout.left] @ np.swapaxes(self._w, 1, 2)[layout.right]
        blocks = -layout.by_block(product).reshape(n, n, 6, 6)
        blocks[np.arange(n), np.arange(n)] += _damped(self._u, damping)
        system = blocks.transpose(0, 2, 1, 3).reshape(size, size) + self._tie_system
        carried = layout.by_camera((y @ self._g_point[layout.point][:, :, None])[:, :, 0])
        right = carried.ravel() - self._g_camera.ravel() - self._tie_gradient
        twist = np.linalg.solve(system, right).reshape(-1, 6)
        pulled = (np.swapaxes(self._w, 1, 2) @ twist[layout.slot][:, :, None])[:, :, 0]
        change = self._g_point + layout.rows_by_point(pulled)
        cameras = self._cameras.copy()
        moves = self._network.moves
        cameras[moves] = exp_twist(twist) @ cameras[moves]
        return cameras, self._points - (v_inverse @ change[:, :, None])[:, :, 0]

    def cost_of(self, cameras: Array, points: Array) -> float:
        """Weighted squares with the weights of this step."""
        error = _residuals(self._camera, self._network, cameras, points)
        return self._squares(error, cameras)

    def _squares(self, error: Array, cameras: Array) -> float:
        ties = self._network.ties
        of_ties = _tie_errors(ties, cameras)
        tied = np.einsum("ni,nij,nj->", of_ties, ties.information, of_ties)
        return float((self._weight * error**2).sum() + tied)


def _damped(blocks: Array, damping: float) -> Array:
    """Blocks (B, n, n) with their diagonals grown, and never singular."""
    diagonal = np.einsum("bii->bi", blocks)
    return blocks + np.eye(blocks.shape[-1]) * (damping * diagonal + 1e-6)[:, :, None]
