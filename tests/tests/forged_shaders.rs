//! Shaders that make descriptors out of something else, and memory that their stage does not have.
//! The modules are invalid, so that these tests look only at Tuff, which promises an error or
//! zeros, and never an access to memory that the application did not bind.

use tuff_tests::*;

/// Opcodes (SPIR-V specification, section Instructions).
mod op {
    pub const UNDEF: u32 = 1;
    pub const FUNCTION: u32 = 54;
    pub const FUNCTION_PARAMETER: u32 = 55;
    pub const FUNCTION_END: u32 = 56;
    pub const FUNCTION_CALL: u32 = 57;
    pub const CONSTANT_NULL: u32 = 46;
    pub const VARIABLE: u32 = 59;
    pub const LOAD: u32 = 61;
    pub const STORE: u32 = 62;
    pub const COMPOSITE_CONSTRUCT: u32 = 80;
    pub const COMPOSITE_EXTRACT: u32 = 81;
    pub const COPY_OBJECT: u32 = 83;
    pub const BITCAST: u32 = 124;
    pub const I_ADD: u32 = 128;
    pub const SELECT: u32 = 169;
    pub const PHI: u32 = 245;
    pub const LABEL: u32 = 248;
    pub const BRANCH: u32 = 249;
    pub const RETURN_VALUE: u32 = 254;
    pub const COPY_LOGICAL: u32 = 400;
}

const FUNCTION_CLASS: u32 = 7;

/// A module as it grows: ids count up.
#[derive(Default)]
struct Assembly {
    ids: u32,
    head: Vec<u32>,
    decorations: Vec<u32>,
    types: Vec<u32>,
    code: Vec<u32>,
    /// Functions besides the entry.
    others: Vec<u32>,
}

fn push(list: &mut Vec<u32>, opcode: u32, operands: &[u32]) {
    list.push((operands.len() as u32 + 1) << 16 | opcode);
    list.extend_from_slice(operands);
}

impl Assembly {
    fn id(&mut self) -> u32 {
        self.ids += 1;
        self.ids
    }

    /// A type: its operands follow its id.
    fn ty(&mut self, opcode: u32, operands: &[u32]) -> u32 {
        let id = self.id();
        push(&mut self.types, opcode, &[&[id], operands].concat());
        id
    }

    /// A constant, or a variable of the module: type, id, operands.
    fn global(&mut self, opcode: u32, ty: u32, operands: &[u32]) -> u32 {
        let id = self.id();
        push(&mut self.types, opcode, &[&[ty, id], operands].concat());
        id
    }

    /// An instruction of the entry with a result.
    fn value(&mut self, opcode: u32, ty: u32, operands: &[u32]) -> u32 {
        let id = self.id();
        push(&mut self.code, opcode, &[&[ty, id], operands].concat());
        id
    }

    fn words(self) -> Vec<u32> {
        let header = vec![0x0723_0203, 0x0001_0500, 0, self.ids + 1, 0];
        let parts = [
            self.head,
            self.decorations,
            self.types,
            self.code,
            self.others,
        ];
        parts
            .into_iter()
            .fold(header, |words, part| [words, part].concat())
    }
}

/// The ids that a forgery may use.
struct Ids {
    /// The type that is to be forged.
    opaque: u32,
    wide: u32,
    pair: u32,
    bool: u32,
    uint: u32,
    /// A 64-bit number that is no address of a descriptor.
    number: u32,
    zero: u32,
    entry_label: u32,
}

/// The kind of look-up.
#[derive(Clone, Copy, PartialEq)]
enum Lookup {
    Fetch,
    Sample,
    /// Through a pointer into a buffer.
    Buffer,
}

