"""Make the small AV1 streams of tests/data from mvmatch's own synthetic scenes.

    python tools/make_test_streams.py tests/data [name ...]

Writes NAME.ivf for each clip, copies of one of them in other containers, and CREDITS.md.
Needs PyAV (SVT-AV1) and imageio-ffmpeg (libaom, rav1e). Encoders differ between versions, so the
streams are stored in the repository; this script documents them and makes new ones.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import av
import imageio_ffmpeg
import numpy as np
from av.video.frame import PictureType

from mvmatch.testing import Rectangle, SyntheticScene, synthetic_drive
from stream_clips import CLIPS, Clip

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_BYTES = 60_000


def scene_for(clip: Clip) -> SyntheticScene:
    """Return the scene of a clip."""
    if clip.scene == "drive":
        return synthetic_drive(clip.frames, clip.size)
    if clip.scene == "still":
        scene = synthetic_drive(1, clip.size)
        poses = np.repeat(scene.cam_from_world, clip.frames, axis=0)
        return dataclasses.replace(scene, cam_from_world=poses, noise=0.0)
    return spin(clip.frames, clip.size)


def spin(num_frames: int, size: tuple[int, int]) -> SyntheticScene:
    """Return a camera that approaches a wall, backs off, and swings about its axis."""
    width, height = size
    wall = Rectangle(
        corner=np.array([-20.0, -20.0, 6.0]),
        side_u=np.array([40.0, 0.0, 0.0]),
        side_v=np.array([0.0, 40.0, 0.0]),
        texture="windows",
        seed=3,
        tint=(150.0, 140.0, 120.0),
    )
    time = np.arange(num_frames)
    poses = np.zeros((num_frames, 3, 4))
    for index, angle in enumerate(0.25 * np.sin(time / 9.0)):
        c, s = np.cos(angle), np.sin(angle)
        poses[index, :, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        poses[index, :, 3] = [0.3 * np.sin(index / 13.0), 0.0, -1.5 * np.sin(index / 10.0)]
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    return SyntheticScene(rectangles=(wall,), width=width, height=height, K=K, cam_from_world=poses)


def frames_of(clip: Clip) -> Iterator[av.VideoFrame]:
    """Render the frames of a clip in its pixel format."""
    scene = scene_for(clip)
    for index in range(clip.frames):
        frame = av.VideoFrame.from_ndarray(scene.render(index), format="rgb24")
        frame = frame.reformat(format=clip.pixel_format)
        frame.pict_type = PictureType.NONE
        frame.pts, frame.time_base = index, Fraction(1, 10)
        yield frame


def encode_svt(clip: Clip, path: Path) -> None:
    """Encode with the SVT-AV1 inside PyAV."""
    options = {"g": "9999"}
    for word in clip.settings.split():
        key, value = word.split("=", 1)
        if key in ("preset", "crf", "g"):
            options[key] = value
        else:
            options["svtav1-params"] = f"{word}:lp=1"
    os.environ["SVT_LOG"] = "1"
    with av.open(str(path), "w", format="ivf") as container:
        stream = container.add_stream("libsvtav1", rate=10)
        stream.width, stream.height = clip.size
        stream.pix_fmt, stream.options = clip.pixel_format, options
        for frame in frames_of(clip):
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def encode_ffmpeg(clip: Clip, path: Path) -> None:
    """Encode with an encoder of imageio-ffmpeg's executable."""
    raw = b"".join(
        bytes(memoryview(plane))[row * plane.line_size :][: plane.width]
        for frame in frames_of(clip)
        for plane in frame.planes
        for row in range(plane.height)
    )
    codec = {"libaom": "libaom-av1"}.get(clip.encoder, clip.encoder)
    width, height = clip.size
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-f", "rawvideo",
        "-pix_fmt", clip.pixel_format, "-s", f"{width}x{height}", "-r", "10", "-i", "pipe:0",
        "-c:v", codec, *clip.settings.split(), "-f", "ivf", "-y", str(path),
    ]  # fmt: skip
    subprocess.run(command, input=raw, check=True)


