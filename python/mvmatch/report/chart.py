"""Small charts as inline SVG: readable in black and white, with values as tooltips."""

from __future__ import annotations

import base64
import math
import struct
import zlib
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

_WIDTH, _HEIGHT = 450, 230
_LEFT, _RIGHT, _TOP, _BOTTOM = 66, 18, 12, 44
_PLOT_WIDTH, _PLOT_HEIGHT = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

MAX_HEATMAP = 512
"""Cells along a side; of more frames the largest value of each group is drawn."""

_RAMP = np.array([[236, 243, 250], [150, 190, 224], [58, 124, 186], [20, 70, 130], [8, 28, 66]])
"""Light to dark in one hue: safe for every kind of colour vision, and on paper."""


def bars(
    values: Sequence[float],
    labels: Sequence[str],
    *,
    x_label: str,
    y_label: str,
    format_value: str = "{:,.0f}",
) -> str:
    """Draw vertical bars; ``labels`` name each bar and are thinned out on the axis."""
    top, ticks = _scale(max(values, default=0.0))
    parts = [_y_axis(top, ticks, y_label), _x_title(x_label)]
    step = _PLOT_WIDTH / max(len(values), 1)
    every = max(1, math.ceil(len(values) / 12))
    for index, (value, label) in enumerate(zip(values, labels, strict=True)):
        height = _PLOT_HEIGHT * value / top
        width = min(max(0.85 * step, step - 3, 0.5), 52.0)
        x = _LEFT + (index + 0.5) * step - width / 2
        tip = f"{label}: {format_value.format(value)}"
        parts.append(
            f'<rect class="bar" x="{x:.2f}" y="{_TOP + _PLOT_HEIGHT - height:.2f}" '
            f'width="{width:.2f}" height="{height:.2f}">'
            f"<title>{escape(tip)}</title></rect>"
        )
        if index % every == 0:
            parts.append(
                f'<text class="tick" x="{x + width / 2:.1f}" y="{_TOP + _PLOT_HEIGHT + 14}" '
                f'text-anchor="middle">{escape(label)}</text>'
            )
    return _svg(parts, f"{y_label} by {x_label}")


def histogram(values: ArrayLike, *, x_label: str, y_label: str, upper: float | None = None) -> str:
    """Draw a histogram of 30 bins from 0 to ``upper`` (default: the largest value)."""
    numbers = np.asarray(values, np.float64)
    top_value = upper if upper is not None else _scale(float(numbers.max(initial=0.0)))[0]
    counts, edges = np.histogram(np.clip(numbers, 0, top_value), bins=30, range=(0, top_value))
    top, ticks = _scale(float(counts.max(initial=0)))
    parts = [_y_axis(top, ticks, y_label), _x_title(x_label)]
    step = _PLOT_WIDTH / len(counts)
    for index, count in enumerate(counts.tolist()):
        height = _PLOT_HEIGHT * count / top
        tip = f"{edges[index]:.3g} to {edges[index + 1]:.3g}: {count}"
        parts.append(
            f'<rect class="bar" x="{_LEFT + index * step + 0.5:.2f}" '
            f'y="{_TOP + _PLOT_HEIGHT - height:.2f}" width="{step - 1:.2f}" '
            f'height="{height:.2f}"><title>{tip}</title></rect>'
        )
    for tick in np.linspace(0, top_value, 6).tolist():
        x = _LEFT + _PLOT_WIDTH * tick / top_value
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{_TOP + _PLOT_HEIGHT + 14}" '
            f'text-anchor="middle">{tick:.3g}</text>'
        )
    return _svg(parts, f"Histogram of {x_label}")


def paired_bars(
    names: Sequence[str], first: Sequence[float], second: Sequence[float], *, keys: tuple[str, str]
) -> str:
    """Draw two horizontal bars per name, in seconds: one filled, one striped."""
    row, left = 36, 190
    height = 30 + row * len(names) + 26
    width = 720
    room = width - left - 90
    longest = max([*first, *second, 1e-9])
    parts = [_stripes(), _key(left, keys)]
    for index, name in enumerate(names):
        y = 30 + index * row
        parts.append(
            f'<text class="name" x="{left - 8}" y="{y + 17}" text-anchor="end">'
            f"{escape(name)}</text>"
        )
        for offset, value, style in ((0, first[index], "bar"), (14, second[index], "striped")):
            length = room * value / longest
            parts.append(
                f'<rect class="{style}" x="{left}" y="{y + offset}" '
                f'width="{max(length, 1):.1f}" height="12"/>'
                f'<text class="tick" x="{left + max(length, 1) + 5:.1f}" y="{y + offset + 10}">'
                f"{seconds(value)}</text>"
            )
    return _svg(parts, f"{keys[0]} and {keys[1]} by stage", width=width, height=height)


