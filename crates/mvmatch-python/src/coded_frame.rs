//! A frame of `av1-motion` as NumPy columns.

use av1_motion::{Block, Frame, FrameInfo};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One decoded frame, or the order to show an earlier one.
#[pyclass(module = "mvmatch._core", frozen)]
pub struct CodedFrame {
    frame: Frame,
    info: FrameInfo,
}

/// The values in one piece of memory, or a `MemoryError`.
fn collected<T>(values: impl Iterator<Item = T>) -> PyResult<Vec<T>> {
    let no_memory =
        |error: std::collections::TryReserveError| PyMemoryError::new_err(error.to_string());
    let mut column = Vec::new();
    column
        .try_reserve(values.size_hint().0)
        .map_err(no_memory)?;
    for value in values {
        if column.len() == column.capacity() {
            column.try_reserve(1).map_err(no_memory)?;
        }
        column.push(value);
    }
    Ok(column)
}

/// Columns of a table by name.
struct Columns<'py>(Bound<'py, PyDict>);

impl<'py> Columns<'py> {
    fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    fn add<T: Element>(&self, name: &str, values: impl Iterator<Item = T>) -> PyResult<()> {
        self.0
            .set_item(name, collected(values)?.into_pyarray(self.0.py()))
    }

    fn add_rows<T: Element, const K: usize>(
        &self,
        name: &str,
        rows: impl Iterator<Item = [T; K]>,
    ) -> PyResult<()> {
        self.0.set_item(name, table(self.0.py(), rows)?)
    }
}

fn table<T: Element, const K: usize>(
    py: Python<'_>,
    rows: impl Iterator<Item = [T; K]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let flat = collected(rows.flatten())?;
    let count = flat.len() / K;
    flat.into_pyarray(py).reshape([count, K])
}

#[pymethods]
impl CodedFrame {
    #[getter]
    fn decode_index(&self) -> u64 {
        self.frame.decode_index
    }

    #[getter]
    fn display_index(&self) -> i64 {
        self.frame.display_index
    }

    #[getter]
    fn unit_index(&self) -> u64 {
        self.frame.unit_index
    }

    #[getter]
    fn temporal_id(&self) -> u8 {
        self.frame.temporal_id
    }

    #[getter]
    fn spatial_id(&self) -> u8 {
        self.frame.spatial_id
    }

    #[getter]
    fn is_output(&self) -> bool {
        self.frame.is_output
    }

    #[getter]
    fn order_hint(&self) -> u32 {
        self.info.order_hint
    }