/// A compute shader that looks something up in what `forge` makes, and stores it as the first four
/// words of the buffer at binding 0.
fn looking_up(lookup: Lookup, forge: impl FnOnce(&mut Assembly, &Ids) -> u32) -> Vec<u32> {
    let mut a = Assembly::default();
    let (main, buffer, block, array) = (a.id(), a.id(), a.id(), a.id());
    // Shader, Int64, VariablePointersStorageBuffer, VariablePointers; Logical, GLSL450; GLCompute
    // "main"; one invocation.
    for capability in [1, 11, 4441, 4442] {
        push(&mut a.head, 17, &[capability]);
    }
    push(&mut a.head, 14, &[0, 1]);
    push(
        &mut a.head,
        15,
        &[5, main, u32::from_le_bytes(*b"main"), 0, buffer],
    );
    push(&mut a.head, 16, &[main, 17, 1, 1, 1]);
    // Set and binding 0, Block, stride, offset.
    push(&mut a.decorations, 71, &[buffer, 34, 0]);
    push(&mut a.decorations, 71, &[buffer, 33, 0]);
    push(&mut a.decorations, 71, &[block, 2]);
    push(&mut a.decorations, 71, &[array, 6, 16]);
    push(&mut a.decorations, 72, &[block, 0, 35, 0]);
    let void = a.ty(19, &[]);
    let function = a.ty(33, &[void]);
    let float = a.ty(22, &[32]);
    let (uint, wide, bool) = (a.ty(21, &[32, 0]), a.ty(21, &[64, 0]), a.ty(20, &[]));
    let (vec2, vec4, uvec2) = (
        a.ty(23, &[float, 2]),
        a.ty(23, &[float, 4]),
        a.ty(23, &[uint, 2]),
    );
    // A two-dimensional image for sampling, of any format.
    let image = a.ty(25, &[float, 1, 0, 0, 0, 1, 0]);
    let sampled = a.ty(27, &[image]);
    push(&mut a.types, 29, &[array, vec4]);
    push(&mut a.types, 30, &[block, array]);
    let to_block = a.ty(32, &[12, block]);
    let to_vec4 = a.ty(32, &[12, vec4]);
    push(&mut a.types, op::VARIABLE, &[to_block, buffer, 12]);
    let (zero, zero_float) = (a.global(43, uint, &[0]), a.global(43, float, &[0]));
    let number = a.global(43, wide, &[0x4141_4000, 0x4141]);
    let texel = a.global(44, uvec2, &[zero, zero]);
    let point = a.global(44, vec2, &[zero_float, zero_float]);
    let pair = a.ty(30, &[wide, uint]);
    let entry_label = a.id();
    let ids = Ids {
        opaque: match lookup {
            Lookup::Fetch => image,
            Lookup::Sample => sampled,
            Lookup::Buffer => to_block,
        },
        wide,
        pair,
        bool,
        uint,
        number,
        zero,
        entry_label,
    };
    push(&mut a.code, op::FUNCTION, &[void, main, 0, function]);
    push(&mut a.code, op::LABEL, &[entry_label]);
    let forged = forge(&mut a, &ids);
    let found = match lookup {
        // Lod; Lod.
        Lookup::Fetch => a.value(95, vec4, &[forged, texel, 2, zero]),
        Lookup::Sample => a.value(88, vec4, &[forged, point, 2, zero_float]),
        Lookup::Buffer => {
            let at = a.value(65, to_vec4, &[forged, zero, zero]);
            a.value(op::LOAD, vec4, &[at])
        }
    };
    let to = a.value(65, to_vec4, &[buffer, zero, zero]);
    push(&mut a.code, op::STORE, &[to, found]);
    push(&mut a.code, 253, &[]);
    push(&mut a.code, op::FUNCTION_END, &[]);
    a.words()
}

/// The results of a shader, or none if it is refused.
fn run(gpu: &Gpu, words: &[u32]) -> Option<[u32; 4]> {
    let buffer = gpu.buffer_with(&[7u32; 16]);
    let set = gpu.set_of(&[buffer.into()]);
    let layout = gpu.layout(&[set.layout]);
    let none = vk::SpecializationInfo::default();
    let pipeline = match gpu.try_kernel(words, c"main", layout, &none) {
        Ok(pipeline) => pipeline,
        Err(error) => {
            assert_eq!(error, vk::Result::ERROR_UNKNOWN);
            return None;
        }
    };
    let kernel = Kernel { pipeline, layout };
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    let words = buffer.read::<u32>();
    assert_eq!(words[4..], [7; 12]);
    Some([words[0], words[1], words[2], words[3]])
}

