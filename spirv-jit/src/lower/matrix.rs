//! Matrices and products of vectors. Matrices are column-major lists of scalars.

use rspirv::spirv::Op;

use super::Lowerer;
use crate::Error;
use crate::ir::{self, Value};
use crate::parse::{Id, Instruction};

/// A matrix by its scalars: columns of `rows` each. A vector is one column.
#[derive(Clone, Debug)]
pub(super) struct Matrix {
    pub rows: usize,
    pub values: Vec<Value>,
}

impl Matrix {
    pub fn columns(&self) -> usize {
        self.values.len() / self.rows.max(1)
    }

    pub fn at(&self, row: usize, column: usize) -> Value {
        self.values[column * self.rows + row]
    }

    pub fn row(&self, row: usize) -> Vec<Value> {
        (0..self.columns())
            .map(|column| self.at(row, column))
            .collect()
    }

    pub fn column(&self, column: usize) -> &[Value] {
        &self.values[column * self.rows..(column + 1) * self.rows]
    }
}

impl Lowerer<'_> {
    /// A vector or matrix id.
    pub(super) fn matrix(&mut self, id: Id) -> Result<Matrix, Error> {
        let ty = self.type_of(id)?;
        let values = self.leaves(id)?.to_vec();
        let rows = match self.types.kind(ty)? {
            super::types::TypeKind::Matrix { column, .. } => self.types.element_count(*column)?,
            _ => values.len() as u32,
        };
        if rows == 0 || !values.len().is_multiple_of(rows as usize) {
            return Err(self.b.invalid("a vector or matrix is expected"));
        }
        let rows = rows as usize;
        Ok(Matrix { rows, values })
    }

    /// The sum of products, left to right, without fusing.
    pub(super) fn dot(&mut self, a: &[Value], b: &[Value]) -> Result<Value, Error> {
        if a.len() != b.len() || a.is_empty() {
            return Err(self.b.invalid("factors of a product do not match"));
        }
        let mut sum = self.b.binary(ir::Op::FMul, a[0], b[0])?;
        for (&a, &b) in a.iter().zip(b).skip(1) {
            let product = self.b.binary(ir::Op::FMul, a, b)?;
            sum = self.b.binary(ir::Op::FAdd, sum, product)?;
        }
        Ok(sum)
    }

    pub(super) fn lower_matrix(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let a = self.matrix(operands[0])?;
        let mut values = Vec::new();
        if instruction.opcode == Op::Transpose {
            for row in 0..a.rows {
                values.extend(a.row(row));
            }
            return self.define_typed(instruction, values);
        }
        let b = self.matrix(operands[1])?;
        match instruction.opcode {
            Op::MatrixTimesScalar | Op::VectorTimesScalar => {
                // Components of cooperative matrices may be integers.
                let op = match self.b.ty(b.values[0]).is_float() {
                    true => ir::Op::FMul,
                    false => ir::Op::IMul,
                };
                for &component in &a.values {
                    values.push(self.b.binary(op, component, b.values[0])?);
                }
            }
            Op::VectorTimesMatrix => {
                for column in 0..b.columns() {
                    values.push(self.dot(&a.values, b.column(column))?);
                }
            }
            Op::MatrixTimesVector => values = self.matrix_times_column(&a, &b.values)?,
            Op::MatrixTimesMatrix => {
                for column in 0..b.columns() {
                    values.extend(self.matrix_times_column(&a, b.column(column))?);
                }
            }
            Op::OuterProduct => {
                for &right in &b.values {
                    for &left in &a.values {
                        values.push(self.b.binary(ir::Op::FMul, left, right)?);
                    }
                }
            }
            _ if self.types.is_bfloat16(instruction.result_type) => {
                let mut factors = [a.values, b.values];
                for value in factors.iter_mut().flatten() {
                    *value = self.widen_bfloat16(*value)?;
                }
                let sum = self.dot(&factors[0], &factors[1])?;
                values.push(self.narrow_to_bfloat16(sum, false)?);
            }
            _ => values.push(self.dot(&a.values, &b.values)?),
        }
        self.define_typed(instruction, values)
    }

    fn matrix_times_column(&mut self, a: &Matrix, column: &[Value]) -> Result<Vec<Value>, Error> {
        (0..a.rows)
            .map(|row| self.dot(&a.row(row), column))
            .collect()
    }

    /// `a * d - b * c`.
    fn cross_difference(&mut self, [a, b, c, d]: [Value; 4]) -> Result<Value, Error> {
        let left = self.b.binary(ir::Op::FMul, a, d)?;
        let right = self.b.binary(ir::Op::FMul, b, c)?;
        self.b.binary(ir::Op::FSub, left, right)
    }

    /// The determinant of a square matrix without some rows and columns, by expansion along the
    /// first column left.
    fn minor(&mut self, m: &Matrix, rows: &[usize], columns: &[usize]) -> Result<Value, Error> {
        match *rows {
            [row] => Ok(m.at(row, columns[0])),
            [r0, r1] => self.cross_difference([
                m.at(r0, columns[0]),
                m.at(r0, columns[1]),
                m.at(r1, columns[0]),
                m.at(r1, columns[1]),
            ]),
            _ => {
                let mut sum = None;
                for (index, &row) in rows.iter().enumerate() {
                    let rest: Vec<usize> = rows.iter().copied().filter(|&r| r != row).collect();
                    let minor = self.minor(m, &rest, &columns[1..])?;
                    let term = self.b.binary(ir::Op::FMul, m.at(row, columns[0]), minor)?;
                    sum = Some(match sum {
                        None => term,
                        Some(sum) if index % 2 == 1 => self.b.binary(ir::Op::FSub, sum, term)?,
                        Some(sum) => self.b.binary(ir::Op::FAdd, sum, term)?,
                    });
                }
                sum.ok_or_else(|| self.b.invalid("a matrix is empty"))
            }
        }
    }

    fn check_square(&self, m: &Matrix) -> Result<(), Error> {
        if m.rows == m.columns() && m.rows <= 4 && self.b.ty(m.values[0]).is_float() {
            return Ok(());
        }
        Err(self.b.invalid("a square matrix is expected"))
    }

    /// GLSL.std.450 `Determinant`.
    pub(super) fn determinant(&mut self, m: &Matrix) -> Result<Value, Error> {
        self.check_square(m)?;
        let all: Vec<usize> = (0..m.rows).collect();
        self.minor(m, &all, &all)
    }

    /// GLSL.std.450 `MatrixInverse`: cofactors over the determinant.
    pub(super) fn inverse(&mut self, m: &Matrix) -> Result<Vec<Value>, Error> {
        self.check_square(m)?;
        let all: Vec<usize> = (0..m.rows).collect();
        let determinant = self.determinant(m)?;
        let one = self.b.float(self.b.ty(determinant), 1.0);
        let scale = self.b.binary(ir::Op::FDiv, one, determinant)?;
        let mut values = Vec::new();
        for column in 0..m.rows {
            for row in 0..m.rows {
                // Element (row, column) of the inverse is cofactor (column, row).
                let rows: Vec<usize> = all.iter().copied().filter(|&r| r != column).collect();
                let columns: Vec<usize> = all.iter().copied().filter(|&c| c != row).collect();
                let cofactor = match rows.is_empty() {
                    true => one,
                    false => self.minor(m, &rows, &columns)?,
                };
                let value = self.b.binary(ir::Op::FMul, cofactor, scale)?;
                let negative = (row + column) % 2 == 1;
                values.push(if negative {
                    self.b.unary(ir::Op::FNeg, value)?
                } else {
                    value
                });
            }
        }
        Ok(values)
    }
}
