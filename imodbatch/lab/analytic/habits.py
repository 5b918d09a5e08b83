"""What a detector always gets wrong in the same way.

A network is a fixed function: shown the same side of the same object again it errs again. So part
of the noise is drawn once and looked up by view. Two kinds: habits of the network, drawn once per
dataset, and peculiarities of one object, drawn once per sequence.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.viewpoint import ViewGrid
from imodbatch.lab.analytic.catalogue import CLASSES, SYMMETRIC

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class ViewErrors:
    """How often a view is misjudged, and by how much; the rest is right.

    Attributes:
        neighbour: by one azimuth bin, either way.
        opposite: by half a turn.
        any_view: anything.
    """

    neighbour: float = 0.3
    opposite: float = 0.08
    any_view: float = 0.05

    def draw(self, rng: np.random.Generator, n_azimuths: int, shape: tuple[int, ...]) -> Ints:
        """Errors in azimuth bins, of a shape."""
        wrong = self.neighbour + self.opposite + self.any_view
        shares = [1 - wrong, self.neighbour / 2, self.neighbour / 2, self.opposite, self.any_view]
        kind = rng.choice(len(shares), size=shape, p=shares)
        anything = rng.integers(n_azimuths, size=shape)
        by_kind = [np.zeros_like(kind), np.ones_like(kind), np.full_like(kind, -1)]
        return np.choose(kind, [*by_kind, np.full_like(kind, n_azimuths // 2), anything])


def wrong_class_views(rng: np.random.Generator, n_azimuths: int, follow_fraction: float) -> Ints:
    """Which view of a wrong class an object's view is taken for, (K, K, N) azimuth bins.

    Entry [true class, wrong class, true azimuth bin]. A symmetric object always shows the same
    side, so it is always taken for the same view: the one from behind, which has no features. For
    any other pair of classes, with a chance of `follow_fraction` the two turn alike (up to a
    constant); else every view is taken for some view of its own.
    """
    n_classes = len(CLASSES)
    views = rng.integers(n_azimuths, size=(n_classes, n_classes, n_azimuths))
    constant = rng.integers(n_azimuths, size=(n_classes, n_classes, 1))
    turned_alike = (np.arange(n_azimuths) + constant) % n_azimuths
    follows = rng.random((n_classes, n_classes, 1)) < follow_fraction
    views = np.where(follows, turned_alike, views)
    views[sorted(SYMMETRIC)] = n_azimuths // 2
    return views


@dataclass(frozen=True)
class Peculiarities:
    """What is always odd about single objects, per view.

    Attributes:
        class_logits: (O, M, N, K) unit normal, alike for neighbouring azimuths.
        view_errors: (O, M, N) in azimuth bins.
    """

    class_logits: Array
    view_errors: Ints

    @classmethod
    def draw(
        cls, rng: np.random.Generator, n_objects: int, grid: ViewGrid, errors: ViewErrors
    ) -> "Peculiarities":
        """Draw them for the objects of a sequence."""
        views = (n_objects, grid.n_elevations, grid.n_azimuths)
        rough = rng.normal(size=(*views, len(CLASSES)))
        smooth = (np.roll(rough, 1, 2) + 2 * rough + np.roll(rough, -1, 2)) / np.sqrt(6)
        return cls(smooth, errors.draw(rng, grid.n_azimuths, views))
