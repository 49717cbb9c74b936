//! Instructions that glslang does not write: a module is compiled, then rewritten with them.

use rspirv::spirv::{Capability, Op};
use shaders::compute::{Memory, compile, dispatch};
use shaders::glsl;
use spirv_jit::program::Stage;

/// The instructions of a module, words each, and its header.
fn instructions(words: &[u32]) -> (Vec<u32>, Vec<Vec<u32>>) {
    let mut rest = &words[5..];
    let mut out = Vec::new();
    while let Some(&first) = rest.first() {
        let (these, others) = rest.split_at((first >> 16) as usize);
        out.push(these.to_vec());
        rest = others;
    }
    (words[..5].to_vec(), out)
}

fn instruction(op: Op, operands: &[u32]) -> Vec<u32> {
    let mut words = vec![(operands.len() as u32 + 1) << 16 | op as u32];
    words.extend_from_slice(operands);
    words
}

fn is(instruction: &[u32], op: Op) -> bool {
    instruction[0] & 0xFFFF == op as u32
}

const SOURCE: &str = "layout(local_size_x = 16) in;
    layout(set = 0, binding = 0) buffer In { uint x[]; };
    layout(set = 0, binding = 1) buffer Out { uint r[]; };
    const vec4 quarters = vec4(0.25);
    const uint threes[5] = uint[5](3u, 3u, 3u, 3u, 3u);
    void main() {
        uint i = gl_GlobalInvocationID.x;
        uint a = x[i];
        uvec4 same = uvec4(a);
        vec4 q = quarters * float(a);
        r[i] = same.x + same.y + same.z + same.w + uint(q.x + q.y + q.z + q.w) + threes[a % 5u];
    }";

fn expect_results(words: &[u32]) {
    let program = compile(words);
    let mut memory = Memory::default();
    let inputs: Vec<u32> = (0..64).map(|i| i * 4).collect();
    memory.buffers = vec![(0, inputs.clone()), (16, vec![0; 64])];
    dispatch(&program, 4, &mut memory);
    let expected: Vec<u32> = inputs.iter().map(|x| 4 * x + x + 3).collect();
    assert_eq!(memory.buffers[1].1, expected);
}

#[test]
fn composites_of_one_constituent() {
    let words = glsl(Stage::Compute, SOURCE);
    let (mut module, list) = instructions(&words);
    module.extend(instruction(
        Op::Capability,
        &[Capability::ReplicatedCompositesEXT as u32],
    ));
    let mut replaced = 0;
    for words in list {
        let op = match words[0] & 0xFFFF {
            op if op == Op::ConstantComposite as u32 => Op::ConstantCompositeReplicateEXT,
            op if op == Op::CompositeConstruct as u32 => Op::CompositeConstructReplicateEXT,
            _ => {
                module.extend(words);
                continue;
            }
        };
        if words[3..].windows(2).all(|pair| pair[0] == pair[1]) {
            replaced += 1;
            module.extend(instruction(op, &words[1..4]));
        } else {
            module.extend(words);
        }
    }
    assert!(replaced >= 3, "{replaced} replaced");
    expect_results(&module);
}

#[test]
fn information_refers_to_what_comes_later() {
    let words = glsl(Stage::Compute, SOURCE);
    let (mut module, list) = instructions(&words);
    let bound = module[3];
    module[3] += 5;
    let void = list.iter().find(|words| is(words, Op::TypeVoid)).unwrap()[1];
    let name: Vec<u32> = b"NonSemantic.Test"
        .chunks(4)
        .map(|chunk| u32::from_le_bytes(chunk.try_into().unwrap()))
        .chain([0])
        .collect();
    let inform = |id, operands: &[u32]| {
        let words = [&[void, bound + id, bound, 7], operands].concat();
        instruction(Op::ExtInstWithForwardRefsKHR, &words)
    };
    let mut seen_function = false;
    for words in list {
        if is(&words, Op::MemoryModel) {
            module.extend(instruction(
                Op::ExtInstImport,
                &[&[bound], &name[..]].concat(),
            ));
        }
        if is(&words, Op::Function) && !seen_function {
            seen_function = true;
            // One refers to the other, which refers to the function.
            module.extend(inform(1, &[bound + 2]));
            module.extend(inform(2, &[words[2]]));
        }
        let is_return = is(&words, Op::Return);
        if is_return {
            module.extend(inform(3, &[bound + 4]));
            module.extend(inform(4, &[]));
        }
        module.extend(words);
    }
    expect_results(&module);
}

/// The null pointer is no variable's (`OpConstantNull`; "PhysicalStorageBuffer and logical
/// pointers" of the specification compare unequal).
#[test]
fn null_is_no_place_in_workgroup_memory() {
    use rspirv::binary::Assemble;
    use rspirv::spirv::{
        AddressingModel, Decoration, ExecutionMode, ExecutionModel, FunctionControl, MemoryModel,
        StorageClass,
    };
    let mut b = rspirv::dr::Builder::new();
    b.set_version(1, 4);
    b.capability(Capability::Shader);
    b.capability(Capability::VariablePointersStorageBuffer);
    b.capability(Capability::VariablePointers);
    b.memory_model(AddressingModel::Logical, MemoryModel::GLSL450);
    let (void, boolean, word) = (b.type_void(), b.type_bool(), b.type_int(32, 0));
    let [zero, one, two] = [0, 1, 2].map(|n| b.constant_bit32(word, n));
    let words = b.type_runtime_array(word);
    b.decorate(
        words,
        Decoration::ArrayStride,
        [rspirv::dr::Operand::LiteralBit32(4)],
    );
    let block = b.type_struct([words]);
    b.decorate(block, Decoration::Block, []);
    b.member_decorate(
        block,
        0,
        Decoration::Offset,
        [rspirv::dr::Operand::LiteralBit32(0)],
    );
    let block = b.type_pointer(None, StorageClass::StorageBuffer, block);
    let place = b.type_pointer(None, StorageClass::StorageBuffer, word);
    let shared = b.type_pointer(None, StorageClass::Workgroup, word);
    let buffer = b.variable(block, None, StorageClass::StorageBuffer, None);
    for (decoration, number) in [(Decoration::DescriptorSet, 0), (Decoration::Binding, 0)] {
        b.decorate(
            buffer,
            decoration,
            [rspirv::dr::Operand::LiteralBit32(number)],
        );
    }
    let variable = b.variable(shared, None, StorageClass::Workgroup, None);
    let null = b.constant_null(shared);
    let signature = b.type_function(void, []);
    let main = b
        .begin_function(void, None, FunctionControl::NONE, signature)
        .unwrap();
    b.begin_block(None).unwrap();
    let pairs = [(variable, null), (null, null), (variable, variable)];
    for (at, (x, y)) in pairs.into_iter().enumerate() {
        let index = [zero, one, two][at];
        let same = b.ptr_equal(boolean, None, x, y).unwrap();
        let result = b.select(word, None, same, one, two).unwrap();
        let to = b.access_chain(place, None, buffer, [zero, index]).unwrap();
        b.store(to, result, None, []).unwrap();
    }
    b.ret().unwrap();
    b.end_function().unwrap();
    b.entry_point(ExecutionModel::GLCompute, main, "main", [buffer, variable]);
    b.execution_mode(main, ExecutionMode::LocalSize, [1, 1, 1]);
    let program = compile(&b.module().assemble());
    let mut memory = Memory {
        buffers: vec![(0, vec![0; 3])],
        ..Default::default()
    };
    dispatch(&program, 1, &mut memory);
    assert_eq!(memory.buffers[0].1, [2, 1, 1]);
}
