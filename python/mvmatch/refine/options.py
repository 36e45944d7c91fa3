"""Settings of the refinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How observations are aligned to the pictures. Constants: docs/explanation/refinement.md."""

    when: Literal["auto", "always", "never"] = "auto"
    """Pictures are decoded, which costs more than reading their vectors. ``auto`` does so where no
    camera was given, since the focal length asks for exacter tracks than poses do
    (docs/decisions/0018-pictures-for-an-unknown-camera.md), and for tracks that only make a model
    denser (docs/decisions/0019-dense-points-look-at-the-pictures.md)."""
    min_size: int = 240
    """px, longer side; smaller pictures are not aligned by themselves (``auto``): to their points a
    window is wide. Measured: at 240 px focal lengths and paths gain, at 208 px models were lost."""
    unaligned: Literal["end", "keep"] = "end"
    """What happens to a track where it cannot be aligned: it ends there, or this observation keeps
    the codec's position (with the last correction) and later ones are tried again. Measured:
    ``end`` has the smaller errors and trajectories, ``keep`` covers more."""
    window: int = 11
    """px, odd; side of the patch that is compared. Larger ones are more exact on planes and fail
    more often at the edges of things."""
    max_move: float = 2.0
    """px; farther than this from where codec and neighbours predict a point, it is not aligned."""
    max_round_trip: float = 0.5
    """px between a point and itself aligned there and back."""
    min_texture: float = 0.1
    """(grey levels per px)²; smaller eigenvalue of the patch's mean gradient product. Less is flat
    or an edge, which fixes no position."""
    anchor_age: int = 10
    """Frames; after that many an aligned observation becomes its track's new anchor."""
    anchor_scale: float = 1.5
    """So does one whose patch has grown or shrunk by this factor."""
    num_neighbors: int = 12
    """Nearest tracks that tell how the patch deforms from frame to frame."""

    def __post_init__(self) -> None:
        if self.when not in {"auto", "always", "never"}:
            message = f"when is {self.when!r}; it must be 'auto', 'always' or 'never'"
            raise ValueError(message)
        if self.window < 3 or self.window % 2 == 0:
            message = f"window is {self.window}; it must be odd and at least 3"
            raise ValueError(message)
        if self.unaligned not in {"end", "keep"}:
            message = f"unaligned is {self.unaligned!r}; it must be 'end' or 'keep'"
            raise ValueError(message)
        bounds = {
            "min_size": (self.min_size, 0),
            "max_move": (self.max_move, 0.0),
            "max_round_trip": (self.max_round_trip, 0.0),
            "min_texture": (self.min_texture, 0.0),
            "anchor_age": (self.anchor_age, 1),
            "anchor_scale": (self.anchor_scale, 1.0),
            "num_neighbors": (self.num_neighbors, 3),
        }
        for name, (value, least) in bounds.items():
            if not value >= least:
                message = f"{name} is {value}; it must be at least {least}"
                raise ValueError(message)
