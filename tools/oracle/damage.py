"""What a damaged copy of a stream must still give, found by comparing the bytes of both."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

IVF_HEADER, IVF_FRAME = 32, 12
EMPTY_UNITS = (b"", b"\x12\x00")
# Frame header, tile group, frame.
CODED_OBUS = (3, 4, 6)


@dataclass(frozen=True)
class Demand:
    """What reading a file must give."""

    intact: int | None = None
    """Units of the original before the damage: their records must all come, and be equal."""
    units: list[int] = field(default_factory=list)
    """Number in the file of each of these units."""
    ends: Literal["whole", "refused", "either"] = "whole"
    """Whether the file must be read to its end, must raise a typed error, or may do either."""
    free_records: int | None = None
    """Records that may be wrong where the damage shows only later: as many as libaom gave before it
    refused. All behind the damage without a number."""
    repeats_last: bool = False
    """Whether the last of the intact units comes twice; the rest of the original follows."""


def ivf_packets(path: Path) -> tuple[list[bytes], bool]:
    """Return the complete packets of an IVF file, and whether the file ends with the last one."""
    data, packets, position = path.read_bytes(), list[bytes](), IVF_HEADER
    if len(data) < IVF_HEADER:
        return packets, False
    while position + IVF_FRAME <= len(data):
        (size,) = struct.unpack_from("<I", data, position)
        start = position + IVF_FRAME
        if start + size > len(data):
            return packets, False
        packets.append(data[start : start + size])
        position = start + size
    return packets, position == len(data)


def coded_payloads(unit: bytes) -> Iterator[bytes]:
    """Payloads of the OBUs of a unit that hold frames; every OBU has a size field."""
    position = 0
    while position < len(unit):
        kind, has_extension = unit[position] >> 3 & 15, unit[position] >> 2 & 1
        position += 1 + has_extension
        size = shift = 0
        while True:
            byte = unit[position]
            size |= (byte & 127) << shift
            shift, position = shift + 7, position + 1
            if byte < 128:
                break
        if kind in CODED_OBUS:
            yield unit[position : position + size]
        position += size


def ivf_demand(path: Path, original: list[bytes], says: str) -> Demand:
    """Follow the packets of a damaged IVF file along the original's; libaom ``says`` something."""
    code, records = re.search(r"rc=(\d+)", says), re.search(r"(\d+) records", says)
    reference_refuses = code is None or code[1] != "0"
    packets, is_complete = ivf_packets(path)
    units, intact = list[int](), 0
    for number, packet in enumerate(packets):
        if intact < len(original) and packet == original[intact]:
            units.append(number)
            intact += 1
        elif packet in EMPTY_UNITS:
            continue
        elif intact and packet == original[intact - 1]:
            ends = "either" if reference_refuses else "whole"
            return Demand(intact, units, ends, repeats_last=True)
        else:
            is_loss = intact > 0 and packet in original[intact + 1 :]
            ends = "refused" if reference_refuses and not is_loss else "either"
            free = int(records[1]) if records and ends == "refused" else None
            return Demand(intact, units, ends, free)
    if is_complete:
        # A file that ends between two packets shows no damage.
        return Demand(intact, units, "whole" if intact == len(original) else "either", 0)
    return Demand(intact, units, "refused", 0)


def copy_demand(path: Path, original: list[bytes]) -> Demand:
    """Find the original's units in a cut MKV or Annex B file; a cut MP4 has lost its index."""
    data, position, intact = path.read_bytes(), 0, 0
    if path.suffix == ".mp4":
        return Demand(0, [], "refused", 0)
    for unit in original:
        for payload in coded_payloads(unit):
            position = data.find(payload, position)
            if position < 0:
                return Demand(intact, list(range(intact)), "refused", 0)
            position += len(payload)
        intact += 1
    return Demand(intact, list(range(intact)), "whole", 0)


def demand_of(entry: dict[str, Any], directory: Path) -> Demand:
    """Return what an entry of the manifest's list ``corrupt`` must give."""
    path, original = directory / entry["file"], directory / f"{entry['of']}.ivf"
    packets, _ = ivf_packets(original)
    if path.suffix != ".ivf":
        return copy_demand(path, packets)
    return ivf_demand(path, packets, entry.get("libaom", ""))
