//! The structures that rays of a command name: facts, and a file of their contents.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use traversal::{BuildFlags, Kind, Live, Structure, StructureFacts};

use super::gltf::GltfScene;

/// A top level with its bottom levels.
pub struct DescribedStructure {
    pub facts: Value,
    /// glTF.
    pub file: Vec<u8>,
}

/// A bottom level, and how many active instances name it.
struct BottomLevel {
    structure: Structure,
    facts: StructureFacts,
    instances: u64,
}

/// Describes the top level at an address; `None` where there is none.
///
/// # Safety
/// The structures that lie in `live` are not changed meanwhile.
pub unsafe fn describe(address: u64, live: &Live) -> Option<DescribedStructure> {
    // SAFETY: the caller's promise, here and below.
    let (top, facts) = unsafe { Structure::described(address, live) }?;
    if !top.kind().is_top() {
        return None;
    }
    let mut bottoms: BTreeMap<u64, Option<BottomLevel>> = BTreeMap::new();
    let (mut scene, mut active) = (GltfScene::default(), 0u64);
    for instance in top.instances() {
        active += 1;
        let bottom = bottoms.entry(instance.reference).or_insert_with(|| {
            // SAFETY: as above.
            let found = unsafe { Structure::described(instance.reference, live) };
            let (structure, facts) = found.filter(|(found, _)| !found.kind().is_top())?;
            Some(BottomLevel {
                structure,
                facts,
                instances: 0,
            })
        });
        if let Some(bottom) = bottom {
            bottom.instances += 1;
            scene.add(&instance, || bottom.structure.contents());
        }
    }
    let bottom_levels = bottoms.iter().filter_map(|(address, bottom)| {
        let bottom = bottom.as_ref()?;
        let mut object = to_json(*address, &bottom.structure, &bottom.facts);
        object["instances"] = bottom.instances.into();
        Some(object)
    });
    let mut facts = to_json(address, &top, &facts);
    facts["bottom_levels"] = bottom_levels.collect();
    facts["active_instances"] = active.into();
    facts["left_out_of_file"] = scene.left_out.into();
    Some(DescribedStructure {
        facts,
        file: scene.finish(),
    })
}

fn to_json(address: u64, structure: &Structure, facts: &StructureFacts) -> Value {
    let kind = match structure.kind() {
        Kind::Triangles => "triangles",
        Kind::Aabbs => "boxes",
        Kind::Swept => "round primitives",
        Kind::Motion => "moving triangles",
        Kind::Instances => "instances",
        Kind::MotionInstances => "moving instances",
    };
    json!({
        "address": format!("{address:#x}"),
        "kind": kind,
        "primitives": facts.primitive_count,
        "geometries": facts.geometry_count,
        "bytes": facts.size_bytes,
        "nodes": facts.node_count,
        "depth": facts.depth,
        "bounds": facts.bounds,
        "flags": flags(facts.flags),
    })
}

/// Vulkan's names of build flags, without `VK_BUILD_ACCELERATION_STRUCTURE_` and `_BIT_KHR`.
const FLAGS: [(u32, &str); 6] = [
    (BuildFlags::ALLOW_UPDATE, "ALLOW_UPDATE"),
    (BuildFlags::ALLOW_COMPACTION, "ALLOW_COMPACTION"),
    (BuildFlags::PREFER_FAST_TRACE, "PREFER_FAST_TRACE"),
    (BuildFlags::PREFER_FAST_BUILD, "PREFER_FAST_BUILD"),
    (BuildFlags::LOW_MEMORY, "LOW_MEMORY"),
    (BuildFlags::ALLOW_DATA_ACCESS, "ALLOW_DATA_ACCESS"),
];

fn flags(flags: BuildFlags) -> Vec<&'static str> {
    let set = FLAGS.iter().filter(|(bit, _)| flags.0 & bit != 0);
    set.map(|(_, name)| *name).collect()
}
