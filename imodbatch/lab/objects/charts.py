"""Painting a part from outside: each face takes the picture of the side it faces most."""

from dataclasses import replace

import numpy as np

from imodbatch.lab.objects.part import Array, Part, Picture

# For each side: the axis it faces, and the (axis, sign) along which a picture's columns and rows
# run. A person before the object sees pictures upright; the top is read from the front.
SIDES = {
    "front": ((0, 1), (1, 1), (2, -1)),
    "back": ((0, -1), (1, -1), (2, -1)),
    "left": ((1, 1), (0, -1), (2, -1)),
    "right": ((1, -1), (0, 1), (2, -1)),
    "top": ((2, 1), (1, 1), (0, 1)),
    "bottom": ((2, -1), (1, 1), (0, -1)),
}


def box_mapped(part: Part, rest: Picture, front_reach: float = 1.0, **sides: Picture) -> Part:
    """The part with new pictures, each covering its bounding box as seen from one side.

    Args:
        part: the shape.
        rest: the picture of the sides that are not named.
        front_reach: above 1, the front's picture reaches further round the shape.
        sides: pictures by side: front (+x), back, left (+y), right, top, bottom.
    """
    if unknown := set(sides) - set(SIDES):
        raise ValueError(f"Unknown sides {sorted(unknown)}; there are {', '.join(SIDES)}.")
    corners = part.vertices[part.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.stack([normal[:, axis] * sign for (axis, sign), _, _ in SIDES.values()], axis=1)
    facing[:, 0] *= front_reach
    chosen = facing.argmax(axis=1)
    uvs = np.empty_like(part.uvs)
    for index, (_, column, row) in enumerate(SIDES.values()):
        on_side = chosen == index
        for k, (axis, sign) in enumerate((column, row)):
            uvs[on_side, :, k] = _fraction(part.vertices[:, axis], corners[on_side, :, axis], sign)
    return replace(
        part,
        uvs=uvs,
        face_picture=chosen,
        pictures=tuple(sides.get(name, rest) for name in SIDES),
    )


def _fraction(all_values: Array, values: Array, sign: int) -> Array:
    """Where values lie between the smallest and the largest, from the end that `sign` names."""
    low, high = all_values.min(), all_values.max()
    share = (values - low) / (high - low)
    return np.asarray(share if sign > 0 else 1 - share)
