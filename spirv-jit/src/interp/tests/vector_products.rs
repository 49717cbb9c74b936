//! Products of a matrix in memory and vectors, in every tier, against their definition in `eval`.

use std::fmt::Write;
use std::sync::Arc;

use super::numbers::Random;
use super::{Bench, on_tiers};
use crate::SUBGROUP_SIZE;
use crate::environment::{Descriptor, DescriptorSet};
use crate::eval::f16;
use crate::eval::matrix::{self, narrow};
use crate::ir::op::{Component, Space, VectorProduct};
use crate::reach::{Range, Reach};

const MEMORY_BYTES: usize = 4096;

/// All products that there are.
fn products() -> impl Iterator<Item = VectorProduct> {
    let all = Component::ALL;
    let pairs = all
        .into_iter()
        .flat_map(move |matrix| all.map(|vector| (matrix, vector)));
    let kinds = pairs.flat_map(move |(matrix, vector)| all.map(|sum| (matrix, vector, sum)));
    let products = kinds.flat_map(|(matrix, vector, sum)| {
        [0, 1, 2, 3].map(|bits| VectorProduct {
            matrix,
            vector,
            sum,
            by_columns: bits & 1 != 0,
            adds: bits & 2 != 0,
        })
    });
    products.filter(VectorProduct::is_valid)
}

/// Rows and columns of a matrix, and the kind of memory that it is in.
#[derive(Clone, Copy, Debug)]
struct Case {
    product: VectorProduct,
    rows: usize,
    columns: usize,
    space: Space,
    /// Offset and stride where all lanes of all subgroups have one matrix.
    shared: Option<[usize; 2]>,
    /// Of the wave.
    subgroups: usize,
}

impl Case {
    /// Inputs: the offset of the matrix, its stride, whether the lane is active, its number, the
    /// vector, and the sums.
    fn inputs(&self) -> usize {
        4 + self.columns + self.rows
    }

    fn lanes(&self) -> usize {
        SUBGROUP_SIZE * self.subgroups
    }

