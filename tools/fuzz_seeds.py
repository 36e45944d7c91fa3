"""Write the seed inputs of the fuzz targets, derived from the streams of the tests.

    python tools/fuzz_seeds.py FOLDER        (FOLDER/<target>/..., about 2 MB)

Only the standard library is needed.
"""

from __future__ import annotations

import sys
from pathlib import Path

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
IVF_HEADER, PACKET_HEADER = 32, 12
KIND_TO_CODE = {1: 0, 6: 1, 3: 3, 4: 4, 7: 5, 2: 6}
"""OBU types to the codes of `fuzz_targets/headers.rs`."""
LARGEST_FILE = 16_000


def leb128(value: int) -> bytes:
    """Return §4.10.5's form of a number."""
    digits = bytearray()
    while True:
        low, value = value & 0x7F, value >> 7
        digits.append(low | (0x80 if value else 0))
        if not value:
            return bytes(digits)


def packets(stream: bytes) -> list[bytes]:
    """Return the data of the packets of an IVF file."""
    found, at = [], IVF_HEADER
    while at + PACKET_HEADER <= len(stream):
        size = int.from_bytes(stream[at : at + 4], "little")
        found.append(stream[at + PACKET_HEADER :][:size])
        at += PACKET_HEADER + size
    return found


def obus(packet: bytes) -> list[tuple[int, bytes, bytes]]:
    """Return type, header bytes (without size) and payload of each OBU that has a size field."""
    found, at = [], 0
    while at < len(packet):
        first = packet[at]
        header = packet[at : at + (2 if first & 4 else 1)]
        at += len(header)
        size = shift = 0
        while first & 2:
            size |= (packet[at] & 0x7F) << shift
            shift, at = shift + 7, at + 1
            if not packet[at - 1] & 0x80:
                break
        if not first & 2:
            size = len(packet) - at
        found.append((first >> 3 & 15, header, packet[at : at + size]))
        at += size
    return found


def annexb(stream: bytes) -> bytes:
    """Return the stream in the length-delimited format."""
    units = bytearray()
    for packet in packets(stream):
        frame = bytearray()
        for _, header, payload in obus(packet):
            bare = bytes([header[0] & ~2]) + header[1:] + payload
            frame += leb128(len(bare)) + bare
        sized = leb128(len(frame)) + frame
        units += leb128(len(sized)) + sized
    return bytes(units)


def header_parts(stream: bytes) -> bytes:
    """Return the first units in the form of `fuzz_targets/headers.rs`."""
    parts = bytearray()
    for packet in packets(stream)[:12]:
        for number, (kind, _, payload) in enumerate(obus(packet)):
            cut = payload[:255]
            parts += bytes([KIND_TO_CODE.get(kind, 6) | (0x80 if number == 0 else 0), len(cut)])
            parts += cut
    return bytes(parts)


def tile_data(number: int, stream: bytes) -> bytes:
    """Return bytes with the statistics of tiles under a choice of frame and tile."""
    frames = [data for packet in packets(stream) for kind, _, data in obus(packet) if kind == 6]
    longest = max(frames, key=len, default=b"")
    return (number * 20).to_bytes(2, "little") + b"\0" + longest[16:3000]


def main(folder: Path) -> None:
    """Write every seed."""
    for number, path in enumerate(sorted((DATA / "corpus").glob("*.ivf"))):
        stream = path.read_bytes()
        seeds = {"headers": header_parts(stream), "tile": tile_data(number, stream)}
        if len(stream) <= LARGEST_FILE:
            section5 = b"".join(packets(stream))
            seeds |= {"file": stream, "structure": stream, "container": stream[:4000]}
            seeds |= {"file-obu": section5, "file-annexb": annexb(stream)}
            seeds |= {"container-obu": section5[:4000], "container-annexb": annexb(stream)[:4000]}
        for name, data in seeds.items():
            target, _, form = name.partition("-")
            place = folder / target / f"{path.stem}{form and '.' + form}"
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(data)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
