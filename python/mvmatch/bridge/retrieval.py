"""Which pictures may show the same place: those that share rare visual words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

NUM_WORDS = 1024
"""Visual words, at most; the pictures of one video need no vocabulary of millions."""


def similarities(descriptors: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    """Compare pictures by their visual words, the rare ones weighing most.

    The words are some of the descriptors; each descriptor counts for the one most like it.

    Parameters
    ----------
    descriptors : sequence of (K, D) float32
        Of each picture.

    Returns
    -------
    (P, P) float64
        Cosine between the weighted counts of words (tf-idf), 0 where a picture has none. Symmetric;
        the same for the same descriptors.

    References
    ----------
    Sivic and Zisserman 2003.
    """
    normed = [_normed(each) for each in descriptors]
    counts = np.zeros((len(normed), NUM_WORDS))
    if any(len(each) for each in normed):
        pool = np.concatenate([each for each in normed if len(each)])
        words = np.random.default_rng(0).permutation(pool)[:NUM_WORDS]
        for row, each in zip(counts, normed, strict=True):
            np.add.at(row, np.argmax(each @ words.T, axis=1), 1.0)
    pictures = np.count_nonzero(counts, axis=0)
    weighted = np.sqrt(counts) * np.log((1 + len(counts)) / (1 + pictures))
    length = np.linalg.norm(weighted, axis=1, keepdims=True)
    weighted /= np.where(length > 0, length, 1.0)
    return weighted @ weighted.T


def retrieve(
    similarity: NDArray[np.float64],
    frame: NDArray[np.int64],
    *,
    min_apart: int,
    max_pairs: int,
    max_per_picture: int,
) -> list[tuple[int, int]]:
    """Name the pairs of pictures that are most alike among those far apart in time.

    Parameters
    ----------
    similarity : (P, P) float64
        Of :func:`similarities`.
    frame : (P,) int64
        Of each picture, rising.
    min_apart : int
        Frames; pictures nearer in time are no pair.
    max_pairs, max_per_picture : int
        Pairs in all and with any one picture, at most.

    Returns
    -------
    list of (int, int)
        Positions of the earlier and the later picture, the most alike first. Of pairs whose
        pictures are the same or next to each other on both sides only the first is there.

    Examples
    --------
    >>> likeness = np.array([[1, 0.9, 0.4, 0.5], [0.9, 1, 0.3, 0.2], [0.4, 0.3, 1, 0.8],
    ...                      [0.5, 0.2, 0.8, 1]])
    >>> retrieve(likeness, np.array([0, 10, 60, 90]), min_apart=50, max_pairs=9, max_per_picture=1)
    [(0, 3)]
    """
    far = frame[None, :] - frame[:, None] >= min_apart
    left = np.where(far, similarity, 0.0)
    found: list[tuple[int, int]] = []
    while len(found) < max_pairs and left.max(initial=0.0) > 0.0:
        first, second = (int(i) for i in np.unravel_index(np.argmax(left), left.shape))
        found.append((first, second))
        left[max(0, first - 1) : first + 2, max(0, second - 1) : second + 2] = 0.0
        for place in (first, second):
            if sum(place in pair for pair in found) >= max_per_picture:
                left[place] = left[:, place] = 0.0
    return found


def _normed(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows of length 1, after the root of each entry: repeated structure counts less (RootSIFT)."""
    rooted = np.sign(descriptors) * np.sqrt(np.abs(descriptors))
    length = np.linalg.norm(rooted, axis=1, keepdims=True)
    return (rooted / np.where(length > 0, length, 1.0)).astype(np.float32)
