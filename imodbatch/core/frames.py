"""Rigid transforms, and the conventions every other file relies on.

- World: right-handed, metres, +z up. Camera: OpenCV axes, x right, y down, z forward.
- A transform is a 4×4 float64 array named ``a_from_b``: it takes coordinates in b to
  coordinates in a, so ``world_from_object = world_from_cam @ cam_from_object``.
- Pixels are continuous: the top-left corner of the image is (0, 0), pixel centres lie at +0.5.
- Depth is z-depth in metres, NaN where unknown. Angles are radians inside.
- Quaternions are (w, x, y, z).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def matrix_from_quaternion(quaternion_wxyz: ArrayLike) -> Array:
    """Rotation matrices of quaternions of any non-zero length.

    Args:
        quaternion_wxyz: (..., 4), order w, x, y, z.

    Returns:
        (..., 3, 3) rotations.
    """
    quaternion = np.asarray(quaternion_wxyz, dtype=np.float64)
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(rotation: ArrayLike) -> Array:
    """Unit quaternions (w ≥ 0) of rotation matrices.

    The quaternion is the eigenvector of the largest eigenvalue of a 4×4 symmetric matrix
    (Bar-Itzhack 2000), which is stable at every angle and gives the nearest rotation for a
    slightly distorted matrix.

    Args:
        rotation: (..., 3, 3).

    Returns:
        (..., 4), order w, x, y, z.
    """
    r = np.asarray(rotation, dtype=np.float64)
    k = np.empty((*r.shape[:-2], 4, 4))
    k[..., 0, 0] = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    k[..., 1:, 1:] = r + np.swapaxes(r, -1, -2) - k[..., :1, :1] * np.eye(3)
    k[..., 0, 1:] = np.stack(
        [
            r[..., 2, 1] - r[..., 1, 2],
            r[..., 0, 2] - r[..., 2, 0],
            r[..., 1, 0] - r[..., 0, 1],
        ],
        axis=-1,
    )
    k[..., 1:, 0] = k[..., 0, 1:]
    quaternion = np.linalg.eigh(k)[1][..., :, -1]
    return np.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def make_transform(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """4×4 transforms from (..., 3, 3) rotations and (..., 3) translations in metres."""
    rotation = np.asarray(rotation, dtype=np.float64)
    translation = np.asarray(translation, dtype=np.float64)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    transform = np.zeros((*shape, 4, 4))
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = translation
    transform[..., 3, 3] = 1.0
    return transform


def invert(transform: ArrayLike) -> Array:
    """Inverse of rigid transforms (..., 4, 4): ``b_from_a`` of ``a_from_b``."""
    transform = np.asarray(transform, dtype=np.float64)
    inverse_rotation = np.swapaxes(transform[..., :3, :3], -1, -2)
    inverse_translation = -(inverse_rotation @ transform[..., :3, 3:])[..., 0]
    return make_transform(inverse_rotation, inverse_translation)


def apply(a_from_b: ArrayLike, points_b: ArrayLike) -> Array:
    """Take points (..., 3) in b to coordinates in a."""
    transform = np.asarray(a_from_b, dtype=np.float64)
    points = np.asarray(points_b, dtype=np.float64)
    return np.einsum("...ij,...j->...i", transform[..., :3, :3], points) + transform[..., :3, 3]


def orthonormal(transform: ArrayLike) -> Array:
    """Rigid transforms (..., 4, 4) nearest to products of many, whose rounding errors add up."""
    transform = np.asarray(transform, dtype=np.float64)
    rotation = matrix_from_quaternion(quaternion_from_matrix(transform[..., :3, :3]))
    return make_transform(rotation, transform[..., :3, 3])


def is_rigid(transforms: ArrayLike, tolerance: float = 1e-2) -> NDArray[np.bool_]:
    """Whether (..., 4, 4) matrices are finite rotations with a translation.

    The last row must be 0 0 0 1: a transposed matrix has the translation there.

    Args:
        transforms: candidates, as read from a file.
        tolerance: largest deviation allowed of any entry of ``R Rᵀ`` from the identity and of the
            last row; printed matrices with six digits stay below 1e-5.
    """
    transforms = np.asarray(transforms, dtype=np.float64)
    finite = np.isfinite(transforms).all(axis=(-2, -1))
    transforms = np.where(finite[..., None, None], transforms, np.eye(4))
    rotation = transforms[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    last_row = np.abs(transforms[..., 3, :] - np.eye(4)[3]).max(axis=-1)
    is_rotation = (defect <= tolerance) & (np.linalg.det(rotation) > 0)
    return finite & is_rotation & (last_row <= tolerance)


def rotation_between(from_direction: ArrayLike, to_direction: ArrayLike) -> Array:
    """Smallest rotation (3, 3) that takes one direction (3,) to another.

    For opposite directions any half turn is smallest; the one chosen is about the coordinate axis
    least aligned with them.
    """
    a = np.asarray(from_direction, dtype=np.float64)
    b = np.asarray(to_direction, dtype=np.float64)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cross = np.cross(a, b)
    one_plus_cosine = 0.5 * float((a + b) @ (a + b))  # 1 + a·b would cancel for opposite directions
    if one_plus_cosine < 1e-16:
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        axis /= np.linalg.norm(axis)
        return 2 * np.outer(axis, axis) - np.eye(3)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.eye(3) + skew + skew @ skew / one_plus_cosine


def slerp(start_wxyz: ArrayLike, end_wxyz: ArrayLike, fraction: ArrayLike) -> Array:
    """Spherical interpolation of unit quaternions along the shorter arc (Shoemake 1985).

    Args:
        start_wxyz: (..., 4).
        end_wxyz: (..., 4).
        fraction: (...,) in [0, 1].
    """
    start = np.asarray(start_wxyz, dtype=np.float64)
    end = np.asarray(end_wxyz, dtype=np.float64)
    fraction = np.asarray(fraction, dtype=np.float64)[..., None]
    cosine = np.sum(start * end, axis=-1, keepdims=True)
    end = np.where(cosine < 0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0, 1))
    small = angle < 1e-8
    sine = np.where(small, 1.0, np.sin(angle))
    weight_start = np.where(small, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
    weight_end = np.where(small, fraction, np.sin(fraction * angle) / sine)
    mixed = weight_start * start + weight_end * end
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def exp_twist(twist: ArrayLike) -> Array:
    """Rigid transforms (..., 4, 4) of small or large twists (..., 6): translation part, rotation.

    The rotation vector's length is the angle (Rodrigues); the translation is applied as it stands,
    not coupled with the rotation, which is all that an update of an optimiser needs.
    """
    twist = np.asarray(twist, dtype=np.float64)
    x, y, z = np.moveaxis(twist[..., 3:], -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    transform = np.zeros((*twist.shape[:-1], 4, 4))
    transform[..., 0, 0] = 1 - versine * (y * y + z * z)
    transform[..., 0, 1] = versine * x * y - sine * z
    transform[..., 0, 2] = versine * x * z + sine * y
    transform[..., 1, 0] = versine * x * y + sine * z
    transform[..., 1, 1] = 1 - versine * (x * x + z * z)
    transform[..., 1, 2] = versine * y * z - sine * x
    transform[..., 2, 0] = versine * x * z - sine * y
    transform[..., 2, 1] = versine * y * z + sine * x
    transform[..., 2, 2] = 1 - versine * (x * x + y * y)
    transform[..., :3, 3] = twist[..., :3]
    transform[..., 3, 3] = 1.0
    return transform


def twist_between(a_from_c: ArrayLike, b_from_c: ArrayLike) -> Array:
    """Twists (..., 6) whose `exp_twist`, applied on the left, takes the second pose to the first.

    Args:
        a_from_c: (..., 4, 4).
        b_from_c: (..., 4, 4).
    """
    difference = np.asarray(a_from_c) @ invert(b_from_c)
    quaternion = quaternion_from_matrix(difference[..., :3, :3])
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quaternion[..., :1])
    per_sine = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return np.concatenate([difference[..., :3, 3], per_sine * quaternion[..., 1:]], axis=-1)


def adjoint(a_from_b: ArrayLike) -> Array:
    """Matrices (..., 6, 6) that take twists in b to twists in a (Barfoot 2017, Sec. 7.1.4)."""
    transform = np.asarray(a_from_b, dtype=np.float64)
    rotation, (x, y, z) = transform[..., :3, :3], np.moveaxis(transform[..., :3, 3], -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    skew = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    upper = np.concatenate([rotation, skew @ rotation], axis=-1)
    lower = np.concatenate([np.zeros_like(rotation), rotation], axis=-1)
    return np.concatenate([upper, lower], axis=-2)