    /// A program that writes the components of a result to buffer 1, a row of words each. Memory
    /// begins at `base`.
    fn program(&self, base: u64) -> String {
        let inputs: Vec<String> = (0..self.inputs())
            .map(|row| format!("payload.{row}"))
            .collect();
        let place = |input: usize| match self.shared {
            Some(place) => format!("const {}", place[input]),
            None => format!("input[{input}]"),
        };
        let mut text = format!(
            "module closest_hit
            inputs {}
            output_rows 0
            func f0 {{
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: descriptor = descriptor[set 0, first 1, count 1] v0
            v3: i32 = input[3]
            v4: i32 = const 2
            v5: i32 = shl v3, v4
            v6: i32 = {}
            v7: i32 = {}
            v8: i32 = input[2]
            v9: i1 = ine v8, v0
            v10: i64 = const {base}
            v11: i64 = uconvert v6
            v12: i64 = iadd v10, v11
            v13: i32 = const {}
            ",
            inputs.join(", "),
            place(0),
            place(1),
            4 * self.lanes(),
        );
        let mut next = 14;
        let mut value = |text: &mut String, definition: &str| {
            writeln!(text, "v{next}: {definition}").unwrap();
            next += 1;
            next - 1
        };
        let mut args = Vec::new();
        for row in 4..self.inputs() {
            let component = match row - 4 < self.columns {
                true => self.product.vector,
                false => self.product.sum,
            };
            let ty = component.ty();
            let word = value(&mut text, &format!("i32 = input[{row}]"));
            let integer = match ty.bits() {
                32 => word,
                _ => value(
                    &mut text,
                    &format!("{} = uconvert v{word}", ty.as_integer()),
                ),
            };
            args.push(match ty.is_float() {
                true => value(&mut text, &format!("{ty} = bitcast v{integer}")),
                false => integer,
            });
        }
        if !self.product.adds {
            args.truncate(self.columns);
        }
        let args: Vec<String> = args.iter().map(|value| format!("v{value}")).collect();
        let first = next;
        let ty = self.product.sum.ty();
        let results: Vec<String> = (0..self.rows)
            .map(|k| format!("v{}: {ty}", first + k))
            .collect();
        let op = crate::ir::text::print_op(&crate::ir::Op::VectorProduct(self.product, self.space));
        let address = match self.space {
            Space::Buffer => "v1, v6",
            _ => "v12",
        };
        writeln!(
            text,
            "if v9, L0 {{\n{} = {op} {address}, v7, {}",
            results.join(", "),
            args.join(", ")
        )
        .unwrap();
        let mut next = first + self.rows;
        let mut offset = 5;
        for k in 0..self.rows {
            writeln!(text, "store.buffer v2, v{offset}, v{}", first + k).unwrap();
            writeln!(text, "v{next}: i32 = iadd v{offset}, v13").unwrap();
            (offset, next) = (next, next + 1);
        }
        text + "br L0\n} else {\nbr L0\n}\nend\n}"
    }

    /// The result for a vector and sums.
    fn expected(
        &self,
        memory: &[u8],
        [offset, stride]: [usize; 2],
        components: &[u32],
    ) -> Vec<u32> {
        let (vector, sums) = components.split_at(self.columns);
        let mut sums = match self.product.adds {
            true => sums.to_vec(),
            false => vec![0; self.rows],
        };
        let size = self.product.matrix.ty().size_bytes() as usize;
        let element = |row: usize, column: usize| {
            let (line, place) = match self.product.by_columns {
                true => (column, row),
                false => (row, column),
            };
            let at = offset + line * stride + place * size;
            let mut word = [0; 4];
            if let Some(bytes) = memory.get(at..at + size) {
                word[..size].copy_from_slice(bytes);
            }
            u32::from_le_bytes(word)
        };
        matrix::vector_product(&self.product, element, vector, &mut sums);
        sums
    }

    fn check(&self, random: &mut Random, places: &dyn Fn(usize) -> [usize; 2], active: u16) {
        // Moderate floats mostly; any bits else.
        let mut component = |component: Component| {
            let bits = random.next();
            match component.is_float() && bits >> 58 != 0 {
                true => narrow(component, (bits as i32) as f32 / (1 << 29) as f32),
                false => bits as u32 & (u32::MAX >> (32 - component.ty().bits())),
            }
        };
        let mut memory = vec![0u32; MEMORY_BYTES / 4];
        let size = self.product.matrix.ty().size_bytes() as usize;
        let bytes: Vec<u8> = (0..MEMORY_BYTES / size)
            .flat_map(|_| component(self.product.matrix).to_le_bytes()[..size].to_vec())
            .collect();
        for (word, bytes) in memory.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        let components: Vec<Vec<u32>> = (0..self.lanes())
            .map(|_| {
                let vector = (0..self.columns).map(|_| component(self.product.vector));
                let vector: Vec<u32> = vector.collect();
                let sums = (0..self.rows).map(|_| component(self.product.sum));
                vector.into_iter().chain(sums).collect()
            })
            .collect();
        let base = memory.as_ptr() as u64;
        let text = self.program(base);
        on_tiers(|tier| {
            let mut target = vec![0u32; self.lanes() * self.rows];
            let entry = |words: &[u32]| Descriptor {
                address: words.as_ptr() as u64,
                size_bytes: size_of_val(words) as u64,
                ..Descriptor::NULL
            };
            let entries = [entry(&memory), entry(&target)];
            let mut bench = Bench::new(&text, tier, self.subgroups);
            bench.environment.sets[0] = DescriptorSet {
                entries: entries.as_ptr(),
                count: 2,
                ..DescriptorSet::NONE
            };
            bench.environment.reach = Arc::new(Reach::new(vec![Range {
                start: base,
                size_bytes: MEMORY_BYTES as u64,
            }]));
            bench.input(0, |lane| places(lane)[0] as u32);
            bench.input(1, |lane| places(lane)[1] as u32);
            let is_active = |lane: usize| active >> (lane % SUBGROUP_SIZE) & 1 == 1;
            bench.input(2, |lane| u32::from(is_active(lane)));
            bench.input(3, |lane| lane as u32);
            for row in 4..self.inputs() {
                bench.input(row, |lane| components[lane][row - 4]);
            }
            bench.run_to_end();
            // The program wrote there.
            let target = std::hint::black_box(&mut target);
            for lane in 0..self.lanes() {
                let expected = self.expected(&bytes, places(lane), &components[lane]);
                for (row, &expected) in expected.iter().enumerate() {
                    let found = target[row * self.lanes() + lane];
                    let expected = if is_active(lane) { expected } else { 0 };
                    let are_nan =
                        is_nan(self.product.sum, found) && is_nan(self.product.sum, expected);
                    assert!(
                        found == expected || are_nan,
                        "{self:?} in {tier:?}, lane {lane}, row {row}: {found:x}, not {expected:x}"
                    );
                }
            }
        });
    }
}

fn is_nan(component: Component, bits: u32) -> bool {
    match component {
        Component::F16 => f16::from_bits(bits as u16).is_nan(),
        Component::F32 => f32::from_bits(bits).is_nan(),
        _ => false,
    }
}

/// Lanes share a matrix, or have others; some lie across the end of the memory or outside, and some
/// lanes are not active.
#[test]
fn every_product_gives_the_bits_of_its_definition() {
    let mut random = Random(23);
    let shapes = [(1, 1), (16, 16), (5, 33), (40, 7), (17, 18)];
    for (index, product) in products().enumerate() {
        let (rows, columns) = shapes[index % 5];
        let case = Case {
            product,
            rows,
            columns,
            space: if index % 4 < 2 {
                Space::Buffer
            } else {
                Space::Global
            },
            shared: None,
            subgroups: 1,
        };
        let size = product.matrix.ty().size_bytes() as usize;
        let elements = if product.by_columns { rows } else { columns };
        let stride = elements * size + [0, 16, 3][index % 3];
        let places: [&dyn Fn(usize) -> [usize; 2]; 5] = [
            &|_| [64, stride],
            &|lane| [lane % 3 * 100, stride],
            &|lane| [lane * 13, stride + lane],
            &|_| [MEMORY_BYTES - 2 * stride - 1, stride],
            &|lane| [MEMORY_BYTES - 7 * lane, stride],
        ];
        for (kind, places) in places.into_iter().enumerate() {
            // Not all of them each time, since a program is compiled for each.
            if kind % 3 == 0 || kind == 1 + index / 2 % 2 || kind == 4 && index % 2 == 0 {
                case.check(&mut random, places, [0xffff, 0x7bef, 0x00ff][index / 5 % 3]);
            }
        }
    }
}

/// Subgroups of a wave share a matrix: several of them at once, and as many as are left.
#[test]
fn subgroups_share_a_matrix() {
    let mut random = Random(29);
    let shapes = [(16, 64), (5, 33), (20, 96), (1, 256), (33, 7)];
    for (index, product) in products().enumerate() {
        let (rows, columns) = shapes[index % 5];
        let size = product.matrix.ty().size_bytes() as usize;
        let elements = if product.by_columns { rows } else { columns };
        let stride = elements * size + [0, 3, 16][index % 3];
        let lines = if product.by_columns { columns } else { rows };
        // The end of the matrix is outside every other time.
        let offset = match index % 2 {
            0 => 4,
            _ => MEMORY_BYTES.saturating_sub(stride * lines - 5),
        };
        let place = [offset, stride];
        let case = Case {
            product,
            rows,
            columns,
            space: [Space::Buffer, Space::Global][index / 2 % 2],
            shared: Some(place),
            subgroups: [2, 5, 3, 9][index % 4],
        };
        case.check(&mut random, &|_| place, [0xffff, 0x7bef][index / 3 % 2]);
    }
}

/// The longest sums of the largest products of integers are exact.
#[test]
fn long_sums_of_integers_are_exact() {
    let product = VectorProduct {
        matrix: Component::U8,
        vector: Component::U8,
        sum: Component::S32,
        by_columns: false,
        adds: false,
    };
    let columns = VectorProduct::MAX_COMPONENTS;
    let mut sums = [0];
    matrix::vector_product(&product, |_, _| 255, &vec![255; columns], &mut sums);
    assert_eq!(sums, [255 * 255 * columns as u32]);
    let case = Case {
        product,
        rows: 1,
        columns,
        space: Space::Buffer,
        shared: None,
        subgroups: 1,
    };
    case.check(&mut Random(5), &|_| [0, columns], u16::MAX);
}
