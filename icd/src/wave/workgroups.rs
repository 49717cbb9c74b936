//! The start of workgroups: ids and input rows of their subgroups, in dispatches and draws.

#![forbid(unsafe_code)]

use lanes::LaneMask;
use spirv_jit::program::{AlignedRow, Builtin, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};

/// Largest workgroup memory of a step with several workgroups, so that it stays in a cache.
pub const STEP_SHARED_BYTES: usize = 256 << 10;

/// The start of the subgroups of a program's workgroups.
pub struct Starter {
    pub subgroups_per_workgroup: usize,
    /// Lanes of a workgroup's last subgroup.
    last_lanes: LaneMask,
    first_input: usize,
    /// The source of each input row.
    inputs: Vec<Input>,
    /// Input rows of each subgroup of the workgroup with id 0.
    local_rows: Vec<Row>,
}

/// Inputs of the workgroups of a draw, which a dispatch does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawParameters {
    pub num_workgroups: [u32; 3],
    pub draw_index: u32,
    pub view: u32,
}

/// The value to add to a local input row, which depends on the workgroup's id.
#[derive(Clone, Copy)]
enum Input {
    Local,
    /// A component of the id, times a factor.
    Workgroup {
        component: usize,
        factor: u32,
    },
    NumWorkgroups(usize),
    DrawIndex,
    View,
}

/// Workgroup id of a linear index into a grid, x fastest.
pub fn workgroup_id(index: u64, base: [u32; 3], count: [u32; 3]) -> [u32; 3] {
    let [x, y, _] = count.map(u64::from);
    let [base_x, base_y, base_z] = base;
    [
        base_x.wrapping_add((index % x) as u32),
        base_y.wrapping_add((index / x % y) as u32),
        base_z.wrapping_add((index / x / y) as u32),
    ]
}

impl Starter {
    /// The start of a program with workgroups.
    pub fn new(program: &Program) -> Self {
        let local_size = program.local_size();
        let invocations = local_size.iter().map(|&n| n as usize).product::<usize>();
        let subgroups_per_workgroup = invocations.div_ceil(SUBGROUP_SIZE).max(1);
        let last = invocations - (subgroups_per_workgroup - 1) * SUBGROUP_SIZE;
        let inputs = program.inputs();
        let local_rows = (0..subgroups_per_workgroup)
            .flat_map(|subgroup| {
                inputs.iter().map(move |&input| {
                    local_row(
                        input,
                        subgroup,
                        subgroups_per_workgroup,
                        local_size,
                        program.quads(),
                    )
                })
            })
            .collect();
        Self {
            subgroups_per_workgroup,
            last_lanes: LaneMask::full(last.min(SUBGROUP_SIZE)),
            first_input: program.layout().inputs,
            inputs: inputs
                .iter()
                .map(|&input| workgroup_input(input, local_size))
                .collect(),
            local_rows,
        }
    }

    /// Starts a subgroup of a workgroup.
    pub fn start(
        &self,
        program: &Program,
        state: &mut [AlignedRow],
        workgroup_id: [u32; 3],
        subgroup: usize,
        given: &DrawParameters,
    ) {
        let is_last = subgroup + 1 == self.subgroups_per_workgroup;
        let lanes = if is_last {
            self.last_lanes
        } else {
            LaneMask::ALL
        };
        program.start(state, lanes);
        let local = &self.local_rows[subgroup * self.inputs.len()..];
        for ((row, input), local) in state[self.first_input..]
            .iter_mut()
            .zip(&self.inputs)
            .zip(local)
        {
            row.0 = match *input {
                Input::Local => *local,
                Input::Workgroup { component, factor } => {
                    let first = workgroup_id[component].wrapping_mul(factor);
                    local.map(|word| word.wrapping_add(first))
                }
                Input::NumWorkgroups(component) => [given.num_workgroups[component]; SUBGROUP_SIZE],
                Input::DrawIndex => [given.draw_index; SUBGROUP_SIZE],
                Input::View => [given.view; SUBGROUP_SIZE],
            };
        }
    }

