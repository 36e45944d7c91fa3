"""Parquet tables of motion and tracks, streamed in row groups.

Each file says in its metadata which schema it follows, what its columns mean and in which units, so
that it can be read without mvmatch. A file appears under its name only when it is complete.
"""

# pyarrow ships no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

import json
import math
import os
from array import array
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from dataclasses import fields as fields_of
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.batches import columns
from mvmatch.errors import DataError, cannot_write
from mvmatch.sources.frames import FrameFacts, FrameLog
from mvmatch.types import MotionField, Tracks, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
    from types import TracebackType

    import pyarrow as pa
    from numpy.typing import NDArray

    from mvmatch.sources.options import Skipped
    from mvmatch.types import StrPath

SCHEMA_VERSION = 2
"""Raised when a column changes its meaning."""

_CONVENTIONS = (
    "pixels; [x, y], x right, y down; origin at the upper-left image corner, so the centre of the "
    "first pixel is (0.5, 0.5); frame = display index from 0; "
    "xy_in_reference = xy_in_current + mv"
)
_ROWS_PER_GROUP = 1 << 20
_ROWS_AT_ONCE = 1 << 17
_MOTION_ROWS_PER_GROUP = 1 << 17
_HEADER = ("frame", "decode_index", "pts", "width", "height", "is_key", "is_shown", "rows")
"""What is kept of each field beside its rows, as numbers; the time is NaN where there is none."""
_KEY = b"mvmatch"


@dataclass(frozen=True, kw_only=True)
class TracksTable:
    """Tracks and what a later stage needs to know about their video."""

    tracks: Tracks
    info: VideoInfo
    image_names: tuple[str, ...]
    """Name of the image of every frame; its length is the number of frames."""


def write_motion(
    fields: Iterable[MotionField],
    path: StrPath,
    *,
    info: VideoInfo,
    frames: Callable[[], Sequence[FrameFacts]],
) -> int:
    """Write motion fields, whole frames to a row group; intra frames have facts but no rows.

    Parameters
    ----------
    fields : iterable of MotionField
        In decode order; read once, never held.
    path : path
        The Parquet file to write.
    info : VideoInfo
        Facts of the video.
    frames : callable
        Asked for the header facts when the last field is written.

    Returns
    -------
    int
        Rows written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    rows = waiting = 0
    schema = _motion_schema()
    headers = array("d")
    batches: list[Any] = []

    def flush() -> None:
        # A row group of its own for each frame would weigh more than the frame.
        writer.write_table(pa.Table.from_batches(batches, schema), row_group_size=max(waiting, 1))
        batches.clear()

    with _in_place(path) as temporary, pq.ParquetWriter(temporary, schema) as writer:
        for field in fields:
            headers.extend(_field_header(field))
            if len(field):
                batches.append(pa.record_batch(_motion_columns(field), schema=schema))
                waiting += len(field)
            if waiting >= _MOTION_ROWS_PER_GROUP:
                flush()
                rows, waiting = rows + waiting, 0
        if waiting:
            flush()
        extra = {
            "info": asdict(info),
            "fields": _header_columns(headers),
            "frames": columns_of_frames(frames()),
        }
        writer.add_key_value_metadata(_metadata("motion", extra))
    return rows + waiting


class StoredMotion:
    """A motion table as a motion source: what :func:`write_motion` wrote, frame by frame."""

    def __init__(self, path: Path) -> None:
        self._file, extra = _open("motion", path)
        self._info = VideoInfo(**extra["info"])
        self._fields: dict[str, list[Any]] = extra["fields"]
        self._frames = frames_of_columns(extra["frames"])

    @property
    def info(self) -> VideoInfo:
        """What is known about the video."""
        return self._info

    @property
    def frames(self) -> Sequence[FrameFacts]:
        """Header facts of all frames."""
        return self._frames

    @property
    def skipped(self) -> Sequence[Skipped]:
        """Nothing: a table is whole."""
        return ()

    def __enter__(self) -> StoredMotion:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[MotionField]:
        """Yield the fields in the order in which they were written."""
        import pyarrow as pa

        group, table = 0, pa.Table.from_batches([], schema=_motion_schema())
        empty = table
        for values in zip(*self._fields.values(), strict=True):
            header = dict(zip(self._fields, values, strict=True))
            rows = header.pop("rows")
            if rows and not len(table):
                table = self._file.read_row_group(group)
                group += 1
            own, table = (table[:rows], table[rows:]) if rows else (empty, table)
            header |= {"is_key": bool(header["is_key"]), "is_shown": bool(header["is_shown"])}
            yield MotionField(**header, **_motion_arrays(own))


def write_tracks(table: TracksTable, path: StrPath, *, options: Mapping[str, Any]) -> None:
    """Write tracks: one row per observation, ordered by track and frame.

    Parameters
    ----------
    table : TracksTable
        Tracks with their video.
    path : path
        The Parquet file to write.
    options : mapping
        The options that made the tracks, kept in the metadata.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    extra = {
        "info": asdict(table.info),
        "image_names": list(table.image_names),
        "options": dict(options),
    }
    kinds = {"track": pa.int64(), "frame": pa.int32(), "x": pa.float32(), "y": pa.float32()}
    schema = pa.schema(kinds, metadata=_metadata("tracks", extra))
    first = 0
    with (
        _in_place(path) as temporary,
        pq.ParquetWriter(temporary, schema, compression="zstd") as writer,
    ):
        for part in table.tracks.parts(_ROWS_PER_GROUP):
            columns = (part.track_index + first, part.frame, *np.ascontiguousarray(part.xy.T))
            writer.write_table(pa.table([_arrow(column) for column in columns], schema=schema))
            first += len(part)


