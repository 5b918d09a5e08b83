"""Which keyframes to match: neighbours in time, and those elsewhere that look alike.

COLMAP finds loops with a vocabulary tree that has to be downloaded. A sequence can be its own
vocabulary: its descriptors are clustered into visual words, an image becomes the sum of their
residuals to these words (VLAD, Jégou et al. 2010, each word's part normalised, Arandjelović 2013),
and images with similar sums are candidates. Matching then decides.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

N_WORDS = 64
N_SAMPLES = 20_000
N_ITERATIONS = 15
Descriptors = NDArray[np.uint8]
Pairs = list[tuple[int, int]]


def choose_pairs(descriptors: list[Descriptors], n_next: int, n_alike: int) -> Pairs:
    """Pairs (i < j) of K images to match, sorted.

    Args:
        descriptors: per image (n, 128), in order of time.
        n_next: images that follow an image and are matched with it.
        n_alike: images farther away that are most similar to it.
    """
    n_images = len(descriptors)
    pairs = {(i, j) for i in range(n_images) for j in range(i + 1, min(i + 1 + n_next, n_images))}
    similarity = image_similarity(descriptors)
    distance = np.abs(np.subtract.outer(np.arange(n_images), np.arange(n_images)))
    similarity[distance <= n_next] = -np.inf
    for i, row in enumerate(similarity):
        best = np.argsort(-row, kind="stable")[:n_alike]
        pairs.update((min(i, int(j)), max(i, int(j))) for j in best if np.isfinite(row[j]))
    return sorted(pairs)


def image_similarity(descriptors: list[Descriptors]) -> NDArray[np.float64]:
    """Cosine similarity (K, K) of the images' VLADs."""
    words = _words(descriptors)
    sums = np.stack([_vlad(image.astype(np.float32), words) for image in descriptors])
    return (sums @ sums.T).astype(np.float64)


def _words(descriptors: list[Descriptors]) -> NDArray[np.float32]:
    """Visual words (W, 128): cluster centres of a sample of all descriptors."""
    per_image = max(1, N_SAMPLES // max(1, len(descriptors)))
    spread = [np.linspace(0, len(d) - 1, min(per_image, len(d))).astype(int) for d in descriptors]
    sample = np.concatenate([d[rows] for d, rows in zip(descriptors, spread, strict=True)])
    if len(sample) == 0:
        return np.zeros((1, 128), dtype=np.float32)
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_MAX_ITER, N_ITERATIONS, 0.0)
    n_words = min(N_WORDS, len(sample))
    samples = sample.astype(np.float32)
    centers = cv2.kmeans(samples, n_words, None, criteria, 1, cv2.KMEANS_PP_CENTERS)[2]  # type: ignore[call-overload]
    return np.asarray(centers, dtype=np.float32)


def _vlad(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normalised sum (W · 128,) of residuals of descriptors (n, 128) to their nearest words."""
    half_norm = 0.5 * (words * words).sum(axis=1)
    nearest = np.argmax(descriptors @ words.T - half_norm, axis=1)
    sums = np.zeros_like(words)
    np.add.at(sums, nearest, descriptors - words[nearest])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
    flat = sums.ravel()
    return flat / max(float(np.linalg.norm(flat)), 1e-9)
