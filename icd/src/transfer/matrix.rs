//! Converts matrices in memory, for host and device commands.

use spirv_jit::eval::matrix::{narrow, widen};
use spirv_jit::reach::Reach;

use crate::command::matrix::{Matrix, MatrixConversion};

/// Converts a matrix. Floats are rounded to the nearest, ties to even; components of the same type
/// keep their bits. A matrix that is partly out of reach is not converted.
///
/// # Safety
/// Memory in reach is alive, and nothing else writes it during the call.
pub unsafe fn convert(conversion: &MatrixConversion, reach: &Reach) {
    let (from, to) = (&conversion.source, &conversion.destination);
    let are_there = [from, to]
        .iter()
        .all(|matrix| reach.contains(matrix.address, matrix.size_bytes()));
    if !are_there {
        return;
    }
    let is_turned = from.by_columns != to.by_columns;
    for line in 0..to.lines {
        for element in 0..to.elements {
            let place = match is_turned {
                true => (element, line),
                false => (line, element),
            };
            // SAFETY: the matrices are in reach, and the caller keeps their memory alive and
            // unshared.
            unsafe {
                let bits = load(from, place);
                let bits = match from.component == to.component {
                    true => bits,
                    false => narrow(to.component, widen(from.component, bits)),
                };
                store(to, (line, element), bits);
            }
        }
        if to.is_padded {
            let begin = line * to.stride_bytes + to.elements * to.element_bytes();
            // SAFETY: the check above has found the matrix in reach.
            unsafe { clear(to, begin, (line + 1) * to.stride_bytes) };
        }
    }
    if to.is_padded {
        // SAFETY: the check above has found the matrix in reach.
        unsafe { clear(to, to.lines * to.stride_bytes, to.size_bytes()) };
    }
}

/// Clears a range of a matrix's bytes.
///
/// # Safety
/// As [`convert`]; the matrix is in reach.
unsafe fn clear(matrix: &Matrix, begin: u64, end: u64) {
    let at = (matrix.address + begin) as *mut u8;
    // SAFETY: the caller passes an element or a range inside of the matrix.
    unsafe { at.write_bytes(0, (end - begin) as usize) };
}

fn address(matrix: &Matrix, (line, element): (u64, u64)) -> u64 {
    matrix.address + line * matrix.stride_bytes + element * matrix.element_bytes()
}

/// # Safety
/// As [`convert`]; the element is in the matrix.
unsafe fn load(matrix: &Matrix, place: (u64, u64)) -> u32 {
    let at = address(matrix, place);
    // SAFETY: the caller passes an element or a range inside of the matrix.
    unsafe {
        match matrix.element_bytes() {
            1 => (at as *const u8).read().into(),
            2 => (at as *const u16).read_unaligned().into(),
            _ => (at as *const u32).read_unaligned(),
        }
    }
}

/// # Safety
/// As [`load`].
unsafe fn store(matrix: &Matrix, place: (u64, u64), bits: u32) {
    let at = address(matrix, place);
    // SAFETY: the caller passes an element or a range inside of the matrix.
    unsafe {
        match matrix.element_bytes() {
            1 => (at as *mut u8).write(bits as u8),
            2 => (at as *mut u16).write_unaligned(bits as u16),
            _ => (at as *mut u32).write_unaligned(bits),
        }
    }
}
