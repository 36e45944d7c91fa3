"""Procedural grey textures and their band-limited versions (mip maps)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIZE = 1024
"""Texels along each side of a tile; the tile repeats seamlessly."""

TEXELS_PER_METRE = 96.0
"""Resolution of the finest level: a tile covers about 10.7 m."""

NUM_LEVELS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class MipMap:
    """A tile of grey values around 1 and its halved copies."""

    levels: tuple[NDArray[np.float32], ...]

    def sample(
        self, u: NDArray[np.float64], v: NDArray[np.float64], footprint: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Bilinear samples from the level that suits the distance of neighbouring samples.

        Parameters
        ----------
        u, v : (N,) m on the surface.
        footprint : (N,) m between neighbouring samples on the surface.

        Returns
        -------
        (N,) grey factor, about 0 to 2.
        """
        texels = np.maximum(footprint * TEXELS_PER_METRE, 1.0)
        level = np.clip(np.rint(np.log2(texels)).astype(np.int64), 0, len(self.levels) - 1)
        grey = np.empty(len(u), np.float32)
        for index, image in enumerate(self.levels):
            rows = np.flatnonzero(level == index)
            if len(rows):
                scale = TEXELS_PER_METRE / 2**index
                grey[rows] = _bilinear(image, u[rows] * scale - 0.5, v[rows] * scale - 0.5)
        return grey


def _bilinear(
    image: NDArray[np.float32], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float32]:
    size = image.shape[0]
    x0, y0 = np.floor(x), np.floor(y)
    dx, dy = (x - x0).astype(np.float32), (y - y0).astype(np.float32)
    column, row = x0.astype(np.int64) & (size - 1), y0.astype(np.int64) & (size - 1)
    right, below = (column + 1) & (size - 1), (row + 1) & (size - 1)
    flat = image.ravel()
    top = flat[row * size + column] * (1 - dx) + flat[row * size + right] * dx
    bottom = flat[below * size + column] * (1 - dx) + flat[below * size + right] * dx
    grey = top * (1 - dy) + bottom * dy
    return grey.astype(np.float32, copy=False)


@cache
def texture(kind: str, seed: int) -> MipMap:
    """Make a texture: ``noise`` (asphalt, plaster), ``bricks`` or ``windows``."""
    rng = np.random.default_rng(seed)
    noise = np.roll(_cloud_noise(seed % 3), rng.integers(SIZE, size=2), axis=(0, 1))
    if kind == "noise":
        grey = 1 + 0.24 * noise
    elif kind == "bricks":
        grey = (1 + 0.18 * noise) * _bricks(rng)
    elif kind == "windows":
        grey = (1 + 0.16 * noise) * _windows(rng)
    else:
        raise ValueError(f"there is no texture named {kind!r}")
    levels = [np.clip(grey, 0.0, 2.0).astype(np.float32)]
    for _ in range(NUM_LEVELS - 1):
        fine = levels[-1]
        half = (fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / 4
        levels.append(half.astype(np.float32, copy=False))
    return MipMap(levels=tuple(levels))


@cache
def _cloud_noise(seed: int) -> NDArray[np.float64]:
    """Make periodic noise of unit variance whose amplitude falls with frequency."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(
        np.fft.fftfreq(SIZE)[:, None] * SIZE, np.fft.rfftfreq(SIZE)[None, :] * SIZE
    )
    frequency[0, 0] = 1.0
    amplitude = frequency**-1.1
    amplitude[frequency < 4] = 0.0  # large patches repeat visibly
    spectrum = np.fft.rfft2(rng.standard_normal((SIZE, SIZE))) * amplitude
    noise = np.fft.irfft2(spectrum, s=(SIZE, SIZE))
    return noise / noise.std()


def _bricks(rng: np.random.Generator) -> NDArray[np.float64]:
    """Rows of stones 64 x 32 texels, every second row shifted, each with its own brightness."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    row = y // 32
    shifted = (x + 32 * (row % 2)) % SIZE
    shade = rng.uniform(0.65, 1.35, (SIZE // 32, SIZE // 64))[row, shifted // 64]
    mortar = (y % 32 < 3) | (shifted % 64 < 3)
    return np.where(mortar, 0.55, shade)


def _windows(rng: np.random.Generator) -> NDArray[np.float64]:
    """Windows 128 x 160 texels of different brightness in a wall, with sills."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    in_x, in_y = x % 256, y % 256
    shade = rng.uniform(0.25, 0.7, (4, 4))[y // 256, x // 256]
    pane = (in_x > 64) & (in_x < 192) & (in_y > 48) & (in_y < 208)
    frame = pane & ((abs(in_x - 128) < 4) | (abs(in_y - 110) < 4))
    sill = (in_x > 56) & (in_x < 200) & (in_y >= 208) & (in_y < 220)
    grey = np.where(pane, shade, 1.0)
    return np.where(frame | sill, 1.35, grey)
