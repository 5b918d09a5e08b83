"""Targets and clutter put down on furniture.

Nothing overlaps: what stands on a level keeps the sum of the radii apart, and within the level.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.lab.houses.clutter import random_item
from imodbatch.lab.houses.floorplan import Placed, standing, supports_of
from imodbatch.lab.houses.furniture import Support
from imodbatch.lab.houses.shell import Shell
from imodbatch.lab.houses.styles import Style
from imodbatch.lab.mesh import ObjectModel, TexturedMesh

Array = NDArray[np.float64]
HIDDEN_SHARE = 0.35
"""Of the targets, those with clutter right beside them."""
GAP_M = 0.012


@dataclass(frozen=True, eq=False)
class Target:
    """An object to be found.

    Attributes:
        model: what it is.
        class_id: its ordinal among the models.
        instance_id: its name in the house.
        world_from_object: (4, 4), upright.
        yaw_rad: about +z.
        place: ordinal of the furniture it stands on; −1 = the floor.
        radius_m: of its footprint.
    """

    model: ObjectModel
    class_id: int
    instance_id: str
    world_from_object: Array
    yaw_rad: float
    place: int
    radius_m: float

    @property
    def middle_world(self) -> Array:
        """The middle (3,) of its upright bounding box."""
        middle = self.world_from_object[:3, 3].copy()
        middle[2] += 0.5 * float(np.ptp(self.model.mesh.vertices[:, 2]))
        return middle


class Room:
    """What is taken on each level, while things are put down.

    Attributes:
        clutter: meshes put down so far, each with its ``world_from_mesh``.
    """

    def __init__(
        self, rng: np.random.Generator, style: Style, shell: Shell, furniture: list[Placed]
    ) -> None:
        self.rng, self.style, self.shell, self.furniture = rng, style, shell, furniture
        self.clutter: list[tuple[TexturedMesh, Array]] = []
        self.levels = [
            (place, support)
            for place, placed in enumerate(furniture)
            for support in supports_of(placed)
        ]
        self.taken: list[list[tuple[float, float, float]]] = [[] for _ in self.levels]
        self.on_floor: list[tuple[Array, float]] = []

    def place_targets(
        self, models: Sequence[ObjectModel], hand: list[int], n_on_island: int
    ) -> list[Target]:
        """Targets on islands first, then along the walls; what fits nowhere stands on the floor."""
        islands = [k for k, (p, _) in enumerate(self.levels) if self.furniture[p].is_island]
        walls = self._wall_levels()
        targets: list[Target] = []
        for number, class_id in enumerate(hand):
            model = models[class_id]
            footprint = model.mesh.vertices[:, :2]
            radius = float(np.linalg.norm(footprint, axis=1).max())
            height = float(np.ptp(model.mesh.vertices[:, 2]))
            on_island = number < n_on_island or not walls
            first, then = (islands, walls) if on_island else (walls, islands)
            yaw = float(self.rng.uniform(0, FULL_TURN_RAD))
            place, at = self._put_down(first, then, radius, height)
            world_from_object = standing(*at, yaw)
            low = float(model.mesh.vertices[:, 2].min())
            world_from_object[2, 3] -= low
            count = sum(t.class_id == class_id for t in targets)
            name = f"{model.name}_{count + 1}"
            targets.append(Target(model, class_id, name, world_from_object, yaw, place, radius))
        self._hide_some(targets)
        return targets

    def place_clutter(self, targets: Sequence[Target]) -> None:
        """Things that are no target, on every level with room for them."""
        for level, (place, support) in enumerate(self.levels):
            area = 4 * support.half_x_m * support.half_y_m
            mean = area + 0.3 if self.furniture[place].is_island else 2 * area + 0.8
            # Without targets other things take their room.
            mean += 0.0 if targets else 4 * area
            for _ in range(int(self.rng.poisson(mean))):
                item = random_item(self.rng, self.style, support.clear_m)
                spot = self._free_spot(level, item.radius_m)
                if spot is not None:
                    self._add_item(level, item.meshes, *spot, item.radius_m)

    def _wall_levels(self) -> list[int]:
        """Up to three levels at the walls, one per piece, where targets stand."""
        of_piece: dict[int, int] = {}
        for level in self.rng.permutation(len(self.levels)).tolist():
            place, support = self.levels[level]
            if not self.furniture[place].is_island and support.height_m <= 1.05:
                of_piece.setdefault(place, level)
        return list(of_piece.values())[:3]

    def _put_down(
        self, first: list[int], then: list[int], radius: float, height: float
    ) -> tuple[int, tuple[float, float, float]]:
        """A place for a target: ordinal of the furniture (−1 = floor) and where it stands."""
        for levels in (first, then):
            for level in self.rng.permutation(np.array(levels, dtype=np.int64)).tolist():
                place, support = self.levels[level]
                if height >= support.clear_m - 0.02:
                    continue
                spot = self._free_spot(level, radius)
                if spot is not None:
                    self.taken[level].append((*spot, radius))
                    return place, self._world(level, *spot)
        x, y = self._floor_spot(radius)
        self.on_floor.append((np.array([x, y]), radius))
        return -1, (x, y, 0.0)

    def _free_spot(self, level: int, radius: float, tries: int = 80) -> tuple[float, float] | None:
        """A place on a level that touches nothing; None if none was found."""
        _, support = self.levels[level]
        half_x, half_y = support.half_x_m - radius - 0.01, support.half_y_m - radius - 0.01
        if half_x < 0 or half_y < 0:
            return None
        for _ in range(tries):
            x = support.x_m + float(self.rng.uniform(-half_x, half_x))
            y = support.y_m + float(self.rng.uniform(-half_y, half_y))
            if self._is_free(level, support, x, y, radius):
                return x, y
        return None

    def _is_free(self, level: int, support: Support, x: float, y: float, radius: float) -> bool:
        if (
            support.is_round
            and np.hypot(x - support.x_m, y - support.y_m) > support.half_x_m - radius - 0.01
        ):
            return False
        if abs(x - support.x_m) > support.half_x_m - radius:
            return False
        if abs(y - support.y_m) > support.half_y_m - radius:
            return False
        return all(np.hypot(x - a, y - b) > radius + r + GAP_M for a, b, r in self.taken[level])

    def _hide_some(self, targets: list[Target]) -> None:
        """Clutter right beside some targets, towards where the robot may come from."""
        for target in targets:
            if target.place < 0 or self.rng.random() > HIDDEN_SHARE:
                continue
            placed = self.furniture[target.place]
            x, y, z = target.world_from_object[:3, 3]
            local = placed.world_from_piece[:3, :3].T @ (
                np.array([x, y, z]) - placed.world_from_piece[:3, 3]
            )
            level = min(
                (k for k, (p, _) in enumerate(self.levels) if p == target.place),
                key=lambda k: abs(self.levels[k][1].height_m - local[2]),
            )
            support = self.levels[level][1]
            for _ in range(20):
                item = random_item(self.rng, self.style, support.clear_m)
                if item.radius_m > 0.11:
                    continue
                angle = self.rng.uniform(0, FULL_TURN_RAD)
                away = target.radius_m + item.radius_m + GAP_M + 0.003 + self.rng.uniform(0, 0.03)
                spot = (
                    float(local[0] + away * np.cos(angle)),
                    float(local[1] + away * np.sin(angle)),
                )
                if self._is_free(level, support, *spot, item.radius_m):
                    self._add_item(level, item.meshes, *spot, item.radius_m)
                    break

    def _add_item(
        self, level: int, meshes: tuple[TexturedMesh, ...], x: float, y: float, radius: float
    ) -> None:
        self.taken[level].append((x, y, radius))
        at = standing(*self._world(level, x, y), float(self.rng.uniform(0, FULL_TURN_RAD)))
        self.clutter += [(mesh, at) for mesh in meshes]

    def _world(self, level: int, x: float, y: float) -> tuple[float, float, float]:
        place, support = self.levels[level]
        matrix = self.furniture[place].world_from_piece
        at = matrix[:3, :3] @ np.array([x, y, support.height_m]) + matrix[:3, 3]
        return float(at[0]), float(at[1]), float(at[2])

    def _floor_spot(self, radius: float) -> tuple[float, float]:
        """A free place on the floor, as near to some furniture as can be."""
        half = np.array([self.shell.half_x_m, self.shell.half_y_m]) - radius - 0.1
        points = self.rng.uniform(-half, half, (400, 2))
        away = np.min([p.distance_m(points) for p in self.furniture], axis=0)
        for point, r in self.on_floor:
            away = np.minimum(away, np.linalg.norm(points - point, axis=1) - r)
        # Just clear of the furniture, or the roomiest place if nowhere is.
        score = np.where(away > radius + 0.05, -away, -1e3 + away)
        x, y = points[int(np.argmax(score))]
        return float(x), float(y)