/// Values that are no image, no sampler and no pointer are refused as such, whatever their origin.
#[test]
fn forged_descriptors_are_refused() {
    let Some(gpu) = Gpu::surviving() else { return };
    type Forge = fn(&mut Assembly, &Ids) -> u32;
    let ways: [(&str, Forge); 10] = [
        ("copy", |a, ids| {
            a.value(op::COPY_OBJECT, ids.opaque, &[ids.number])
        }),
        ("logical copy", |a, ids| {
            a.value(op::COPY_LOGICAL, ids.opaque, &[ids.number])
        }),
        ("logical copy of two", |a, ids| {
            let both = a.value(op::COMPOSITE_CONSTRUCT, ids.pair, &[ids.number, ids.zero]);
            a.value(op::COPY_LOGICAL, ids.opaque, &[both])
        }),
        ("bitcast", |a, ids| {
            a.value(op::BITCAST, ids.opaque, &[ids.number])
        }),
        ("sum", |a, ids| {
            a.value(op::I_ADD, ids.opaque, &[ids.number, ids.number])
        }),
        ("selection", |a, ids| {
            let yes = a.global(41, ids.bool, &[]);
            a.value(op::SELECT, ids.opaque, &[yes, ids.number, ids.number])
        }),
        ("part", |a, ids| {
            let both = a.value(op::COMPOSITE_CONSTRUCT, ids.pair, &[ids.number, ids.zero]);
            a.value(op::COMPOSITE_EXTRACT, ids.opaque, &[both, 0])
        }),
        ("variable", |a, ids| {
            let to = a.ty(32, &[FUNCTION_CLASS, ids.wide]);
            let variable = a.value(op::VARIABLE, to, &[FUNCTION_CLASS]);
            push(&mut a.code, op::STORE, &[variable, ids.number]);
            a.value(op::LOAD, ids.opaque, &[variable])
        }),
        ("phi", |a, ids| {
            let next = a.id();
            push(&mut a.code, op::BRANCH, &[next]);
            push(&mut a.code, op::LABEL, &[next]);
            a.value(op::PHI, ids.opaque, &[ids.number, ids.entry_label])
        }),
        ("argument", |a, ids| {
            let ty = a.ty(33, &[ids.opaque, ids.opaque]);
            let (function, parameter, label) = (a.id(), a.id(), a.id());
            let mut other = Vec::new();
            push(&mut other, op::FUNCTION, &[ids.opaque, function, 0, ty]);
            push(&mut other, op::FUNCTION_PARAMETER, &[ids.opaque, parameter]);
            push(&mut other, op::LABEL, &[label]);
            push(&mut other, op::RETURN_VALUE, &[parameter]);
            push(&mut other, op::FUNCTION_END, &[]);
            a.others = other;
            a.value(op::FUNCTION_CALL, ids.opaque, &[function, ids.number])
        }),
    ];
    for lookup in [Lookup::Fetch, Lookup::Sample, Lookup::Buffer] {
        for (name, forge) in ways {
            let found = run(&gpu, &looking_up(lookup, forge));
            assert!(found.is_none(), "by {name}: {found:?}");
        }
    }
    // And the device is as good as new.
    let null = looking_up(Lookup::Fetch, |a, ids| {
        a.global(op::CONSTANT_NULL, ids.opaque, &[])
    });
    assert_eq!(run(&gpu, &null), Some([0; 4]));
}

