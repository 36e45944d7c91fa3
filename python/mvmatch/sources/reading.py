"""Reading a source up to its end or its damage."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mvmatch.sources.base import MotionSource
    from mvmatch.sources.structure import ReferenceStructure
    from mvmatch.types import MotionField


class UntilDamage:
    """The fields of a source, counted on the way; an error ends them and is kept.

    Parameters
    ----------
    source : MotionSource
        Read once.
    structure : ReferenceStructure
        Counts every field.
    tell : callable, optional
        Told after each field how many there were, and how many there will be if that is known.
    """

    def __init__(
        self,
        source: MotionSource,
        structure: ReferenceStructure,
        tell: Callable[[int, int | None], None] | None = None,
    ) -> None:
        self._source = source
        self._structure = structure
        self._tell = tell
        self.damage: MvmatchError | None = None
        """Why the source broke off; None while it has not."""

    def __iter__(self) -> Iterator[MotionField]:
        """Yield the fields before the damage."""
        total = self._source.info.num_frames
        try:
            for count, field in enumerate(self._source, 1):
                self._structure.add(field)
                if self._tell is not None:
                    self._tell(count, total)
                yield field
        except MvmatchError as error:
            self.damage = error
