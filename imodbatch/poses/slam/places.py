"""Place recognition without a trained vocabulary: words are bits picked from ORB descriptors.

Descriptors of one corner seen twice differ in a few of their 256 bits. A word is the value of some
fixed, randomly chosen bits (locality-sensitive hashing, Gionis et al. 1999); several sets of bits
make up for those that differ. Keyframes are ranked by the words they share with a frame, rare words
counting more (inverse document frequency, Sivic & Zisserman 2003).
"""

import numpy as np
from numpy.typing import NDArray

from imodbatch.poses.rgbd.matching import Descriptors

N_SETS, N_BITS = 6, 14


class Places:
    """Keyframes by their words."""

    def __init__(self, seed: int = 0) -> None:
        generator = np.random.default_rng(seed)
        self._bits = np.stack([generator.permutation(256)[:N_BITS] for _ in range(N_SETS)])
        self._words = np.zeros(0, dtype=np.int64)
        self._owner = np.zeros(0, dtype=np.int64)
        self._n_owners = np.zeros(N_SETS << N_BITS, dtype=np.int64)
        self._n_places = 0

    def add(self, descriptors: Descriptors) -> None:
        """Remember the next keyframe; they are numbered in order."""
        words = self._words_of(descriptors)
        self._words = np.concatenate([self._words, words])
        self._owner = np.concatenate([self._owner, np.full(len(words), self._n_places)])
        self._n_owners[words] += 1
        self._n_places += 1

    def scores(self, descriptors: Descriptors) -> NDArray[np.float64]:
        """How much each keyframe (K,) looks like a frame with these descriptors (N, 4)."""
        if self._n_places == 0:
            return np.zeros(0)
        weight = np.zeros(N_SETS << N_BITS)
        words = self._words_of(descriptors)
        owners = np.maximum(self._n_owners[words], 1)
        weight[words] = np.log((self._n_places + 1) / owners)
        scores = np.bincount(self._owner, weight[self._words], self._n_places)
        return scores.astype(np.float64)

    def _words_of(self, descriptors: Descriptors) -> NDArray[np.int64]:
        if len(descriptors) == 0:
            return np.zeros(0, dtype=np.int64)
        bits = np.unpackbits(descriptors.view(np.uint8), axis=1)
        values = bits[:, self._bits].astype(np.int64) @ (1 << np.arange(N_BITS))
        return np.unique(values + (np.arange(N_SETS) << N_BITS))
