//! Operations that neither branch nor suspend: one instruction each.

use super::{Emitter, instr};
use crate::Error;
use crate::interp::code::{
    AccessPlan, AtomicPlan, ImagePlan, PhysicalAccess, PrintPlan, ProductPlan, SubgroupPlan,
    VectorPlan,
};
use crate::interp::fusion::Fused;
use crate::interp::kernels::{self, Unpack64, elementwise, fused};
use crate::interp::machine::{Handler, Instr};
use crate::interp::operand::Operand;
use crate::interp::{
    aborts, access, atomics, control, descriptors, images, matrix, memory, prints, subgroup,
    vector_product, yields,
};
use crate::ir::op::{Access, AtomicOp, MAX_TABLE_RESULTS, MatrixProduct, Signature, VectorProduct};
use crate::ir::stage::Stage;
use crate::ir::{Inst, Op, Space, Type, Value, VariableId};
use crate::plan::takes_helpers;
use crate::printf::Message;

impl Emitter<'_> {
    fn ty(&self, value: Value) -> Type {
        self.body_function().ty(value)
    }

    /// Emits the operation; its results' operands are known.
    pub(super) fn emit_operation(&mut self, inst: &Inst) -> Result<(), Error> {
        let d = match inst.results.first() {
            Some(&result) => self.operand(result),
            None => Operand::NONE,
        };
        let arg = |k: usize| match inst.args.get(k) {
            Some(&value) => self.operand(value),
            None => Operand::NONE,
        };
        let plain = |handler: Handler, x: u32| Instr {
            d,
            a: arg(0),
            b: arg(1),
            c: arg(2),
            x,
            ..instr(handler)
        };
        let emitted = match &inst.op {
            Op::VarLoad(variable, row) => {
                let ty = self.ty(inst.results[0]);
                let row = self.variable_access(*variable, *row, ty, inst)?;
                Instr {
                    y: (ty.rows() == 2) as u32,
                    ..plain(self.kernel::<memory::VariableLoad>(), row)
                }
            }
            Op::VarStore(variable, row) => {
                let ty = self.ty(inst.args[0]);
                let row = self.variable_access(*variable, *row, ty, inst)?;
                Instr {
                    y: (ty.rows() == 2) as u32,
                    ..plain(self.kernel::<memory::VariableStore>(), row)
                }
            }
            Op::Table(index) => {
                let load = plain(self.kernel::<memory::LoadTable>(), 0);
                Instr {
                    x: self.list(&inst.results),
                    b: Operand::number(inst.results.len() as u32),
                    y: self.table(*index),
                    ..load
                }
            }
            Op::Load(access) => return self.emit_access(*access, inst, false),
            Op::Store(access) => return self.emit_access(*access, inst, true),
            Op::Atomic(op, access) => return self.emit_atomic(*op, *access, inst),
            Op::BufferSize => Instr {
                y: (self.ty(inst.results[0]) == Type::I64) as u32,
                ..plain(descriptors::buffer_size, 0)
            },
            Op::DescriptorAddress => plain(descriptors::descriptor_address, 0),
            Op::Descriptor(binding) => {
                let i = plain(descriptors::descriptor, self.code.bindings.len() as u32);
                self.code.bindings.push(*binding);
                i
            }
            Op::DescriptorReference(binding) => {
                let i = plain(
                    descriptors::descriptor_reference,
                    self.code.bindings.len() as u32,
                );
                self.code.bindings.push(*binding);
                i
            }
            Op::DescriptorAt => plain(descriptors::descriptor_at, 0),
            Op::PushConstants => plain(descriptors::push_constants, 0),
            Op::Input(row) => {
                if *row as usize >= self.module.inputs.len() {
                    return Err(Error::invalid(inst.source, "input row out of range"));
                }
                plain(self.kernel::<yields::Input>(), *row)
            }
            Op::Uniform(word) => plain(memory::uniform, *word),
            Op::Image(_) => return self.emit_image(inst),
            Op::Subgroup(op) => {
                let ty = inst.args.first().map_or(Type::I32, |&v| self.ty(v));
                let plan = SubgroupPlan {
                    op: *op,
                    with_helpers: takes_helpers(self.module, *op),
                };
                let handler = subgroup::handler(self.tier, *op, ty);
                let i = plain(handler, self.code.subgroups.len() as u32);
                self.code.subgroups.push(plan);
                i
            }
            Op::MatrixProduct(product) => {
                self.emit_product(*product, inst);
                return Ok(());
            }
            Op::VectorProduct(product, space) => {
                self.emit_vector_product(*product, *space, inst);
                return Ok(());
            }
            Op::DerivativeX | Op::DerivativeY => {
                let ty = self.ty(inst.results[0]);
                plain(kernels::derivative(self.tier, &inst.op, ty), 0)
            }
            Op::LaneIndex => plain(memory::lane_index, 0),
            Op::Emit => {
                let emit = plain(
                    self.kernel::<memory::Emit>(),
                    self.code.operands.len() as u32,
                );
                self.list(&inst.args);
                Instr {
                    y: inst.args.len() as u32,
                    ..emit
                }
            }
            Op::AbortMessage => plain(aborts::abort_message, 0),
            Op::Abort => plain(aborts::abort, inst.source),
            Op::Demote => plain(control::demote, 0),
            Op::IsHelper => plain(control::is_helper, 0),
            Op::DebugPrintf(table) => return self.emit_print(*table, inst),
            Op::ReadClock => plain(memory::read_clock, 0),
            Op::MemoryBarrier => plain(memory::memory_barrier, 0),
            Op::Unpack64 => Instr {
                b: self.operand(inst.results[1]),
                ..plain(self.portable::<Unpack64>(), 0)
            },
            op => {
                let from = self.ty(inst.args[0]);
                let to = self.ty(inst.results[0]);
                let kernel = |op: &Op, from, to| {
                    let name = op.text();
                    elementwise(self.tier, op, from, to).ok_or_else(|| {
                        Error::unsupported(inst.source, format!("{name} from {from} to {to}"))
                    })
                };
                if to == Type::F16 && op.signature() == Signature::FloatFunction {
                    // The row of the result holds the f32s in between.
                    let steps = [
                        (kernel(&Op::FConvert, Type::F16, Type::F32)?, arg(0)),
                        (kernel(op, Type::F32, Type::F32)?, d),
                        (kernel(&Op::FConvert, Type::F32, Type::F16)?, d),
                    ];
                    for (handler, a) in steps {
                        self.push(Instr {
                            d,
                            a,
                            ..instr(handler)
                        });
                    }
                    return Ok(());
                }
                let handler = kernel(op, from, to)?;
                let x = self.code.operands.len() as u32;
                let i = plain(handler, x);
                if inst.args.len() == 4 {
                    let fourth = arg(3);
                    self.code.operands.push(fourth);
                }
                i
            }
        };
        self.push(emitted);
        Ok(())
    }

    /// The instruction that performs two.
    pub(super) fn fused(&self, inst: &Inst, pair: &Fused) -> Instr {
        let operand = |value: Option<Value>| value.map_or(Operand::NONE, |v| self.operand(v));
        let [a, b, c] = pair.operands.map(operand);
        let kernel = fused(self.tier, &pair.first, &inst.op, pair.side, pair.ty);
        Instr {
            d: self.operand(inst.results[0]),
            a,
            b,
            c,
            ..instr(kernel.expect("found by `Fusion`"))
        }
    }

    /// The number of one of the function's tables.
    fn table(&mut self, index: u32) -> u32 {
        let next = self.code.tables.len() as u32;
        let number = *self.tables.entry((self.function, index)).or_insert(next);
        if number == next {
            let mut words = self.body_function().tables[index as usize].clone();
            words.resize(words.len() + MAX_TABLE_RESULTS, 0);
            self.code.tables.push(words);
        }
        number
    }

    /// First private row of a variable of function `f`.
    pub(super) fn variable_row(
        &self,
        f: usize,
        variable: VariableId,
        source: u32,
    ) -> Result<usize, Error> {
        (self.planned.function(f).variables)
            .get(variable.index())
            .copied()
            .ok_or_else(|| Error::invalid(source, "no such variable"))
    }

    pub(super) fn variable_access(
        &self,
        variable: VariableId,
        row: u32,
        ty: Type,
        inst: &Inst,
    ) -> Result<u32, Error> {
        let first = self.variable_row(self.function, variable, inst.source)? as u32;
        let rows = self.body_function().variables[variable.index()].rows;
        if row.checked_add(ty.rows()).is_none_or(|end| end > rows) {
            return Err(Error::invalid(inst.source, "row outside the variable"));
        }
        Ok(first + row)
    }

    fn emit_access(&mut self, place: Access, inst: &Inst, store: bool) -> Result<(), Error> {
        let (address, values) = inst.args.split_at(place.place_operands());
        let scalars = if store { values } else { &inst.results[..] };
        let Some(&first) = scalars.first() else {
            return Ok(());
        };
        let ty = self.ty(first);
        if ty == Type::I1 && place.space != Space::Private {
            return Err(Error::invalid(inst.source, "boolean in memory"));
        }
        let (address, stride) = address.split_at(place.space.address_operands());
        let stride = stride.first().map_or(Operand::NONE, |&v| self.operand(v));
        let operands = self.list(address);
        self.list(scalars);
        let plan = self.code.accesses.len() as u32;
        self.code.accesses.push(AccessPlan {
            space: place.space,
            ty,
            alignment: place.alignment,
            stride,
            operands,
            scalars: scalars.len() as u32,
        });
        let handler: Handler = match (place.space, store) {
            (Space::Private, store) => memory::private(self.tier, ty, store),
            _ if place.is_strided => access::strided(self.tier, ty, store),
            (_, store) => access::handler(self.tier, ty, scalars.len(), store),
        };
        self.push(Instr {
            x: plan,
            ..instr(handler)
        });
        self.note_physical(place.space, inst, store);
        Ok(())
    }

    /// Notes the access that was emitted last, for reports of where it led.
    fn note_physical(&mut self, space: Space, inst: &Inst, writes: bool) {
        if space == Space::Global {
            self.code.physical.push(PhysicalAccess {
                pc: self.code.instrs.len() as u32,
                source: inst.source,
                writes,
            });
        }
    }

    fn emit_atomic(&mut self, op: AtomicOp, access: Access, inst: &Inst) -> Result<(), Error> {
        let address = access.space.address_operands();
        let ty = match inst.results.first() {
            Some(&result) => self.ty(result),
            None => self.ty(inst.args[address]),
        };
        let handler = match access.space {
            Space::Private => None,
            _ => atomics::handler(op, ty),
        };
        let handler = handler.ok_or_else(|| {
            Error::unsupported(inst.source, format!("atomic on {ty} in this memory"))
        })?;
        let operands = self.list(&inst.args);
        // An unused result still needs a row.
        let d = match inst.results.first() {
            Some(&result) => self.operand(result),
            None => self.placed().scratch,
        };
        let is_used = inst.results.first().is_some_and(|result| {
            let range = self.placed().ranges[result.index()];
            range.is_none_or(|(start, end)| start < end)
        });
        let plan = self.code.atomics.len() as u32;
        self.code.atomics.push(AtomicPlan {
            op,
            space: access.space,
            operands,
        });
        self.push(Instr {
            x: plan,
            y: is_used as u32,
            d,
            ..instr(handler)
        });
        self.note_physical(access.space, inst, true);
        Ok(())
    }

    fn emit_product(&mut self, product: MatrixProduct, inst: &Inst) {
        let operands = self.list(&inst.args);
        self.list(&inst.results);
        let plan = self.code.products.len() as u32;
        self.code.products.push(ProductPlan { product, operands });
        self.push(Instr {
            x: plan,
            ..instr(matrix::handler(self.tier))
        });
    }

    fn emit_vector_product(&mut self, product: VectorProduct, space: Space, inst: &Inst) {
        let operands = self.list(&inst.args);
        self.list(&inst.results);
        let rows = inst.results.len();
        let added = if product.adds { rows } else { 0 };
        let plan = self.code.vector_products.len() as u32;
        self.code.vector_products.push(VectorPlan {
            product,
            space,
            operands,
            rows: rows as u32,
            columns: (inst.args.len() - space.address_operands() - 1 - added) as u32,
        });
        self.push(Instr {
            x: plan,
            ..instr(vector_product::handler(self.tier))
        });
        self.note_physical(space, inst, false);
    }

    fn emit_print(&mut self, table: u32, inst: &Inst) -> Result<(), Error> {
        let words = self.body_function().tables.get(table as usize);
        let message = words.and_then(|words| Message::from_table(words));
        let message = message.ok_or_else(|| Error::invalid(inst.source, "no such message"))?;
        let operands = self.list(&inst.args) as usize;
        let site = self.code.prints.len() as u32;
        self.code.prints.push(PrintPlan {
            message,
            source: inst.source,
            rank: (self.module.stage == Stage::Fragment) as u32,
            key_words: self.module.stage.key().len(),
            operands,
            count: inst.args.len(),
        });
        self.push(Instr {
            x: site,
            ..instr(prints::debug_printf)
        });
        Ok(())
    }

    fn emit_image(&mut self, inst: &Inst) -> Result<(), Error> {
        let Op::Image(op) = inst.op else {
            return Ok(());
        };
        let descriptors = 1 + op.has_sampler() as usize;
        let typed = |values: &[Value]| -> Vec<(Operand, bool)> {
            values
                .iter()
                .map(|&v| (self.operand(v), self.ty(v).rows() == 2))
                .collect()
        };
        let rows = |list: &[(Operand, bool)]| -> usize {
            list.iter().map(|&(_, wide)| 1 + wide as usize).sum()
        };
        let mut arguments = inst.args[descriptors.min(inst.args.len())..].to_vec();
        let derives = self.placed().fusion.derives(inst);
        if derives {
            let (spatial, from) = (op.spatial_count(), op.rows_before_lod());
            for k in 0..2 * spatial {
                arguments[from + k] = arguments[k % spatial];
            }
        }
        let operands = typed(&arguments);
        let results = typed(&inst.results);
        let matches = rows(&operands) == op.operand_rows() && rows(&results) <= op.result_rows();
        if !matches || !images::fits(op.operand_rows(), op.result_rows()) {
            return Err(Error::invalid(
                inst.source,
                "operands of an image operation",
            ));
        }
        let plan = ImagePlan {
            op,
            image: self.operand(inst.args[0]),
            sampler: match op.has_sampler() {
                true => self.operand(inst.args[1]),
                false => Operand::NONE,
            },
            derives,
            operands,
            results,
            wanted: (inst.results.iter().enumerate())
                .filter(|(_, value)| self.placed().slots.used[value.index()])
                .fold(0, |wanted, (k, _)| wanted | 1 << k),
        };
        self.push(Instr {
            x: self.code.images.len() as u32,
            ..instr(images::handler(self.tier, &op))
        });
        self.code.images.push(plan);
        Ok(())
    }
}
