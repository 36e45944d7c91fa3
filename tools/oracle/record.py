"""One record of a golden beside the frame that should equal it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mvmatch._core import CodedFrame


@dataclass(frozen=True)
class Record:
    """A frame of ours, and the golden arrays with the number of the record that it should equal."""

    frame: CodedFrame
    golden: dict[str, np.ndarray]
    index: int
    unit: int
    """Number of the IVF packet that the golden should name."""

    @cached_property
    def header(self) -> dict[str, Any]:
        """Facts of the headers."""
        return self.frame.header()

    @cached_property
    def trace(self) -> dict[str, Any] | None:
        """What only the module with the trace tells."""
        trace = getattr(self.frame, "trace", None)
        return None if trace is None else trace()

    @cached_property
    def blocks(self) -> dict[str, np.ndarray]:
        """One row for each block."""
        return self.frame.blocks()

    @property
    def is_shown_again(self) -> bool:
        """Whether the record is a show_existing_frame header."""
        return bool(self.golden["f_show_existing_frame"][self.index])

    @property
    def is_inter(self) -> bool:
        """Whether the frame may refer to others."""
        return self.header["frame_type"] in {1, 3}

    def expected(self, name: str) -> np.ndarray:
        """Return the golden's value for this record."""
        return np.asarray(self.golden[name][self.index]).astype(np.int64)

    @property
    def cells(self) -> slice:
        """Rows of this record in the golden's arrays per 4x4 cell."""
        return slice(self.golden["cell_off"][self.index], self.golden["cell_off"][self.index + 1])
