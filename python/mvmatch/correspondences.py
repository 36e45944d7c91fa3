"""Motion fields as point correspondences: block centre and where its vector leads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.pairing import sum_by_pair
from mvmatch.types import Correspondences, MotionField

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray


def from_motion(field: MotionField, *, keep_zero: bool = True) -> list[Correspondences]:
    """Correspondences of one motion field, one entry per reference frame.

    A block's centre is paired with the centre plus its vector. Pairs with an end outside the
    picture are left out; a compound block gives one pair for each of its references.

    Parameters
    ----------
    field : MotionField
        Vectors of one coded frame.
    keep_zero : bool
        Whether zero vectors count; the paper leaves them out.

    Returns
    -------
    list of Correspondences
        Rising ``frame1``; ``frame0`` is the field's frame, ``xy0`` and ``xy1`` are in px.

    References
    ----------
    Zouein et al. 2025, section II-A.
    """
    start = field.centers
    end = start + field.mv
    size = np.array([field.width, field.height], np.float32)
    valid = np.all((start < size) & (end >= 0) & (end < size), axis=1)
    valid &= field.ref_frame != field.frame
    if not keep_zero:
        valid &= np.any(field.mv != 0, axis=1)
    result: list[Correspondences] = []
    for reference in np.unique(field.ref_frame[valid]).tolist():
        rows = valid & (field.ref_frame == reference)
        result.append(
            Correspondences(
                frame0=field.frame, frame1=int(reference), xy0=start[rows], xy1=end[rows]
            )
        )
    return result


def adjacency(correspondences: Iterable[Correspondences]) -> NDArray[np.int64]:
    """Count correspondences of every frame pair: the paper's figure 1 before tracks.

    Parameters
    ----------
    correspondences : iterable of Correspondences
        Of any frames; both directions of a pair count together.

    Returns
    -------
    ndarray
        (P, 3) int64 ``[frame0, frame1, count]``, ``frame0 < frame1``, pairs in rising order.
    """
    counted = [(pair.frame0, pair.frame1, len(pair)) for pair in correspondences]
    return sum_by_pair(np.array(counted, np.int64).reshape(-1, 3))
