//! The structures that rays of a command name: facts, and files of their contents and boxes.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use parking_lot::Mutex;
use serde_json::{Value, json};
use traversal::{BoxLevel, BuildFlags, Kind, Live, Structure, StructureFacts};
use xxhash_rust::xxh3::xxh3_64;

use super::gltf::GltfScene;
use super::npy;
use crate::settings::settings;

/// Boxes of a level that are written, at most.
const MAX_BOXES: usize = 1024;
/// Bottom levels of a top level whose boxes are written, at most: the largest ones.
const MAX_BOXED: usize = 16;

/// The last build at each address.
static BUILDS: Mutex<BTreeMap<u64, StructureBuild>> = Mutex::new(BTreeMap::new());

/// A build or an update of a structure.
#[derive(Clone, Copy)]
struct StructureBuild {
    nanoseconds: u64,
    is_update: bool,
}

/// When a build begins, where captures tell its time.
pub fn start_build() -> Option<Instant> {
    let captured = settings().capture.as_ref();
    captured
        .filter(|it| it.folder.is_some())
        .map(|_| Instant::now())
}

/// A build at an address is complete.
pub fn note_build(address: u64, is_update: bool, started: Option<Instant>) {
    if let Some(started) = started {
        let build = StructureBuild {
            nanoseconds: u64::try_from(started.elapsed().as_nanos()).unwrap_or(u64::MAX),
            is_update,
        };
        BUILDS.lock().insert(address, build);
    }
}

/// A structure is what another one is: by a copy, or not by a build that is known (`None`).
pub fn note_copy(source: Option<u64>, destination: u64) {
    if start_build().is_some() {
        let builds = &mut *BUILDS.lock();
        match source.and_then(|source| builds.get(&source).copied()) {
            Some(build) => builds.insert(destination, build),
            None => builds.remove(&destination),
        };
    }
}

/// A top level with its bottom levels.
pub struct DescribedStructure {
    pub facts: Value,
    /// Files that are not written yet, by name.
    pub files: Vec<(String, Vec<u8>)>,
}

/// The structures of earlier commands.
#[derive(Default)]
pub struct KnownStructures {
    /// By address of the top level.
    structures: BTreeMap<u64, KnownStructure>,
    /// Names of files.
    files: BTreeSet<String>,
}

/// A top level as it was described.
struct KnownStructure {
    /// Addresses of it and of its bottom levels, with hashes of their bytes.
    parts: Vec<(u64, u64)>,
    facts: Value,
}

impl KnownStructures {
    /// Describes the top level at an address; `None` where there is none. One that has not changed
    /// has the same facts and files.
    ///
    /// # Safety
    /// The structures that lie in `live` are not changed meanwhile.
    pub unsafe fn describe(&mut self, address: u64, live: &Live) -> Option<DescribedStructure> {
        // SAFETY: the caller keeps the structures in `live` unchanged meanwhile.
        let is_same =
            |&(address, hash): &(u64, u64)| unsafe { hash_of(address, live) == Some(hash) };
        let known = self.structures.get(&address);
        let known = known.filter(|known| known.parts.iter().all(is_same));
        let (mut facts, files) = match known {
            Some(known) => (known.facts.clone(), Vec::new()),
            None => {
                // SAFETY: the caller keeps the structures in `live` unchanged meanwhile.
                let (facts, parts, mut files) = unsafe { describe(address, live) }?;
                files.retain(|(name, _)| self.files.insert(name.clone()));
                let known = KnownStructure {
                    parts,
                    facts: facts.clone(),
                };
                self.structures.insert(address, known);
                (facts, files)
            }
        };
        let builds = BUILDS.lock();
        add_build(&mut facts, &builds, address);
        let bottoms = facts["bottom_levels"].as_array_mut();
        for bottom in bottoms.into_iter().flatten() {
            let text = bottom["address"]
                .as_str()
                .and_then(|text| text.strip_prefix("0x"));
            if let Some(Ok(address)) = text.map(|text| u64::from_str_radix(text, 16)) {
                add_build(bottom, &builds, address);
            }
        }
        Some(DescribedStructure { facts, files })
    }
}

/// Adds the last build at an address to the facts of a structure.
fn add_build(facts: &mut Value, builds: &BTreeMap<u64, StructureBuild>, address: u64) {
    let build = builds.get(&address);
    facts["build_nanoseconds"] = build.map(|build| build.nanoseconds).into();
    facts["is_update"] = build.map(|build| build.is_update).into();
}