def read_tracks(path: StrPath) -> TracksTable:
    """Read what :func:`write_tracks` wrote.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    DataError
        It is not a track table of this version.
    """
    path = Path(path)
    file, extra = _open("tracks", path)
    num_tracks = num_rows = 0
    with file, columns(np.int64, np.int32, np.float32) as (offsets, frames, points):
        for batch in _batches(file):
            track, frame, x, y = (_numbers(batch[name]) for name in ("track", "frame", "x", "y"))
            # A track may have begun in the batch before.
            begun = np.arange(num_tracks, int(track[-1]) + 1)
            offsets.add(np.searchsorted(track, begun) + num_rows)
            frames.add(frame)
            points.add(np.stack([x, y], axis=1))
            num_tracks, num_rows = num_tracks + len(begun), num_rows + len(track)
        offsets.add(np.array([num_rows]))
        tracks = Tracks(
            offsets=offsets.array(), frame=frames.array(), xy=points.array().reshape(-1, 2)
        )
    return TracksTable(
        tracks=tracks, info=VideoInfo(**extra["info"]), image_names=tuple(extra["image_names"])
    )


def _batches(file: Any) -> Iterator[Any]:
    """Yield the rows of a table, some at a time."""
    for group in range(file.num_row_groups):
        # Asked for all groups at once, the reader keeps what it has read of the file.
        yield from file.iter_batches(_ROWS_AT_ONCE, row_groups=[group])


def columns_of_frames(frames: Sequence[FrameFacts]) -> dict[str, list[Any]]:
    """Return the facts of all frames by name, as JSON takes them."""
    columns: dict[str, list[Any]] = {item.name: [] for item in fields_of(FrameFacts)}
    for frame in frames:
        for name, column in columns.items():
            column.append(getattr(frame, name))
    return columns


def frames_of_columns(columns: Mapping[str, list[Any]]) -> FrameLog:
    """Return the frames that :func:`columns_of_frames` was given."""
    frames = FrameLog()
    for values in zip(*columns.values(), strict=True):
        facts = dict(zip(columns, values, strict=True))
        facts["ref_display_index"] = tuple(facts["ref_display_index"])
        frames.append(FrameFacts(**facts))
    return frames


