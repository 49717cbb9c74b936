//! Barriers in two halves (`SPV_EXT_split_barrier`).

use rspirv::spirv::{BuiltIn, Capability, Decoration, Op, StorageClass};
use shaders::compute::compile;
use shaders::{lower, request};
use spirv_jit::ir;
use spirv_jit::program::{SiteKind, Stage};

use crate::assembler::Assembler;

const WORKGROUP: u32 = 2;
const SUBGROUP: u32 = 3;
const RELEASE: u32 = 0x104;
const ACQUIRE: u32 = 0x102;

/// A module of 48 invocations: both halves in the given scope, with an atomic between them.
fn halves(scope: u32) -> Vec<u32> {
    let mut a = Assembler::new();
    a.capability(Capability::SplitBarrierINTEL);
    a.invocations = 48;
    let scope = a.number(scope);
    let (release, acquire) = (a.number(RELEASE), a.number(ACQUIRE));
    let memory = a.number(WORKGROUP);
    let input = StorageClass::Input;
    let pointer = a.pointer(input, a.word);
    let index = a.value(pointer, Op::Variable, &[input as u32]);
    a.decorate(
        index,
        Decoration::BuiltIn,
        &[BuiltIn::LocalInvocationIndex as u32],
    );
    a.interface.push(index);
    a.act(Op::ControlBarrierArriveINTEL, &[scope, memory, release]);
    let index = a.make(a.word, Op::Load, &[index]);
    a.act(Op::ControlBarrierWaitINTEL, &[scope, memory, acquire]);
    a.finish(index)
}

#[test]
fn halves_of_workgroups_are_events() {
    let program = compile(&halves(WORKGROUP));
    let sites = program.sites();
    assert!(sites.contains(&SiteKind::BarrierArrive), "{sites:?}");
    assert!(sites.contains(&SiteKind::BarrierWait), "{sites:?}");
}

/// The lanes of a subgroup are together already; memory is ordered all the same.
#[test]
fn halves_of_subgroups_order_memory_alone() {
    let words = halves(SUBGROUP);
    assert!(compile(&words).sites().is_empty());
    let module = lower(&request(Stage::Compute, &words)).unwrap();
    let mut barriers = 0;
    module.functions[0].body.visit_insts(&mut |inst| {
        barriers += u32::from(inst.op == ir::Op::MemoryBarrier);
    });
    assert_eq!(barriers, 2);
}

#[test]
fn halves_ask_for_their_capability() {
    let words = halves(WORKGROUP);
    let mut request = request(Stage::Compute, &words);
    request.capabilities = &[Capability::Shader];
    assert!(spirv_jit::compile(&request).is_err());
}
