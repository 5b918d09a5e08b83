"""A house by split, index and seed: room, furniture, targets on it, clutter beside them, light."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.lab.houses.arranging import Room, Target
from imodbatch.lab.houses.floorplan import Placed, furnish
from imodbatch.lab.houses.shell import Shell, make_shell, window_light
from imodbatch.lab.houses.styles import STREAM_OF_SPLIT, STYLES, Style, white_of
from imodbatch.lab.mesh import ObjectModel, TexturedMesh
from imodbatch.lab.render.raycast import BulbLight, Light, Renderer, RenderSettings, Sky
from imodbatch.lab.scene import PlacedModel, make_renderer

Array = NDArray[np.float64]
FEWEST_TARGETS, MOST_TARGETS = 8, 10
ISLAND_SHARE = 0.75
"""Of the targets, those on the island; the others stand along the walls."""
DECK_STREAM, SHELL_STREAM, PLACE_STREAM, LIGHT_STREAM, DRIVE_STREAM, SENSOR_STREAM = range(6)


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
    room = Room(random_of(split, seed, index, PLACE_STREAM), style, shell, furniture)
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
