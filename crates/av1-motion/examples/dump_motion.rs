//! Writes the motion of an AV1 file as CSV: `dump_motion FILE > motion.csv`.
#![allow(clippy::print_stdout, reason = "an example talks to its user")]

use std::io::{self, BufWriter, Write};

use av1_motion::{ContainerReader, Frame, Limits, Parser, Result};

/// One row for each block and reference, in px of the shown picture.
fn write_rows(out: &mut impl Write, frame: &Frame) -> io::Result<()> {
    for motion in frame.motion() {
        let ([x, y, width, height], [dx, dy]) = (motion.block, motion.mv);
        writeln!(
            out,
            "{},{},{x},{y},{width},{height},{dx},{dy}",
            frame.display_index, motion.reference.display_index
        )?;
    }
    Ok(())
}

fn main() -> Result<()> {
    let Some(path) = std::env::args().nth(1) else {
        println!("usage: dump_motion FILE > motion.csv");
        return Ok(());
    };
    let limits = Limits::default();
    let mut reader = ContainerReader::open(path, &limits)?;
    let mut parser = Parser::new(limits);
    let mut out = BufWriter::new(io::stdout().lock());
    writeln!(out, "frame,reference,x,y,width,height,dx,dy")?;
    while let Some(unit) = reader.next_unit()? {
        parser.push(unit.data, unit.byte_offset);
        while let Some(frame) = parser.next_frame()? {
            write_rows(&mut out, &frame)?;
        }
    }
    parser.finish()?;
    out.flush()?;
    Ok(())
}
