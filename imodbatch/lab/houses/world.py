"""A house by split, index and seed: room, furniture, targets on it, clutter beside them, light.

Nothing overlaps: what stands on a level keeps the sum of the radii apart, and within the level.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.viewpoint import FULL_TURN_RAD
from imodbatch.lab.houses.clutter import random_item
from imodbatch.lab.houses.floorplan import Placed, furnish, standing, supports_of
from imodbatch.lab.houses.furniture import Support
from imodbatch.lab.houses.shell import Shell, make_shell, window_light
from imodbatch.lab.houses.styles import STREAM_OF_SPLIT, STYLES, Style, white_of
from imodbatch.lab.mesh import ObjectModel, TexturedMesh
from imodbatch.lab.scene import (
    BulbLight,
    Light,
    PlacedModel,
    Renderer,
    RenderSettings,
    Sky,
    make_renderer,
)

Array = NDArray[np.float64]
FEWEST_TARGETS, MOST_TARGETS = 8, 10
ISLAND_SHARE = 0.75
"""Of the targets, those on the island; the others stand along the walls."""
HIDDEN_SHARE = 0.35
"""Of the targets, those with clutter right beside them."""
GAP_M = 0.012
DECK_STREAM, SHELL_STREAM, PLACE_STREAM, LIGHT_STREAM, DRIVE_STREAM, SENSOR_STREAM = range(6)


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


@dataclass(frozen=True, eq=False)
class House:
    """A furnished house.

    Attributes:
        split: ``train``, ``val`` or ``test``.
        index: ordinal in the split.
        seed: of the dataset.
        shell: the room.
        furniture: in it.
        targets: objects to be found.
        scenery: everything else, with its ``world_from_mesh``.
        lights: lamps and windows.
        sky: light from everywhere and what is outside.
    """

    split: str
    index: int
    seed: int
    shell: Shell
    furniture: tuple[Placed, ...]
    targets: tuple[Target, ...]
    scenery: tuple[tuple[TexturedMesh, Array], ...]
    lights: tuple[Light, ...]
    sky: Sky

    def random(self, stream: int) -> np.random.Generator:
        """This house's random numbers for one purpose."""
        return random_of(self.split, self.seed, self.index, stream)

    def renderer(self, settings: RenderSettings) -> Renderer:
        """Renders it; targets are numbered in order, from 0."""
        placed = [
            PlacedModel(target.model, target.world_from_object, number)
            for number, target in enumerate(self.targets)
        ]
        placed += [PlacedModel(ObjectModel("", mesh), at) for mesh, at in self.scenery]
        return make_renderer(placed, list(self.lights), self.sky, settings)


def random_of(split: str, seed: int, index: int, stream: int) -> np.random.Generator:
    """Random numbers of one purpose in one house; splits never share any."""
    return np.random.default_rng([STREAM_OF_SPLIT[split], seed, index, stream])


def make_house(
    split: str,
    index: int,
    seed: int,
    models: Sequence[ObjectModel],
    n_targets: int | None = None,
    n_on_island: int | None = None,
) -> House:
    """A house; nothing is rendered yet.

    Args:
        split: ``train``, ``val`` or ``test``.
        index: ordinal, from 0.
        seed: decides everything that is random.
        models: targets are dealt from them in turn, so that all are as frequent.
        n_targets: None = 8 to 10; without models there are none.
        n_on_island: all models stand in the house, the first so many on the island; None = dealt.
    """
    style = STYLES[split]
    rng = random_of(split, seed, index, SHELL_STREAM)
    shell = make_shell(rng, style)
    furniture = furnish(rng, style, shell, index)
    room = _Room(random_of(split, seed, index, PLACE_STREAM), style, shell, furniture)
    if n_on_island is not None:
        hand = list(range(len(models)))
    else:
        hand = _dealt(split, seed, index, len(models), n_targets) if models else []
        n_on_island = _on_island(len(hand))
    targets = room.place_targets(models, hand, n_on_island)
    room.place_clutter(targets)
    scenery = [(mesh, np.eye(4)) for mesh in shell.meshes]
    scenery += [(m, p.world_from_piece) for p in furniture for m in p.piece.meshes]
    lights, sky = _light(random_of(split, seed, index, LIGHT_STREAM), style, shell)
    return House(
        split,
        index,
        seed,
        shell,
        tuple(furniture),
        tuple(targets),
        (*scenery, *room.clutter),
        lights,
        sky,
    )


def _dealt(split: str, seed: int, index: int, n_models: int, n_targets: int | None) -> list[int]:
    """Which models stand in a house: the next cards of endless shuffled decks.

    The first of them go on the island, which the robot sees most: those that were there least.
    """
    rng = random_of(split, seed, 0, DECK_STREAM)
    n_on_island = np.zeros(n_models, dtype=np.int64)
    deck: list[int] = []
    hand: list[int] = []
    for _ in range(index + 1):
        n = int(rng.integers(FEWEST_TARGETS, MOST_TARGETS + 1)) if n_targets is None else n_targets
        while len(deck) < n:
            deck += rng.permutation(n_models).tolist()
        hand, deck = sorted(deck[:n], key=lambda card: int(n_on_island[card])), deck[n:]
        np.add.at(n_on_island, hand[: _on_island(n)], 1)
    return hand


def _on_island(n_targets: int) -> int:
    """How many of so many targets stand on the island."""
    return round(ISLAND_SHARE * n_targets)


class _Room:
    """What is taken on each level, while things are put down."""

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


def _light(rng: np.random.Generator, style: Style, shell: Shell) -> tuple[tuple[Light, ...], Sky]:
    """Ceiling lamps, windows, and the light that the room throws back."""
    color = np.array(white_of(float(rng.uniform(*style.kelvin))))
    n_lamps = int(rng.integers(style.n_lamps[0], style.n_lamps[1] + 1))
    lamp = float(rng.uniform(*style.lamp)) * 3.0 / n_lamps**0.7
    lights: list[Light] = []
    for k in range(n_lamps):
        x = ((k + 0.5) / n_lamps - 0.5) * 1.4 * shell.half_x_m + rng.uniform(-0.4, 0.4)
        y = rng.uniform(-0.6, 0.6)
        red, green, blue = (float(v) for v in lamp * color)
        lights.append(
            BulbLight((float(x), float(y), shell.height_m - 0.3), (red, green, blue), 0.12)
        )
    day = float(rng.uniform(*style.daylight)) * 2.0
    lights += [window_light(shell, window, day) for window in shell.windows]
    up = tuple(float(v) for v in 0.42 * (0.5 + 0.5 * color))
    down = tuple(float(v) for v in 0.34 * color * [1.0, 0.95, 0.9])
    outside = np.array(
        [[196, 214, 238], [222, 232, 244], [236, 240, 242], [150, 168, 132]], np.uint8
    )
    return tuple(lights), Sky((up[0], up[1], up[2]), (down[0], down[1], down[2]), outside)