def copy_container(source: Path, target: Path, container_format: str | None = None) -> None:
    """Copy packets into another container."""
    with av.open(str(source)) as reader, av.open(str(target), "w", container_format) as writer:
        stream = reader.streams.video[0]
        copy = writer.add_stream_from_template(stream, opaque=True)
        for packet in reader.demux(stream):
            if packet.size:
                packet.stream = copy
                writer.mux(packet)


def write_annexb(source: Path, target: Path) -> None:
    """Write the temporal units of an IVF file as Annex B: sizes before units, frames and OBUs."""
    data = source.read_bytes()
    at, out = 32, bytearray()
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        unit = data[at + 12 : at + 12 + size]
        at += 12 + size
        frame = b"".join(leb128(len(obu)) + obu for obu in obus_without_size(unit))
        framed = leb128(len(frame)) + frame
        out += leb128(len(framed)) + framed
    target.write_bytes(out)


def obus_without_size(unit: bytes) -> Iterator[bytes]:
    """Yield OBUs (header and payload) with their size field removed, AV1 specification 5.3."""
    at = 0
    while at < len(unit):
        header, has_extension = unit[at], bool(unit[at] & 4)
        head = bytes([header & ~2]) + unit[at + 1 : at + 1 + has_extension]
        at += 1 + has_extension
        size = shift = 0
        while True:
            byte = unit[at]
            at += 1
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        yield head + unit[at : at + size]
        at += size


def leb128(value: int) -> bytes:
    """Encode an unsigned number, AV1 specification 4.10.5."""
    out = bytearray()
    while value >= 128:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes((*out, value))


def origins(folder: Path) -> str:
    """Return the table of origins."""
    ffmpeg = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-version"], capture_output=True, text=True, check=True
    ).stdout.splitlines()[0]
    lines = [
        "# Where the test streams come from",
        "",
        "Rendered by `mvmatch.testing` (own geometry and procedural textures, no third-party",
        "assets) and encoded by `tools/make_test_streams.py`; same licence as the rest of the",
        "repository.",
        "",
        f"Encoders: `svt` = SVT-AV1 inside PyAV {av.__version__}; "
        f"`libaom`, `librav1e` = {ffmpeg.split(' Copyright')[0]} of imageio-ffmpeg "
        f"{imageio_ffmpeg.__version__}.",
        "",
        "| stream | scene | size, frames | encoder and settings | there for |",
        "|---|---|---|---|---|",
    ]
    for name, clip in CLIPS.items():
        size = (folder / f"{name}.ivf").stat().st_size
        lines.append(
            f"| {name}.ivf ({size / 1000:.1f} kB) | {clip.scene} | {clip.size[0]}x{clip.size[1]}, "
            f"{clip.frames} | {clip.encoder} `{clip.settings}` | {clip.purpose} |"
        )
    lines += [
        "",
        "`svt_flat_p8.mp4`, `.mkv`, `.webm`, `.obu` (Section 5) and `.annexb` hold the packets of "
        "`svt_flat_p8.ivf`.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Make the streams named on the command line, all without names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the streams, such as tests/data")
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(CLIPS)}; else all")
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(CLIPS)
    if unknown:
        parser.error(f"there is no clip {', '.join(sorted(unknown))}")
    folder: Path = arguments.folder
    for name in arguments.names or CLIPS:
        clip = CLIPS[name]
        path = folder / f"{name}.ivf"
        (encode_svt if clip.encoder == "svt" else encode_ffmpeg)(clip, path)
        size = path.stat().st_size
        print(f"{name:24s} {size:7d} bytes")
        if size > MAX_BYTES:
            sys.exit(f"{name} is larger than {MAX_BYTES} bytes")
    first = folder / "svt_flat_p8.ivf"
    for suffix in (".mp4", ".mkv", ".webm", ".obu"):
        copy_container(first, first.with_suffix(suffix))
    write_annexb(first, first.with_suffix(".annexb"))
    (folder / "CREDITS.md").write_text(origins(folder), encoding="utf-8")


if __name__ == "__main__":
    main()
