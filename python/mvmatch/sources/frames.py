"""Facts of frame headers, and a list of them that stays small in long videos."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

_TYPES = ("KEY", "INTER", "INTRA_ONLY", "SWITCH")
_SHOWN, _REPEAT = 1, 2
_REFERENCES = 7
_FACTS = 8
_STRIDE = _FACTS + _REFERENCES


@dataclass(frozen=True, kw_only=True)
class FrameFacts:
    """What the header of one frame says; intra frames and repeated frames have one too."""

    decode_index: int
    """Position in decode order; a shown existing frame repeats no index of its own."""
    display_index: int
    """Display index of the picture."""
    frame_type: str
    """``"KEY"``, ``"INTER"``, ``"INTRA_ONLY"`` or ``"SWITCH"``."""
    is_shown: bool
    """Whether this header puts a picture on the screen; of the spatial layers of one picture only
    the highest does."""
    is_repeat: bool
    """Whether it only shows a frame decoded earlier (``show_existing_frame``)."""
    width: int
    """Shown width in px."""
    height: int
    """Shown height in px."""
    base_q_idx: int
    """Base quantiser index, 0 to 255."""
    pts: float | None = None
    """Time in s at which the picture is shown, from the container; None for hidden frames."""
    ref_display_index: tuple[int, ...]
    """Display indices of the seven named references, -1 where there is none; empty when intra."""


class FrameLog(Sequence[FrameFacts]):
    """Facts of many frames, 128 bytes each."""

    def __init__(self) -> None:
        self._values = array("q")
        # NaN where there is no time.
        self._times = array("d")

    def append(self, facts: FrameFacts) -> None:
        """Add one frame at the end."""
        references = facts.ref_display_index
        self._times.append(math.nan if facts.pts is None else facts.pts)
        self._values.extend(
            (
                facts.decode_index,
                facts.display_index,
                _TYPES.index(facts.frame_type),
                _SHOWN * facts.is_shown | _REPEAT * facts.is_repeat,
                facts.width,
                facts.height,
                facts.base_q_idx,
                len(references),
                *references,
                *(0,) * (_REFERENCES - len(references)),
            )
        )

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, index: int) -> FrameFacts: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[FrameFacts]: ...

    def __getitem__(self, index: int | slice) -> FrameFacts | Sequence[FrameFacts]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = range(len(self))[index]
        values = self._values[number * _STRIDE : (number + 1) * _STRIDE]
        pts = self._times[number]
        decode_index, display_index, kind, bits, width, height, base_q_idx, count = values[:_FACTS]
        return FrameFacts(
            decode_index=decode_index,
            display_index=display_index,
            frame_type=_TYPES[kind],
            is_shown=bool(bits & _SHOWN),
            is_repeat=bool(bits & _REPEAT),
            width=width,
            height=height,
            base_q_idx=base_q_idx,
            pts=None if math.isnan(pts) else pts,
            ref_display_index=tuple(values[_FACTS : _FACTS + count]),
        )
