"""The small AV1 streams of tests/data that ``make_test_streams.py`` makes."""

from __future__ import annotations

import dataclasses

FLAT = "pred-struct=1:rtc=1:hierarchical-levels=0"
BOOST = "enable-variance-boost=1:variance-boost-strength=3"


@dataclasses.dataclass(frozen=True)
class Clip:
    """One stream: which scene, which encoder, which settings, and what it is there for."""

    scene: str
    encoder: str
    settings: str
    purpose: str
    size: tuple[int, int] = (208, 120)
    frames: int = 10
    pixel_format: str = "yuv420p"


GOOD = "-usage good -b:v 0 -crf 40 -g 9999 -row-mt 0 -threads 1"
REALTIME = "-usage realtime -lag-in-frames 0 -b:v 0 -crf 40 -g 9999 -row-mt 0 -threads 1"

CLIPS: dict[str, Clip] = {
    "svt_flat_p8": Clip("drive", "svt", f"preset=8 crf=35 {FLAT}", "flat low delay"),
    "svt_default": Clip("drive", "svt", f"preset=8 crf=35 {FLAT}:{BOOST}", "the default encoding"),
    "drive": Clip(
        "drive",
        "svt",
        f"preset=8 crf=41 {FLAT}",
        "enough frames and points for a whole model",
        size=(352, 200),
        frames=20,
    ),
    "svt_flat_p10": Clip("drive", "svt", f"preset=10 crf=35 {FLAT}", "the fast encoding"),
    "svt_low_delay_p4": Clip(
        "drive", "svt", "preset=4 crf=40 pred-struct=1", "low delay with hierarchy"
    ),
    "svt_random_access_p6": Clip(
        "drive", "svt", "preset=6 crf=40 hierarchical-levels=3", "hidden frames", frames=18
    ),
    "svt_random_access_p2": Clip(
        "drive",
        "svt",
        "preset=2 crf=42 hierarchical-levels=3",
        "all inter tools of a slow preset",
        frames=18,
    ),
    "svt_tiles": Clip(
        "drive",
        "svt",
        "preset=8 crf=42 tile-columns=1:tile-rows=1",
        "four tiles",
        size=(320, 192),
        frames=6,
    ),
    "svt_aq": Clip("drive", "svt", "preset=5 crf=40 aq-mode=1", "adaptive quantiser, segments"),
    "svt_all_key": Clip("drive", "svt", f"preset=10 crf=50 g=1 {FLAT}", "no vectors", frames=4),
    "svt_key_every_2": Clip("drive", "svt", f"preset=10 crf=50 g=2 {FLAT}", "short groups"),
    "svt_10bit": Clip(
        "drive", "svt", f"preset=10 crf=45 {FLAT}", "10 bit", frames=4, pixel_format="yuv420p10le"
    ),
    "svt_still_camera": Clip("still", "svt", f"preset=8 crf=40 {FLAT}", "zero vectors and skip"),
    "aom_realtime": Clip("drive", "libaom", f"{REALTIME} -cpu-used 6", "the libaom encoding"),
    "aom_realtime_cyclic": Clip(
        "drive", "libaom", f"{REALTIME} -cpu-used 7 -aq-mode cyclic", "cyclic refresh segments"
    ),
    "aom_good_no_lag": Clip(
        "drive", "libaom", f"{GOOD} -cpu-used 4 -lag-in-frames 0", "LAST is not the previous frame"
    ),
    "aom_good_lag": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 2 -lag-in-frames 19",
        "hidden frames, compound, OBMC, warp, interintra",
        frames=18,
    ),
    "aom_128": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 2 -lag-in-frames 0 -aom-params sb-size=128",
        "superblocks of 128 px",
        size=(264, 152),
        frames=7,
    ),
    "aom_64": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 2 -lag-in-frames 0 -aom-params sb-size=64",
        "superblocks of 64 px",
        size=(264, 152),
        frames=7,
    ),
    "aom_still_128": Clip(
        "still",
        "libaom",
        f"{GOOD} -crf 55 -cpu-used 2 -lag-in-frames 0 -aom-params sb-size=128",
        "blocks of 128 px",
        size=(400, 264),
        frames=4,
    ),
    "aom_global": Clip(
        "spin",
        "libaom",
        f"{GOOD} -cpu-used 1 -lag-in-frames 12 -aom-params enable-global-motion=1",
        "global motion: the camera turns about its axis and approaches a wall",
        frames=14,
    ),
    "aom_warp": Clip(
        "spin",
        "libaom",
        f"{GOOD} -cpu-used 1 -lag-in-frames 0 -aom-params enable-global-motion=0",
        "local warp and OBMC",
        frames=8,
    ),
    "aom_tiles": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 5 -lag-in-frames 0 -tiles 2x2 -aom-params num-tile-groups=2",
        "tiles in two tile groups",
        size=(320, 192),
        frames=6,
    ),
    "aom_variance": Clip(
        "drive", "libaom", f"{GOOD} -cpu-used 4 -lag-in-frames 8 -aq-mode variance", "segments"
    ),
    "aom_delta_q": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 4 -lag-in-frames 8 -aom-params deltaq-mode=3:delta-lf-mode=1",
        "quantiser and loop filter change per superblock",
    ),
    "aom_error_resilient": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 5 -lag-in-frames 0 -aom-params error-resilient=1",
        "error resilient",
    ),
    "aom_fixed_contexts": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 5 -lag-in-frames 0 -aom-params frame-parallel=1:cdf-update-mode=0",
        "no update of contexts",
    ),
    "aom_reduced": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 3 -lag-in-frames 8 "
        "-aom-params reduced-tx-type-set=1:max-reference-frames=3",
        "reduced sets of transforms and references",
    ),
    "aom_high_quality": Clip(
        "drive",
        "libaom",
        f"{GOOD} -crf 12 -cpu-used 4 -lag-in-frames 0",
        "many coefficients, large levels",
        size=(112, 64),
        frames=8,
    ),
    "aom_odd_size": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 3 -lag-in-frames 8",
        "odd size, blocks overhang",
        size=(211, 117),
    ),
    "aom_tiny": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 3 -lag-in-frames 0",
        "smaller than a superblock",
        size=(34, 18),
    ),
    "aom_320_frames": Clip(
        "spin",
        "libaom",
        f"{REALTIME} -cpu-used 8 -crf 60",
        "order hints wrap after 128 frames",
        size=(64, 48),
        frames=320,
    ),
    "aom_720p": Clip(
        "drive",
        "libaom",
        f"{GOOD} -crf 63 -cpu-used 5 -lag-in-frames 0",
        "a frame larger than 640x360",
        size=(1280, 720),
        frames=3,
    ),
    "aom_tiles_8x8": Clip(
        "drive",
        "libaom",
        f"{GOOD} -crf 58 -cpu-used 6 -lag-in-frames 0 -tiles 8x8 -aom-params sb-size=64",
        "64 tiles",
        size=(512, 512),
        frames=4,
    ),
    "aom_422_128": Clip(
        "drive",
        "libaom",
        f"{GOOD} -crf 50 -cpu-used 2 -lag-in-frames 0 -aom-params sb-size=128",
        "4:2:2 in superblocks of 128 px",
        size=(264, 152),
        frames=5,
        pixel_format="yuv422p",
    ),
    "aom_segments_delta_q": Clip(
        "drive",
        "libaom",
        f"{GOOD} -cpu-used 4 -lag-in-frames 8 -aq-mode variance -aom-params deltaq-mode=1",
        "segments whose superblocks change the quantiser as well",
    ),
    "rav1e_low_latency": Clip(
        "drive",
        "librav1e",
        "-speed 4 -qp 140 -g 9999 -rav1e-params low_latency=true:threads=1",
        "another encoder, low delay",
    ),
    "rav1e_reordered": Clip(
        "drive",
        "librav1e",
        "-speed 3 -qp 150 -g 9999 -rav1e-params threads=1",
        "another encoder, hidden frames",
        frames=14,
    ),
}
