//! Sets the size of unused workgroup memory to 0. Shaders declare more than they use, and a
//! workgroup with memory cannot share a subgroup with others. Other stages keep their memory, since
//! the rasterizer reads the outputs of task and mesh shaders from it.

#![forbid(unsafe_code)]

use crate::ir::stage::Stage;
use crate::ir::{Module, Op, Space};

/// Removes workgroup memory without accesses.
pub fn trim_workgroup_memory(module: &mut Module) {
    if module.stage != Stage::Compute {
        return;
    }
    let mut is_accessed = false;
    for function in &module.functions {
        function.body.visit_insts(&mut |inst| {
            if let Op::Load(access) | Op::Store(access) | Op::Atomic(_, access) = inst.op {
                is_accessed |= access.space == Space::Shared;
            }
        });
    }
    if !is_accessed {
        module.shared_size_bytes = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::text::parse_module;

    #[test]
    fn only_memory_without_accesses_goes() {
        let accesses = [
            ("", 0),
            ("v2: i32 = load.buffer v1, v0", 0),
            ("v2: i32 = load.shared v0", 64),
            ("store.shared v0, v0", 64),
            ("v2: i32 = atomic.iadd.shared v0, v0", 64),
        ];
        for (access, size_bytes) in accesses {
            let text = format!(
                "module compute
                shared 64
                func f0 {{
                    v0: i32 = const 0
                    v1: descriptor = descriptor[set 0, first 0, count 1] v0
                    {access}
                    end
                }}"
            );
            let mut module = parse_module(&text).expect(access);
            trim_workgroup_memory(&mut module);
            assert_eq!(module.shared_size_bytes, size_bytes, "{access}");
        }
    }
}