/// Where there is no image, there are zeros.
#[test]
fn undefined_images_give_zeros() {
    let Some(gpu) = Gpu::surviving() else { return };
    for lookup in [Lookup::Fetch, Lookup::Sample, Lookup::Buffer] {
        let undefined = looking_up(lookup, |a, ids| a.value(op::UNDEF, ids.opaque, &[]));
        assert_eq!(run(&gpu, &undefined), Some([0; 4]));
        let null = looking_up(lookup, |a, ids| {
            a.global(op::CONSTANT_NULL, ids.opaque, &[])
        });
        assert_eq!(run(&gpu, &null), Some([0; 4]));
        // A variable that nothing was stored to.
        let variable = looking_up(lookup, |a, ids| {
            let to = a.ty(32, &[FUNCTION_CLASS, ids.opaque]);
            let variable = a.value(op::VARIABLE, to, &[FUNCTION_CLASS]);
            a.value(op::LOAD, ids.opaque, &[variable])
        });
        assert_eq!(run(&gpu, &variable), Some([0; 4]));
    }
    // Variables of such a type hold what is no number: nothing can be stored there.
    let stored = looking_up(Lookup::Fetch, |a, ids| {
        let to = a.ty(32, &[FUNCTION_CLASS, ids.opaque]);
        let variable = a.value(op::VARIABLE, to, &[FUNCTION_CLASS]);
        push(&mut a.code, op::STORE, &[variable, ids.number]);
        a.value(op::LOAD, ids.opaque, &[variable])
    });
    assert_eq!(run(&gpu, &stored), None);
}

/// A pointer that is chosen, kept in a variable and given to a function still leads where it
/// should.
#[test]
fn pointers_to_buffers_are_values() {
    let Some(gpu) = Gpu::surviving() else { return };
    let kept = looking_up(Lookup::Buffer, |a, ids| {
        let buffer = 2;
        let yes = a.global(41, ids.bool, &[]);
        let null = a.global(op::CONSTANT_NULL, ids.opaque, &[]);
        let to = a.ty(32, &[FUNCTION_CLASS, ids.opaque]);
        let variable = a.value(op::VARIABLE, to, &[FUNCTION_CLASS]);
        let chosen = a.value(op::SELECT, ids.opaque, &[yes, buffer, null]);
        push(&mut a.code, op::STORE, &[variable, chosen]);
        a.value(op::LOAD, ids.opaque, &[variable])
    });
    assert_eq!(run(&gpu, &kept), Some([7; 4]));
    // A block's id is no pointer of another type.
    let other = looking_up(Lookup::Buffer, |a, ids| {
        a.value(op::COPY_OBJECT, ids.uint, &[2])
    });
    assert_eq!(run(&gpu, &other), None);
}

/// Rays have no workgroup, and so no memory that one shares.
#[test]
fn workgroup_memory_is_for_compute_shaders() {
    let Some(gpu) = Gpu::surviving() else { return };
    let mut a = Assembly::default();
    let (main, memory) = (a.id(), a.id());
    // RayTracingKHR, its extension, Logical, GLSL450; RayGenerationKHR "main".
    push(&mut a.head, 17, &[4479]);
    let mut name = b"SPV_KHR_ray_tracing\0".to_vec();
    name.resize(name.len().next_multiple_of(4), 0);
    let name: Vec<u32> = (name.chunks(4))
        .map(|four| u32::from_le_bytes(four.try_into().unwrap()))
        .collect();
    push(&mut a.head, 10, &name);
    push(&mut a.head, 14, &[0, 1]);
    push(
        &mut a.head,
        15,
        &[5313, main, u32::from_le_bytes(*b"main"), 0, memory],
    );
    let void = a.ty(19, &[]);
    let function = a.ty(33, &[void]);
    let uint = a.ty(21, &[32, 0]);
    let many = a.global(43, uint, &[1 << 20]);
    let far = a.global(43, uint, &[1000]);
    let array = a.ty(28, &[uint, many]);
    let (to_array, to_uint) = (a.ty(32, &[4, array]), a.ty(32, &[4, uint]));
    push(&mut a.types, op::VARIABLE, &[to_array, memory, 4]);
    let label = a.id();
    push(&mut a.code, op::FUNCTION, &[void, main, 0, function]);
    push(&mut a.code, op::LABEL, &[label]);
    let at = a.value(65, to_uint, &[memory, far]);
    push(&mut a.code, op::STORE, &[at, far]);
    push(&mut a.code, 253, &[]);
    push(&mut a.code, op::FUNCTION_END, &[]);
    let layout = gpu.layout(&[]);
    let shaders = [(Stage::RayGeneration, a.words())];
    let made = gpu.try_rays(&shaders, &[Group::general(0)], 1, layout);
    assert_eq!(made, Err(vk::Result::ERROR_UNKNOWN));
}