def heatmap(pairs: NDArray[np.int64], frames: int, *, label: str, top: float) -> str:
    """Draw counts of frame pairs as a symmetric matrix, logarithmic; empty cells stay white.

    Parameters
    ----------
    pairs : (P, 3) rows ``[frame0, frame1, count]``.
    frames : rows and columns of the matrix.
    label : for screen readers.
    top : count of the darkest colour.
    """
    cells = _cells(pairs, frames)
    size, left, upper = 330, 46, 8
    image = base64.b64encode(_png(_colours(cells, top))).decode("ascii")
    parts = [
        f'<image x="{left}" y="{upper}" width="{size}" height="{size}" '
        f'style="image-rendering:pixelated" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{image}"/>',
        f'<rect class="frame" x="{left}" y="{upper}" width="{size}" height="{size}"/>',
    ]
    _, ticks = _scale(float(max(frames - 1, 1)))
    for tick in ticks:
        if tick != int(tick) or tick > frames - 1:
            continue
        at = (tick + 0.5) / frames * size
        parts.append(
            f'<text class="tick" x="{left + at:.1f}" y="{upper + size + 14}" '
            f'text-anchor="middle">{tick:.0f}</text>'
            f'<text class="tick" x="{left - 6}" y="{upper + at + 3:.1f}" '
            f'text-anchor="end">{tick:.0f}</text>'
        )
    parts.append(
        f'<text class="axis" x="{left + size / 2}" y="{upper + size + 32}" '
        'text-anchor="middle">frame</text>'
        f'<text class="axis" transform="translate(12 {upper + size / 2}) rotate(-90)" '
        'text-anchor="middle">frame</text>'
    )
    return _svg(parts, label, width=left + size + 10, height=upper + size + 40)


def colour_key(top: float) -> str:
    """Draw the colour scale of :func:`heatmap`."""
    ramp = _colours(np.geomspace(1, max(top, 2.0), 160)[None, :], top)
    image = base64.b64encode(_png(ramp)).decode("ascii")
    parts = [
        f'<image x="8" y="4" width="320" height="12" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{image}"/>',
        '<rect class="frame" x="8" y="4" width="320" height="12"/>',
    ]
    decades = range(int(math.log10(max(top, 2.0))) + 1)
    for decade in decades:
        x = 8 + 320 * decade / math.log10(max(top, 2.0))
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="30" text-anchor="middle">{10**decade:,}</text>'
        )
    return _svg(parts, "Colour scale", width=346, height=36)


def seconds(value: float) -> str:
    """Return a time in s with three digits.

    >>> seconds(0.01234), seconds(75.2)
    ('0.012 s', '75.2 s')
    """
    return f"{value:.3f} s" if value < 0.1 else f"{value:.2f} s" if value < 10 else f"{value:.1f} s"


def _scale(largest: float) -> tuple[float, list[float]]:
    """Return an upper end and ticks at round numbers, about five."""
    if not largest > 0:
        return 1.0, [0.0, 1.0]
    raw = largest / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= raw * 0.999)
    number = math.ceil(largest / step - 1e-9)
    return number * step, [index * step for index in range(number + 1)]


def _y_axis(top: float, ticks: Sequence[float], title: str) -> str:
    parts: list[str] = []
    for tick in ticks:
        y = _TOP + _PLOT_HEIGHT * (1 - tick / top)
        parts.append(
            f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="tick" x="{_LEFT - 6}" y="{y + 3:.1f}" text-anchor="end">'
            f"{_short(tick, top)}</text>"
        )
    middle = _TOP + _PLOT_HEIGHT / 2
    parts.append(
        f'<text class="axis" transform="translate(12 {middle}) rotate(-90)" '
        f'text-anchor="middle">{escape(title)}</text>'
    )
    return "".join(parts)


def _x_title(title: str) -> str:
    return (
        f'<text class="axis" x="{_LEFT + _PLOT_WIDTH / 2}" y="{_HEIGHT - 10}" '
        f'text-anchor="middle">{escape(title)}</text>'
    )


def _short(value: float, top: float) -> str:
    """Write a tick with the unit that suits the largest one."""
    if top >= 1e6:
        return f"{value / 1e6:g} M"
    return f"{value / 1e3:g} k" if top >= 1e4 else f"{value:,.4g}"


def _stripes() -> str:
    return (
        '<defs><pattern id="stripes" width="5" height="5" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><rect class="stripe-back" width="5" height="5"/>'
        '<rect class="stripe" width="2.5" height="5"/></pattern></defs>'
    )


def _key(left: int, keys: tuple[str, str]) -> str:
    return (
        f'<rect class="bar" x="{left}" y="6" width="14" height="12"/>'
        f'<text class="tick" x="{left + 19}" y="16">{escape(keys[0])}</text>'
        f'<rect class="striped" x="{left + 90}" y="6" width="14" height="12"/>'
        f'<text class="tick" x="{left + 109}" y="16">{escape(keys[1])}</text>'
    )


def _svg(parts: Sequence[str], label: str, *, width: int = _WIDTH, height: int = _HEIGHT) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def _cells(pairs: NDArray[np.int64], frames: int) -> NDArray[np.float64]:
    """Symmetric matrix of at most `MAX_HEATMAP` rows: the largest count of each group of frames."""
    group = math.ceil(frames / MAX_HEATMAP)
    cells = np.zeros((math.ceil(frames / group),) * 2)
    row, column = pairs[:, :2].T // group
    np.maximum.at(cells, (row, column), pairs[:, 2])
    return np.maximum(cells, cells.T)


def _colours(counts: NDArray[np.float64], top: float) -> NDArray[np.uint8]:
    """Return (rows, columns, 3) colours: white for zero, then the ramp by logarithm."""
    position = np.log(np.maximum(counts, 1.0)) / math.log(max(top, 2.0))
    at = np.linspace(0, 1, len(_RAMP))
    channels = [np.interp(np.clip(position, 0, 1), at, _RAMP[:, channel]) for channel in range(3)]
    picture = np.stack(channels, axis=-1)
    picture[counts <= 0] = 255
    return np.rint(picture).astype(np.uint8)


def _png(picture: NDArray[np.uint8]) -> bytes:
    """Encode (rows, columns, 3) as PNG; ISO/IEC 15948, filter type 0."""
    height, width, _ = picture.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    rows = np.hstack([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)]).tobytes()
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            chunk(b"IDAT", zlib.compress(rows, 9)),
            chunk(b"IEND", b""),
        )
    )
