//! Reads captures.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

/// Maps of the way that was taken: the other counts are those of each ray by itself.
const OF_THE_RUN: [&str; 3] = ["any_hit_shaders", "intersection_shaders", "nanoseconds"];

/// A captured command: its entry in the list, and its maps by name.
pub struct Captured {
    pub entry: Value,
    /// JSON of the structures' files.
    pub scenes: Vec<Value>,
    pub maps: BTreeMap<String, Vec<u32>>,
    pub first_rays: Vec<f32>,
    /// Of its first top level, and of the bottom levels of that.
    pub boxes: Vec<Vec<f32>>,
}

impl Captured {
    pub fn map(&self, name: &str) -> &[u32] {
        &self.maps[name]
    }

    /// The maps that every machine has alike.
    pub fn alone(&self) -> BTreeMap<&str, &[u32]> {
        let maps = (self.maps.iter()).map(|(name, map)| (name.as_str(), map.as_slice()));
        maps.filter(|(name, _)| !OF_THE_RUN.contains(name))
            .collect()
    }
}

/// Reads a capture, and holds its files against its list.
pub fn read(folder: &Path) -> Vec<Captured> {
    let json = std::fs::read_to_string(folder.join("maps.json")).expect("maps.json");
    let mut all: Vec<Value> = serde_json::from_str(&json).expect("an array in JSON");
    assert_eq!(all.remove(0)["version"], 1);
    let commands = all.into_iter().filter(|entry| entry["maps"].is_array());
    let commands = commands.map(|entry| {
        let sizes: Vec<u64> = serde_json::from_value(entry["size"].clone()).expect("three sizes");
        let count = sizes.iter().product::<u64>() as usize;
        let maps = entry["maps"].as_array().expect("a list").iter().map(|map| {
            let numbers = match map["file"].as_str() {
                None => vec![0; count],
                Some(file) => {
                    let bytes = std::fs::read(folder.join(file)).expect("a map's file");
                    numbers(&bytes, map["type"].as_str().expect("a type"), &sizes)
                }
            };
            assert_eq!(numbers.len(), count);
            assert_eq!(map["most"], json!(numbers.iter().max()), "{map}");
            let sum: u64 = numbers.iter().map(|&number| u64::from(number)).sum();
            assert_eq!(map["sum"], json!(sum), "{map}");
            let name = map["name"].as_str().expect("a name").to_owned();
            let expected = match OF_THE_RUN.contains(&&*name) {
                true => "run",
                false => "ray",
            };
            assert_eq!(map["of"], expected, "{map}");
            (name, numbers)
        });
        let maps = maps.collect();
        let structures = entry["structures"].as_array().expect("a list").iter();
        let scenes = structures.map(|it| gltf(&folder.join(it["file"].as_str().expect("a file"))));
        let scenes = scenes.collect();
        let read = |file: &Value| file.as_str().map(|file| floats(&folder.join(file)));
        let first_rays = read(&entry["first_rays"]["file"]).unwrap_or_default();
        let top = &entry["structures"][0];
        let bottoms = top["bottom_levels"].as_array().into_iter().flatten();
        let described = std::iter::once(top).chain(bottoms);
        let boxes = described
            .filter_map(|it| read(&it["boxes"]["file"]))
            .collect();
        Captured {
            entry,
            scenes,
            maps,
            first_rays,
            boxes,
        }
    });
    commands.collect()
}

/// The JSON of a binary glTF file.
fn gltf(path: &Path) -> Value {
    let bytes = std::fs::read(path).expect("a structure's file");
    assert_eq!(&bytes[..4], b"glTF");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    assert_eq!(word(8) as usize, bytes.len());
    serde_json::from_slice(&bytes[20..20 + word(12) as usize]).expect("JSON")
}

/// Numbers of a file as `numpy.load` reads them.
fn numbers(bytes: &[u8], descr: &str, sizes: &[u64]) -> Vec<u32> {
    let [width, height, depth] = sizes else {
        panic!("{sizes:?}");
    };
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = std::str::from_utf8(&bytes[10..data]).expect("it is ASCII");
    let shape = format!(
        "'descr': '{descr}', 'fortran_order': False, 'shape': ({depth}, {height}, {width}), "
    );
    assert!(head.contains(&shape), "{head} has {shape}");
    let size = descr[2..].parse().expect("bytes of a number");
    let number = |bytes: &[u8]| {
        let mut word = [0; 4];
        word[..size].copy_from_slice(bytes);
        u32::from_le_bytes(word)
    };
    bytes[data..].chunks(size).map(number).collect()
}

/// Floats of a file as `numpy.load` reads them.
fn floats(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("a file of floats");
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = std::str::from_utf8(&bytes[10..data]).expect("it is ASCII");
    let (_, shape) = head
        .split_once("'descr': '<f4', 'fortran_order': False, 'shape': (")
        .expect(head);
    let (shape, _) = shape.split_once(')').expect(head);
    let sizes = shape
        .split(", ")
        .map(|size| size.parse::<usize>().expect(head));
    assert_eq!(sizes.product::<usize>() * 4, bytes.len() - data);
    let float = |word: &[u8]| f32::from_le_bytes(word.try_into().expect("four bytes"));
    bytes[data..].chunks(4).map(float).collect()
}
