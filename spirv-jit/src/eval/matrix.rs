//! Products of matrices, on the bits of components as rows hold them: see
//! [`MatrixProduct`] and [`VectorProduct`].

use lanes::Row;

use super::float8;
use super::narrow::{bfloat16_from_f32, f16_from_f32, f32_from_f16};
use crate::eval::f16;
use crate::types::{Component, MatrixProduct, VectorProduct};

/// A matrix by its rows.
pub type MatrixRows = [Row; MatrixProduct::SIZE];

/// A component of a factor as an f32, which holds each exactly.
pub fn widen(component: Component, bits: u32) -> f32 {
    match component {
        Component::F16 => f32_from_f16(f16::from_bits(bits as u16)),
        Component::BFloat16 => f32::from_bits(bits << 16),
        Component::F32 => f32::from_bits(bits),
        Component::S8 => f32::from(bits as i8),
        Component::U8 => f32::from(bits as u8),
        Component::E4M3 => float8::f32_from_e4m3(bits as u8),
        Component::E5M2 => float8::f32_from_e5m2(bits as u8),
        Component::S32 | Component::U32 => unreachable!("no factor has such components"),
    }
}

/// An f32 as the bits of a float component.
pub fn narrow(component: Component, value: f32) -> u32 {
    match component {
        Component::F16 => f16_from_f32(value).to_bits().into(),
        Component::BFloat16 => bfloat16_from_f32(value).into(),
        Component::E4M3 => float8::e4m3_from_f32(value).into(),
        Component::E5M2 => float8::e5m2_from_f32(value).into(),
        _ => value.to_bits(),
    }
}

/// An integer plus a sum of products, of 32 bits, as the product says.
#[inline(always)]
pub fn accumulate(product: &MatrixProduct, c: u32, sum: i32) -> u32 {
    let exact = |c: i64, least: i64, most: i64| (c + i64::from(sum)).clamp(least, most) as u32;
    match (product.saturates, product.sum) {
        (false, _) => c.wrapping_add(sum as u32),
        (_, Component::U32) => exact(c.into(), 0, u32::MAX.into()),
        _ => exact((c as i32).into(), i32::MIN.into(), i32::MAX.into()),
    }
}

/// The product of a matrix, whose elements are `element(row, column)`, and a vector; `sums`: the
/// added vector, zeros if there is none, whose place the results take.
pub fn vector_product(
    product: &VectorProduct,
    element: impl Fn(usize, usize) -> u32,
    vector: &[u32],
    sums: &mut [u32],
) {
    for (row, result) in sums.iter_mut().enumerate() {
        let factors = (vector.iter().enumerate()).map(|(column, &component)| {
            let element = widen(product.matrix, element(row, column));
            (element, widen(product.vector, component))
        });
        *result = match product.sum.is_float() {
            true => {
                let first = widen(product.sum, *result);
                narrow(product.sum, factors.fold(first, |sum, (a, b)| sum + a * b))
            }
            // A product of 16 bits is exact.
            false => factors.fold(*result, |sum, (a, b)| {
                sum.wrapping_add((a * b) as i32 as u32)
            }),
        };
    }
}

/// The product of matrices.
pub fn product(product: &MatrixProduct, [a, b, c]: [&MatrixRows; 3]) -> MatrixRows {
    let element = |row: usize, column: usize| {
        let c = c[row][column];
        let is_float = product.sum.is_float();
        let mut sum = if is_float { widen(product.sum, c) } else { 0.0 };
        for k in 0..MatrixProduct::SIZE {
            sum += widen(product.a, a[row][k]) * widen(product.b, b[k][column]);
        }
        match is_float {
            true => narrow(product.sum, sum),
            // At most 16 products of 16 bits: exact.
            false => accumulate(product, c, sum as i32),
        }
    };
    std::array::from_fn(|row| std::array::from_fn(|column| element(row, column)))
}