/// A hash of the bytes of the structure at an address.
///
/// # Safety
/// The structures that lie in `live` are not changed meanwhile.
unsafe fn hash_of(address: u64, live: &Live) -> Option<u64> {
    // SAFETY: the caller guarantees that structures in `live` do not change; one that is found ends
    // there.
    let bytes = unsafe {
        let size_bytes = Structure::at(address, live)?.size_bytes();
        std::slice::from_raw_parts(address as *const u8, size_bytes as usize)
    };
    Some(xxh3_64(bytes))
}

/// A bottom level, and how many active instances name it.
struct BottomLevel {
    structure: Structure,
    facts: StructureFacts,
    instances: u64,
}

/// Facts, hashes by address, and files by name.
type Description = (Value, Vec<(u64, u64)>, Vec<(String, Vec<u8>)>);

/// Describes the top level at an address; `None` where there is none.
///
/// # Safety
/// The structures that lie in `live` are not changed meanwhile.
unsafe fn describe(address: u64, live: &Live) -> Option<Description> {
    // SAFETY: the caller keeps the structures in `live` unchanged meanwhile.
    let (top, facts) = unsafe { Structure::described(address, live) }?;
    if !top.kind().is_top() {
        return None;
    }
    let mut bottoms: BTreeMap<u64, Option<BottomLevel>> = BTreeMap::new();
    let (mut scene, mut active) = (GltfScene::default(), 0u64);
    for instance in top.instances() {
        active += 1;
        let bottom = bottoms.entry(instance.reference).or_insert_with(|| {
            // SAFETY: the caller keeps the structures in `live` unchanged meanwhile.
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
    let known = bottoms.values().flatten();
    let mut sizes: Vec<u64> = known.map(|bottom| bottom.facts.size_bytes).collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    let least = sizes.get(MAX_BOXED).map_or(0, |&bytes| bytes + 1);
    let mut files = Vec::new();
    let bottom_levels = bottoms.iter().filter_map(|(address, bottom)| {
        let bottom = bottom.as_ref()?;
        let mut object = to_json(*address, &bottom.structure, &bottom.facts);
        object["instances"] = bottom.instances.into();
        if bottom.facts.size_bytes >= least {
            add_boxes(&mut object, &bottom.structure, &mut files);
        }
        Some(object)
    });
    let bottom_levels: Value = bottom_levels.collect();
    let mut facts = to_json(address, &top, &facts);
    facts["bottom_levels"] = bottom_levels;
    facts["active_instances"] = active.into();
    facts["left_out_of_file"] = scene.left_out.into();
    add_boxes(&mut facts, &top, &mut files);
    let scene = scene.finish();
    let name = format!("structure-{:016x}.glb", xxh3_64(&scene));
    facts["file"] = name.as_str().into();
    files.push((name, scene));
    let addresses = std::iter::once(address).chain(bottoms.keys().copied());
    // SAFETY: the caller keeps the structures in `live` unchanged meanwhile.
    let parts = addresses.filter_map(|address| Some((address, unsafe { hash_of(address, live) }?)));
    Some((facts, parts.collect(), files))
}

/// Adds the boxes of a structure's levels to its facts, and their file.
fn add_boxes(facts: &mut Value, structure: &Structure, files: &mut Vec<(String, Vec<u8>)>) {
    let levels = structure.box_levels(MAX_BOXES);
    let boxes = levels.iter().flat_map(|level| &level.boxes);
    let rows = boxes.map(|[least, most]| {
        let mut row = [0.0; 6];
        row[..3].copy_from_slice(least);
        row[3..].copy_from_slice(most);
        row
    });
    let kept: usize = levels.iter().map(|level| level.boxes.len()).sum();
    if kept == 0 {
        return;
    }
    let rows: Vec<[f32; 6]> = rows.collect();
    let mut file = Vec::new();
    npy::floats(&mut file, &[kept as u32], &rows);
    let name = format!("boxes-{:016x}.npy", xxh3_64(&file));
    let level = |level: &BoxLevel| json!({ "boxes": level.count, "kept": level.boxes.len() });
    facts["boxes"] = json!({
        "file": name,
        "levels": levels.iter().map(level).collect::<Vec<_>>(),
    });
    files.push((name, file));
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
