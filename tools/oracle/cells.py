"""The arrays of a golden with one entry per 4x4 cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from oracle.record import Record

# libaom's numbers of the specification's types wedge, diffwtd, average, intra and distance.
LIBAOM_COMPOUND_TYPE = np.array([2, 3, 0, -1, 1], np.int8)
# NEARMV, NEAR_NEARMV, NEAR_NEWMV, NEW_NEARMV.
NEAR_MODES = (14, 18, 21, 22)
BLOCK_WIDTH = np.array(
    [4, 4, 8, 8, 8, 16, 16, 16, 32, 32, 32, 64, 64, 64, 128, 128, 4, 16, 8, 32, 16, 64]
)
BLOCK_HEIGHT = np.array(
    [4, 8, 4, 8, 16, 8, 16, 32, 16, 32, 64, 32, 64, 128, 64, 128, 16, 4, 32, 8, 64, 16]
)
TX_WIDTH = np.array([4, 8, 16, 32, 64, 4, 8, 8, 16, 16, 32, 32, 64, 4, 16, 8, 32, 16, 64])
TX_HEIGHT = np.array([4, 8, 16, 32, 64, 8, 4, 16, 8, 32, 16, 64, 32, 16, 4, 32, 8, 64, 16])


def block_columns(b: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of a frame's blocks under a golden's names and with its neutral values."""
    inter, compound = b["is_inter"].astype(bool), b["ref_frame"][:, 1] > 0
    interintra = inter & (b["ref_frame"][:, 1] == 0)
    copied = b["use_intrabc"].astype(bool)
    wedge = b["wedge_index"] + 16 * b["wedge_sign"].astype(np.int16)
    kind = LIBAOM_COMPOUND_TYPE[b["compound_type"]]
    mask = np.select([kind == 2, kind == 3], [wedge, b["mask_type"].astype(np.int16)], -1)
    filters = np.where(inter[:, None], b["interp_filter"].astype(np.int16), -1)
    cfl = b["uv_mode"] == 13
    warped = b["motion_mode"] == 2
    # libaom counts the entries behind NEAR from 0, the specification from 1.
    near = np.isin(b["y_mode"], NEAR_MODES)
    return {
        "blk_row": b["mi_row"],
        "blk_col": b["mi_col"],
        "bsize": b["size"],
        "partition": b["partition"],
        "is_inter": inter,
        "intrabc": copied,
        "mode": b["y_mode"],
        "uv_mode": np.where(inter, -1, np.where(b["has_chroma"], b["uv_mode"], 0).astype(np.int16)),
        "mv": b["mv"].reshape(-1, 2, 2),
        "ref_frame": b["ref_frame"],
        "skip": b["skip"],
        "skip_mode": b["skip_mode"],
        "motion_mode": b["motion_mode"],
        "num_proj_ref": np.where(warped, b["num_samples"], 0),
        "warp_invalid": warped & ~b["is_warp_valid"].astype(bool),
        "interintra_mode": np.where(interintra, b["interintra_mode"].astype(np.int16), -1),
        "interintra_wedge": np.where(
            interintra & b["wedge_interintra"].astype(bool), b["wedge_index"].astype(np.int16), -1
        ),
        "comp_type": np.where(compound, kind, -1),
        "comp_mask": np.where(compound, mask, -1),
        "comp_group_idx": b["comp_group_idx"],
        "compound_idx": np.where(compound, b["compound_idx"], 0),
        "ref_mv_idx": b["ref_mv_idx"] - near.astype(np.uint8),
        "filter_y": filters[:, 0],
        "filter_x": filters[:, 1],
        "segment_id": b["segment_id"],
        "qindex": b["q_index"],
        "delta_lf": b["delta_lf"],
        "palette_y": b["palette_size"][:, 0],
        "palette_uv": b["palette_size"][:, 1],
        "filter_intra": np.where(
            b["use_filter_intra"], b["filter_intra_mode"].astype(np.int16), -1
        ),
        "angle_y": b["angle_delta"][:, 0],
        "angle_uv": b["angle_delta"][:, 1],
        "cfl_signs": np.where(cfl, b["cfl_alpha_signs"].astype(np.int16), -1),
        "cfl_idx": b["cfl_alpha"].astype(np.int8),
    }


def cover(
    shape: tuple[int, int], corners: np.ndarray, sizes: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Cells of a frame (raster order), each with the value of the rectangle that covers it; or -1.

    ``corners`` (N, 2) and ``sizes`` (N, 2) are rows and columns in units of 4 px.
    """
    cells = np.full(shape, -1, np.int64)
    for (row, col), (high, wide), value in zip(corners, sizes, values, strict=True):
        cells[row : row + high, col : col + wide] = value
    return cells.ravel()


def transform_cells(record: Record, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Size and type of the luma transform over each cell; skipped blocks have no transform."""
    assert record.trace is not None
    header, blocks = record.header, record.blocks
    shape = header["mi_rows"], header["mi_cols"]
    luma = record.trace["transform_blocks"]
    luma = luma[luma[:, 0] == 0]
    corners, sizes = luma[:, [2, 1]], np.stack([TX_HEIGHT, TX_WIDTH], axis=1)[luma[:, 3]] // 4
    size = cover(shape, corners, sizes, luma[:, 3])
    kind = cover(shape, corners, sizes, luma[:, 4])
    is_skipped = blocks["skip"].astype(bool)[owner]
    return np.where(is_skipped, blocks["tx_size"][owner], size), np.where(is_skipped, -1, kind)


def compare_cells(record: Record) -> Iterator[tuple[str, bool | None]]:
    """Names of the arrays per cell, each with whether it is equal in this record."""
    columns = block_columns(record.blocks)
    shape = record.header["mi_rows"], record.header["mi_cols"]
    corners = np.stack([columns["blk_row"], columns["blk_col"]], axis=1)
    sizes = np.stack([BLOCK_HEIGHT, BLOCK_WIDTH], axis=1)[columns["bsize"]] // 4
    owner = cover(shape, corners, sizes, np.arange(len(corners)))
    expected = record.cells
    is_covered = len(owner) == expected.stop - expected.start and bool(np.all(owner >= 0))
    yield "cell_off", is_covered
    if not is_covered:
        return
    found = {name: column[owner] for name, column in columns.items()}
    if record.trace is not None:
        found["tx_size"], found["tx_type"] = transform_cells(record, owner)
    for name, values in found.items():
        golden = record.golden[name][expected].astype(np.int64)
        yield name, np.array_equal(golden, values.astype(np.int64))