    #[getter]
    fn frame_type(&self) -> &'static str {
        ["KEY", "INTER", "INTRA_ONLY", "SWITCH"][usize::from(self.info.frame_type & 3)]
    }

    #[getter]
    fn show_frame(&self) -> bool {
        self.info.show_frame
    }

    #[getter]
    fn showable_frame(&self) -> bool {
        self.info.showable_frame
    }

    #[getter]
    fn show_existing_frame(&self) -> bool {
        self.info.show_existing_frame
    }

    /// Width of the shown picture.
    #[getter]
    fn upscaled_width(&self) -> u32 {
        self.info.upscaled_width
    }

    /// Coded width.
    #[getter]
    fn width(&self) -> u32 {
        self.info.frame_width
    }

    #[getter]
    fn height(&self) -> u32 {
        self.info.frame_height
    }

    #[getter]
    fn base_q_idx(&self) -> u8 {
        self.info.base_q_idx
    }

    #[getter]
    fn ref_decode_index<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.references(py, |reference| reference.decode_index.cast_signed())
    }

    #[getter]
    fn ref_display_index<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.references(py, |reference| reference.display_index)
    }

    /// One row for each inter block and reference, in px of a picture of `size`.
    #[pyo3(signature = (size=None))]
    fn motion<'py>(
        &self,
        py: Python<'py>,
        size: Option<(u32, u32)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (width, height) = size.unwrap_or((self.info.upscaled_width, self.info.frame_height));
        let rows = py.detach(|| collected(self.frame.motion_in(width, height)))?;
        let columns = Columns::new(py);
        columns.add_rows("block", rows.iter().map(|row| row.block))?;
        columns.add_rows("mv", rows.iter().map(|row| row.mv))?;
        let frame_number = |index: i64| i32::try_from(index).unwrap_or(i32::MAX);
        columns.add(
            "ref_frame",
            rows.iter()
                .map(|row| frame_number(row.reference.display_index)),
        )?;
        columns.add("flags", rows.iter().map(|row| row.flags))?;
        columns.add("segment_id", rows.iter().map(|row| row.segment_id))?;
        columns.add("qindex", rows.iter().map(|row| row.qindex))?;
        #[expect(clippy::cast_precision_loss, reason = "a proxy, not a count")]
        columns.add("residual", rows.iter().map(|row| row.luma_level as f32))?;
        columns.add_rows(
            "warp",
            rows.iter().map(|row| row.warp.unwrap_or([f64::NAN; 6])),
        )?;
        Ok(columns.0)
    }

    /// One row for each coded block, under the specification's names.
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let blocks = self.frame.blocks();
        let columns = Columns::new(py);
        macro_rules! add {
            ($($name:literal: $value:expr),* $(,)?) => {
                $(columns.add($name, blocks.iter().map($value))?;)*
            };
        }
        add! {
            "mi_row": |b: &Block| b.mi_row,
            "mi_col": |b: &Block| b.mi_col,
            "size": |b: &Block| b.size,
            "partition": |b: &Block| b.partition,
            "is_inter": |b: &Block| b.is_inter && !b.use_intrabc,
            "use_intrabc": |b: &Block| b.use_intrabc,
            "skip": |b: &Block| b.skip,
            "skip_mode": |b: &Block| b.skip_mode,
            "has_chroma": |b: &Block| b.has_chroma,
            "segment_id": |b: &Block| b.segment_id,
            "y_mode": |b: &Block| b.y_mode,
            "uv_mode": |b: &Block| b.uv_mode,
            "motion_mode": |b: &Block| b.motion_mode,
            "interintra_mode": |b: &Block| b.interintra_mode,
            "wedge_interintra": |b: &Block| b.wedge_interintra,
            "wedge_index": |b: &Block| b.wedge_index,
            "wedge_sign": |b: &Block| b.wedge_sign,
            "mask_type": |b: &Block| b.mask_type,
            "compound_type": |b: &Block| b.compound_type,
            "comp_group_idx": |b: &Block| b.comp_group_idx,
            "compound_idx": |b: &Block| b.compound_idx,
            "ref_mv_idx": |b: &Block| b.ref_mv_idx,
            "use_filter_intra": |b: &Block| b.use_filter_intra,
            "filter_intra_mode": |b: &Block| b.filter_intra_mode,
            "cfl_alpha_signs": |b: &Block| b.cfl_alpha_signs,
            "cfl_alpha": |b: &Block| b.cfl_alpha,
            "tx_size": |b: &Block| b.tx_size,
            "q_index": |b: &Block| b.q_index,
            "num_samples": |b: &Block| b.num_samples,
            "is_warp_valid": |b: &Block| b.has_local_warp(),
            "luma_level": |b: &Block| b.luma_level,
        }
        columns.add_rows("ref_frame", blocks.iter().map(|b| b.ref_frame))?;
        let mvs = |b: &Block| [b.mv[0].row, b.mv[0].col, b.mv[1].row, b.mv[1].col];
        columns.add_rows("mv", blocks.iter().map(mvs))?;
        columns.add_rows("interp_filter", blocks.iter().map(|b| b.interp_filter))?;
        columns.add_rows("palette_size", blocks.iter().map(|b| b.palette_size))?;
        columns.add_rows("angle_delta", blocks.iter().map(|b| b.angle_delta))?;
        columns.add_rows("delta_lf", blocks.iter().map(|b| b.delta_lf))?;
        Ok(columns.0)
    }

    /// Facts of the headers, under the specification's names.
    fn header<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (info, sequence) = (&self.info, self.frame.sequence_info());
        let facts = PyDict::new(py);
        macro_rules! set {
            ($from:ident: $($name:ident),* $(,)?) => {
                $(facts.set_item(stringify!($name), $from.$name)?;)*
            };
        }
        set! {
            sequence: seq_profile, still_picture, reduced_still_picture_header, max_frame_width,
            max_frame_height, frame_id_numbers_present, use_128x128_superblock, enable_order_hint,
            order_hint_bits, bit_depth, mono_chrome, subsampling_x, subsampling_y,
            film_grain_params_present,
        }
        set! {
            info: frame_type, show_existing_frame, frame_to_show_map_idx, show_frame,
            showable_frame, error_resilient_mode, disable_cdf_update, disable_frame_end_update_cdf,
            allow_screen_content_tools, allow_intrabc, current_frame_id, order_hint,
            ref_order_hint, ref_sign_bias, ref_upscaled_width, ref_frame_height,
            refresh_frame_flags, primary_ref_frame, frame_width, frame_height, upscaled_width,
            render_width, render_height, superres_denom, mi_rows, mi_cols, base_q_idx,
            using_qmatrix, delta_q_present, delta_q_res, delta_lf_present, delta_lf_multi,
            coded_lossless, segmentation_enabled, segmentation_update_map,
            segmentation_temporal_update, seg_id_pre_skip, cdef_bits, tx_mode, reduced_tx_set,
            allow_high_precision_mv, force_integer_mv, interpolation_filter,
            is_motion_mode_switchable, use_ref_frame_mvs, reference_select, skip_mode_present,
            allow_warped_motion, tile_cols, tile_rows, uniform_tile_spacing,
            context_update_tile_id, gm_params, is_gm_valid, apply_grain,
        }
        facts.set_item("operating_point_idc", sequence.operating_point_idc)?;
        // Arrays of u8 would become bytes objects.
        facts.set_item("ref_frame_idx", info.ref_frame_idx.map(u32::from))?;
        facts.set_item("gm_type", info.gm_type.map(u32::from))?;
        facts.set_item("skip_mode_frame", info.skip_mode_frame.map(u32::from))?;
        let restoration = info.frame_restoration_type.map(u32::from);
        facts.set_item("frame_restoration_type", restoration)?;
        Ok(facts)
    }

    /// (3, 5) counts over the transform blocks of Y, U, V: coded, all zero, sum of end-of-block
    /// positions, sum of absolute levels, negative levels.
    fn coefficient_stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u64>>> {
        let stats = self.frame.coefficient_stats().iter().map(|plane| {
            [
                plane.coded_blocks,
                plane.zero_blocks,
                plane.end_of_block,
                plane.level,
                plane.negative,
            ]
        });
        table(py, stats)
    }

    /// What tools/conformance compares and no user needs.
    #[cfg(feature = "trace")]
    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let trace = self.frame.trace();
        let columns = Columns::new(py);
        let slot =
            |index: usize| trace.slots[index].map(|slot| (slot.decode_index, slot.order_hint));
        columns
            .0
            .set_item("slots", std::array::from_fn::<_, 8, _>(slot))?;
        columns
            .0
            .set_item("num_tile_groups", trace.num_tile_groups)?;
        columns.0.set_item("num_multi_syms", trace.symbols.multi)?;
        columns
            .0
            .set_item("num_binary_syms", trace.symbols.binary)?;
        let blocks = &trace.transform_blocks;
        columns.add_rows(
            "transform_blocks",
            blocks.iter().map(|block| {
                let [plane, size, kind] =
                    [block.plane, block.tx_size, block.tx_type].map(u32::from);
                [plane, block.x4, block.y4, size, kind, block.all_zero.into()]
            }),
        )?;
        Ok(columns.0)
    }
}

impl CodedFrame {
    pub(crate) fn new(frame: Frame) -> Self {
        let info = frame.info();
        Self { frame, info }
    }

    fn references<'py>(
        &self,
        py: Python<'py>,
        index: impl Fn(av1_motion::Reference) -> i64,
    ) -> Bound<'py, PyArray1<i64>> {
        let indices: Vec<i64> = self
            .frame
            .references
            .iter()
            .map(|reference| reference.map_or(-1, &index))
            .collect();
        indices.into_pyarray(py)
    }
}