    /// Starts a subgroup of invocations of several workgroups. Each lane has a
    /// `LocalInvocationIndex` and a workgroup id.
    pub fn start_packed(
        &self,
        program: &Program,
        state: &mut [AlignedRow],
        indices: &[usize],
        ids: &[[u32; 3]],
    ) {
        program.start(state, LaneMask::full(indices.len()));
        let rows = &mut state[self.first_input..][..self.inputs.len()];
        for (i, (row, input)) in rows.iter_mut().zip(&self.inputs).enumerate() {
            for (lane, (index, id)) in indices.iter().zip(ids).enumerate() {
                let (subgroup, column) = (index / SUBGROUP_SIZE, index % SUBGROUP_SIZE);
                let local = self.local_rows[subgroup * self.inputs.len() + i][column];
                row.0[lane] = match *input {
                    Input::Workgroup { component, factor } => {
                        local.wrapping_add(id[component].wrapping_mul(factor))
                    }
                    _ => local,
                };
            }
        }
    }
}

fn workgroup_input(input: InputRow, local_size: [u32; 3]) -> Input {
    match input {
        InputRow::Builtin(Builtin::WorkgroupId, component) => Input::Workgroup {
            component: component as usize,
            factor: 1,
        },
        InputRow::Builtin(Builtin::GlobalInvocationId, component) => Input::Workgroup {
            component: component as usize,
            factor: local_size[component as usize],
        },
        InputRow::Builtin(Builtin::NumWorkgroups, component) => {
            Input::NumWorkgroups(usize::from(component.min(2)))
        }
        InputRow::Builtin(Builtin::DrawIndex, _) => Input::DrawIndex,
        InputRow::Builtin(Builtin::ViewIndex, _) => Input::View,
        _ => Input::Local,
    }
}

/// `LocalInvocationIndex` of the `count`th invocation in an order that keeps the invocations of a
/// quad consecutive.
pub fn index_in_quads(count: u32, size_x: u32, size_y: u32) -> u32 {
    let (quad, corner) = (count / 4, count % 4);
    let (quads_x, quads_y) = ((size_x / 2).max(1), (size_y / 2).max(1));
    let x = quad % quads_x * 2 + corner % 2;
    let y = quad / quads_x % quads_y * 2 + corner / 2;
    let z = quad / (quads_x * quads_y);
    (z * size_y + y) * size_x + x
}

/// An input row in the workgroup with id 0.
fn local_row(
    input: InputRow,
    subgroup: usize,
    subgroup_count: usize,
    local_size: [u32; 3],
    quads: bool,
) -> Row {
    let [size_x, size_y, _] = local_size.map(|n| n.max(1));
    std::array::from_fn(|lane| {
        let mut index = (subgroup * SUBGROUP_SIZE + lane) as u32;
        if quads {
            index = index_in_quads(index, size_x, size_y);
        }
        match input {
            InputRow::Builtin(
                Builtin::LocalInvocationId | Builtin::GlobalInvocationId,
                component,
            ) => match component {
                0 => index % size_x,
                1 => index / size_x % size_y,
                _ => index / (size_x * size_y),
            },
            InputRow::Builtin(Builtin::LocalInvocationIndex, _) => index,
            InputRow::Builtin(Builtin::SubgroupId, _) => subgroup as u32,
            InputRow::Builtin(Builtin::NumSubgroups, _) => subgroup_count as u32,
            _ => 0,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_ids_count_x_first() {
        let row = |builtin, component, subgroup| {
            local_row(
                InputRow::Builtin(builtin, component),
                subgroup,
                2,
                [3, 4, 2],
                false,
            )
        };
        // Invocation 17 of 3 × 4 × 2: 17 = 2 + 3 × (1 + 4 × 1).
        assert_eq!(row(Builtin::LocalInvocationId, 0, 1)[1], 2);
        assert_eq!(row(Builtin::LocalInvocationId, 1, 1)[1], 1);
        assert_eq!(row(Builtin::LocalInvocationId, 2, 1)[1], 1);
        assert_eq!(row(Builtin::LocalInvocationIndex, 0, 1)[1], 17);
        assert_eq!(row(Builtin::SubgroupId, 0, 1)[1], 1);
        assert_eq!(row(Builtin::NumSubgroups, 0, 1)[1], 2);
        // Sixteen invocations of 4 × 6: the first four, then those to their right.
        let corners: Vec<u32> = (0..6).map(|i| index_in_quads(i, 4, 6)).collect();
        assert_eq!(corners, [0, 1, 4, 5, 2, 3]);
        let mut all: Vec<u32> = (0..24).map(|i| index_in_quads(i, 4, 6)).collect();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..24));
    }
}