def is_table(path: Path) -> bool:
    """Whether a file is Parquet (tables are told from videos by their first bytes)."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


def _open(kind: str, path: Path) -> tuple[Any, dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.exists():
        message = f"there is no file {path}"
        raise FileNotFoundError(message)
    try:
        file = pq.ParquetFile(path)
        extra = json.loads(file.metadata.metadata[_KEY])
    except (pa.ArrowInvalid, KeyError, TypeError, ValueError) as error:
        maker = "extract" if kind == "motion" else "track"
        message = f"{path} is not a {kind} table; `mvmatch {maker}` writes one"
        raise DataError(message) from error
    if extra["kind"] != kind:
        message = f"{path} is a {extra['kind']} table; a {kind} table is needed here"
        raise DataError(message)
    if extra["schema_version"] != SCHEMA_VERSION:
        message = (
            f"{path} follows schema {extra['schema_version']}, this mvmatch reads "
            f"{SCHEMA_VERSION}; write it again from the video"
        )
        raise DataError(message)
    return file, extra


def _metadata(kind: str, extra: Mapping[str, Any]) -> dict[bytes, bytes]:
    described = {"kind": kind, "schema_version": SCHEMA_VERSION, "conventions": _CONVENTIONS}
    return {_KEY: json.dumps({**described, **extra}).encode()}


def _motion_schema() -> pa.Schema:
    import pyarrow as pa

    def column(name: str, kind: Any, unit: str) -> Any:
        return pa.field(name, kind, nullable=False, metadata={"unit": unit})

    return pa.schema(
        [
            column("frame", pa.int32(), "display index"),
            column("x", pa.int32(), "px, left edge of the block"),
            column("y", pa.int32(), "px, upper edge of the block"),
            column("w", pa.int32(), "px"),
            column("h", pa.int32(), "px"),
            column("mv_x", pa.float32(), "px"),
            column("mv_y", pa.float32(), "px"),
            column("ref_frame", pa.int32(), "display index"),
            column("flags", pa.uint16(), "bits of mvmatch.MotionFlags"),
            column("segment_id", pa.uint8(), "1"),
            column("qindex", pa.uint8(), "1"),
            column("residual", pa.float32(), "sum of absolute quantised luma levels"),
            column("warp", pa.list_(pa.float64(), 6), "[a, b, c, d, e, f]; NaN without a model"),
        ]
    )


def _motion_columns(field: MotionField) -> list[Any]:
    import pyarrow as pa

    block, mv = np.ascontiguousarray(field.block.T), np.ascontiguousarray(field.mv.T)
    warp = pa.FixedSizeListArray.from_arrays(_arrow(field.warp.ravel()), 6)
    frame = np.full(len(field), field.frame, np.int32)
    plain = (field.ref_frame, field.flags, field.segment_id, field.qindex, field.residual)
    return [_arrow(values) for values in (frame, *block, *mv, *plain)] + [warp]


def _arrow(values: NDArray[Any]) -> Any:
    """Return numbers (N,) as an Arrow array; pyarrow's own way would import pandas."""
    import pyarrow as pa

    data = pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, data])


def _motion_arrays(table: Any) -> dict[str, Any]:
    def column(name: str) -> Any:
        return _numbers(table[name].combine_chunks())

    warp = _numbers(table["warp"].combine_chunks().flatten()).reshape(-1, 6)
    same = ("ref_frame", "flags", "segment_id", "qindex", "residual")
    return {
        "block": np.stack([column(name) for name in ("x", "y", "w", "h")], axis=1),
        "mv": np.stack([column("mv_x"), column("mv_y")], axis=1),
        "warp": warp,
        **{name: column(name) for name in same},
    }


def _numbers(column: Any) -> NDArray[Any]:
    """Return an Arrow array (N,) without nulls as NumPy's; its own way would import pandas."""
    return np.from_dlpack(column)


def _field_header(field: MotionField) -> tuple[float, ...]:
    """Return the numbers of `_HEADER`."""
    pts = math.nan if field.pts is None else field.pts
    place = (field.frame, field.decode_index, pts, field.width, field.height)
    return (*place, field.is_key, field.is_shown, len(field))


def _header_columns(headers: array[float]) -> dict[str, list[float | None]]:
    """Return the numbers of all fields by name, as JSON takes them."""

    def plain(number: float) -> float | None:
        if math.isnan(number):
            return None
        return int(number) if number.is_integer() else number

    rows = len(_HEADER)
    return {name: [plain(n) for n in headers[at::rows]] for at, name in enumerate(_HEADER)}


@contextmanager
def _in_place(path: Path) -> Generator[Path]:
    """Give a temporary name beside ``path`` that becomes ``path`` when the body succeeds."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise cannot_write(path, error) from error
    try:
        yield temporary
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
