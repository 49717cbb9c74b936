//! Descriptor heaps (`SPV_EXT_descriptor_heap`). The resource heap is set 0 of the environment: the
//! module's buffers are its descriptors 0 and 16.

use rspirv::spirv::{BuiltIn, Capability, Decoration, Op, StorageClass};
use shaders::compute::{Memory, compile, compile_as, dispatch};
use shaders::request;
use spirv_jit::descriptor_heap::{HeapPlace, HeapSource, Mapping, Source, Word, resource};
use spirv_jit::program::{CompileRequest, Stage};

use crate::assembler::Assembler;

/// A module with the resource heap.
struct Heap {
    a: Assembler,
    /// Untyped pointers into the heap, and to data of buffers.
    handle: u32,
    data: u32,
    heap: u32,
    /// A buffer's descriptor, and its size.
    buffer: u32,
    size: u32,
    /// A block of words.
    words: u32,
}

impl Heap {
    fn new() -> Self {
        let mut a = Assembler::new();
        a.capability(Capability::UntypedPointersKHR);
        a.capability(Capability::DescriptorHeapEXT);
        let handle = a.global(
            Op::TypeUntypedPointerKHR,
            &[StorageClass::UniformConstant as u32],
        );
        let class = StorageClass::StorageBuffer as u32;
        let data = a.global(Op::TypeUntypedPointerKHR, &[class]);
        let heap = a.value(
            handle,
            Op::UntypedVariableKHR,
            &[StorageClass::UniformConstant as u32],
        );
        a.decorate(
            heap,
            Decoration::BuiltIn,
            &[BuiltIn::ResourceHeapEXT as u32],
        );
        a.interface.push(heap);
        let buffer = a.global(Op::TypeBufferEXT, &[class]);
        let size = a.value(a.word, Op::ConstantSizeOfEXT, &[buffer]);
        let words = a.open_array(a.word, 4);
        let words = a.block(&[(words, 0)]);
        Self {
            a,
            handle,
            data,
            heap,
            buffer,
            size,
            words,
        }
    }

    /// The word of a buffer whose descriptor a pointer leads to.
    fn word(&mut self, descriptor: u32, index: usize) -> u32 {
        let block = (self.a).make(self.data, Op::BufferPointerEXT, &[descriptor]);
        let chain = [self.words, block, self.a.numbers[0], self.a.numbers[index]];
        let at = self.a.make(self.data, Op::UntypedAccessChainKHR, &chain);
        self.a.make(self.a.word, Op::Load, &[at])
    }
}

fn run(request: &CompileRequest<'_>, input: &[u32], push: &[u32]) -> u32 {
    let mut memory = Memory {
        buffers: vec![(0, input.to_vec()), (16, vec![0; 3]), (40, vec![70, 71])],
        push_constants: push.to_vec(),
        ..Memory::default()
    };
    dispatch(&compile_as(request), 1, &mut memory);
    memory.buffers[1].1[0]
}

#[test]
fn an_array_of_buffers_is_indexed() {
    let mut h = Heap::new();
    let array = h.a.global(Op::TypeRuntimeArray, &[h.buffer]);
    h.a.decorate_with_id(array, Decoration::ArrayStrideIdEXT, h.size);
    h.a.read();
    let chain = [array, h.heap, h.a.given];
    let descriptor = h.a.make(h.handle, Op::UntypedAccessChainKHR, &chain);
    let loaded = h.word(descriptor, 1);
    let module = h.a.finish(loaded);
    let request = request(Stage::Compute, &module);
    assert_eq!(run(&request, &[40, 5], &[]), 71);
    assert_eq!(run(&request, &[0, 5], &[]), 5);
    // The null descriptor, and entries past the end.
    for index in [41, 256, 1 << 26, u32::MAX] {
        assert_eq!(run(&request, &[index, 5], &[]), 0);
    }
}

#[test]
fn members_lie_where_constants_say() {
    let mut h = Heap::new();
    let members = h.a.global(Op::TypeStruct, &[h.buffer, h.buffer]);
    let far = h.a.number(40 * 32);
    for (member, offset) in [(0, h.a.numbers[0]), (1, far)] {
        let place = (members, member);
        h.a.decorate_member_with_id(place, Decoration::OffsetIdEXT, offset);
    }
    let chain = [members, h.heap, h.a.numbers[1]];
    let descriptor = h.a.make(h.handle, Op::UntypedAccessChainKHR, &chain);
    let loaded = h.word(descriptor, 0);
    assert_eq!(
        run(&request(Stage::Compute, &h.a.finish(loaded)), &[], &[]),
        70
    );
}

#[test]
fn the_size_of_a_descriptor_is_a_constant() {
    let h = Heap::new();
    let size = h.size;
    let program = compile(&h.a.finish(size));
    let mut memory = Memory {
        buffers: vec![(16, vec![0])],
        ..Memory::default()
    };
    dispatch(&program, 1, &mut memory);
    assert_eq!(memory.buffers[0].1, [32]);
}

/// The module's input, mapped.
fn mapped(source: Source, input: &[u32], push: &[u32]) -> u32 {
    let mut a = Assembler::new();
    a.read();
    let given = a.given;
    let words = a.finish(given);
    let mappings = [Mapping {
        set: 0,
        first_binding: 0,
        binding_count: 1,
        resources: resource::READ_WRITE_STORAGE_BUFFER,
        source,
    }];
    let request = CompileRequest {
        mappings: &mappings,
        ..request(Stage::Compute, &words)
    };
    run(&request, input, push)
}

#[test]
fn bindings_are_mapped_onto_heaps_and_data() {
    let place = |first, index_stride_bytes, index| {
        Source::Heap(Box::new(HeapSource {
            place: HeapPlace {
                first,
                index_stride_bytes,
                index,
                ..HeapPlace::default()
            },
            sampler: HeapPlace::default(),
            is_packed: false,
            embedded: None,
        }))
    };
    assert_eq!(mapped(place(40, 0, None), &[5], &[]), 70);
    let index = Some(Word::Push(4));
    assert_eq!(mapped(place(30, 64, index), &[5], &[0, 5]), 70);
    // An index that counts bytes.
    assert_eq!(mapped(place(30, 1, index), &[5], &[0, 320]), 70);
    assert_eq!(mapped(Source::Data(Word::Push(8)), &[5], &[0, 1, 2]), 2);
    let far = [9u32, 8];
    let address = far.as_ptr() as u64;
    let push = [0, 0, address as u32, (address >> 32) as u32];
    assert_eq!(mapped(Source::Address(Word::Push(8)), &[5], &push), 9);
    // An index, and an address, in memory behind an address.
    let table = [0u32, 40, address as u32, (address >> 32) as u32];
    let at = table.as_ptr() as u64;
    let push = [at as u32, (at >> 32) as u32];
    let word = |offset| Word::Indirect { push: 0, offset };
    assert_eq!(mapped(place(0, 32, Some(word(4))), &[5], &push), 70);
    assert_eq!(mapped(Source::Address(word(8)), &[5], &push), 9);
}
