//! Structures as binary glTF 2.0 (Khronos, "glTF 2.0 Specification"): bottom levels as meshes,
//! instances as nodes; triangles as triangles, boxes and round primitives as the edges of boxes.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;

use serde_json::{Value, json};
use traversal::{Content, InstanceContent, PrimitiveShape};

/// Primitives of a file, at most.
pub const MAX_PRIMITIVES: usize = 1 << 20;
/// Instances of a file, at most.
const MAX_INSTANCES: usize = 1 << 16;

/// Values of the format.
mod word {
    pub const ARRAY_BUFFER: u32 = 34962;
    pub const ELEMENT_ARRAY_BUFFER: u32 = 34963;
    pub const UNSIGNED_INT: u32 = 5125;
    pub const FLOAT: u32 = 5126;
    pub const LINES: u32 = 1;
    pub const TRIANGLES: u32 = 4;
    pub const MAGIC: u32 = 0x4654_6C67;
    pub const VERSION: u32 = 2;
    pub const JSON_CHUNK: u32 = 0x4E4F_534A;
    pub const BINARY_CHUNK: u32 = 0x004E_4942;
}

/// The edges of a box, by its corners: bit 0 of a corner is the greater x, bit 1 y, bit 2 z.
const EDGES: [[u32; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// Cosine of the angle between axes that still are at right angles.
const RIGHT_ANGLE: f32 = 1e-4;

/// A file in the making.
#[derive(Default)]
pub struct GltfScene {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    binary: Vec<u8>,
    /// Meshes by bottom level, and by transform where that is in the vertices. `None`: without
    /// primitives.
    known: BTreeMap<(u64, Option<[u32; 12]>), Option<usize>>,
    primitives: usize,
    /// Primitives and instances past the limits, or without a place.
    pub left_out: u64,
}

/// A mesh's vertices of one geometry and kind.
#[derive(Default)]
struct Vertices {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl GltfScene {
    /// Adds an instance. `contents`: its bottom level's.
    pub fn add<I: Iterator<Item = Content>>(
        &mut self,
        instance: &InstanceContent,
        contents: impl FnOnce() -> I,
    ) {
        let transform = &instance.object_to_world;
        let is_finite = transform.iter().all(|element| element.is_finite());
        if self.nodes.len() == MAX_INSTANCES || !is_finite {
            self.left_out += 1;
            return;
        }
        // A node's matrix must be a translation, a rotation and a scale (3.5.3).
        let moved = (!has_right_angles(transform)).then_some(transform);
        let key = (instance.reference, moved.map(|it| it.map(f32::to_bits)));
        let mesh = match self.known.get(&key) {
            Some(&mesh) => mesh,
            None => {
                let mesh = self.add_mesh(instance.reference, moved, contents());
                self.known.insert(key, mesh);
                mesh
            }
        };
        let mut node = json!({
            "name": format!("instance {}", instance.index),
            "extras": {
                "instance": instance.index,
                "custom_index": instance.custom_index,
                "mask": instance.mask,
                "sbt_offset": instance.sbt_offset,
                "flags": instance.flags,
            },
        });
        if let Some(mesh) = mesh {
            node["mesh"] = mesh.into();
        }
        if moved.is_none() {
            node["matrix"] = matrix(transform);
        }
        self.nodes.push(node);
    }

    fn add_mesh(
        &mut self,
        address: u64,
        moved: Option<&[f32; 12]>,
        contents: impl Iterator<Item = Content>,
    ) -> Option<usize> {
        let mut parts: BTreeMap<(u32, u32), Vertices> = BTreeMap::new();
        let place = |point: [f32; 3]| moved.map_or(point, |transform| apply(transform, point));
        for content in contents {
            let (mode, corners, indices) = match content.shape {
                PrimitiveShape::Triangle(triangle) => {
                    (word::TRIANGLES, triangle.map(place).to_vec(), vec![0, 1, 2])
                }
                PrimitiveShape::Box(bounds) => {
                    let corner = |corner: usize| {
                        let axis = |axis: usize| bounds[corner >> axis & 1][axis];
                        place([axis(0), axis(1), axis(2)])
                    };
                    let edges = EDGES.as_flattened().to_vec();
                    (word::LINES, (0..8).map(corner).collect(), edges)
                }
            };
            let is_finite = corners
                .as_flattened()
                .iter()
                .all(|number| number.is_finite());
            if self.primitives == MAX_PRIMITIVES || !is_finite {
                self.left_out += 1;
                continue;
            }
            self.primitives += 1;
            let part = parts.entry((content.geometry, mode)).or_default();
            let first = part.positions.len() as u32;
            part.indices
                .extend(indices.iter().map(|index| first + index));
            part.positions.extend(corners);
        }
        if parts.is_empty() {
            return None;
        }
        let primitives = parts.iter().map(|(&(geometry, mode), part)| {
            let positions = self.add_positions(&part.positions);
            let indices = self.add_indices(&part.indices);
            json!({
                "attributes": { "POSITION": positions },
                "indices": indices,
                "mode": mode,
                "extras": { "geometry": geometry },
            })
        });
        let primitives: Vec<Value> = primitives.collect();
        self.meshes.push(json!({
            "name": format!("bottom level at {address:#x}"),
            "primitives": primitives,
        }));
        Some(self.meshes.len() - 1)
    }

    /// Adds vertices; returns their accessor.
    fn add_positions(&mut self, positions: &[[f32; 3]]) -> usize {
        let (mut least, mut most) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let start = self.binary.len();
        for position in positions {
            for axis in 0..3 {
                least[axis] = least[axis].min(position[axis]);
                most[axis] = most[axis].max(position[axis]);
                self.binary.extend(position[axis].to_le_bytes());
            }
        }
        let view = self.add_view(start, word::ARRAY_BUFFER);
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": word::FLOAT,
            "count": positions.len(),
            "type": "VEC3",
            "min": least,
            "max": most,
        }));
        self.accessors.len() - 1
    }

    fn add_indices(&mut self, indices: &[u32]) -> usize {
        let start = self.binary.len();
        (self.binary).extend(indices.iter().flat_map(|index| index.to_le_bytes()));
        let view = self.add_view(start, word::ELEMENT_ARRAY_BUFFER);
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": word::UNSIGNED_INT,
            "count": indices.len(),
            "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }

    fn add_view(&mut self, start: usize, target: u32) -> usize {
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": start,
            "byteLength": self.binary.len() - start,
            "target": target,
        }));
        self.views.len() - 1
    }

    /// The whole file.
    pub fn finish(self) -> Vec<u8> {
        let mut object = json!({
            "asset": { "version": "2.0", "generator": "Tuff" },
            "scene": 0,
            "scenes": [{ "name": "top level" }],
        });
        // Lists must not be empty.
        if !self.nodes.is_empty() {
            object["scenes"][0]["nodes"] = (0..self.nodes.len()).collect();
        }
        if !self.binary.is_empty() {
            object["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        }
        for (name, list) in [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ] {
            if !list.is_empty() {
                object[name] = list.into();
            }
        }
        let mut text = object.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut chunks = vec![(word::JSON_CHUNK, text)];
        if !self.binary.is_empty() {
            // All of it are words.
            chunks.push((word::BINARY_CHUNK, self.binary));
        }
        let length: usize = chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum();
        let mut file = Vec::with_capacity(12 + length);
        let mut put = |word: u32| file.extend(word.to_le_bytes());
        put(word::MAGIC);
        put(word::VERSION);
        put(12 + length as u32);
        for (kind, bytes) in chunks {
            file.extend((bytes.len() as u32).to_le_bytes());
            file.extend(kind.to_le_bytes());
            file.extend(bytes);
        }
        file
    }
}

/// A point in world space.
fn apply(transform: &[f32; 12], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [0, 4, 8].map(|row| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|column: usize| transform[row + column]);
        a * x + b * y + c * z + d
    })
}

/// A column-major 4 × 4 matrix.
fn matrix(transform: &[f32; 12]) -> Value {
    let element = |index: usize| match (index / 4, index % 4) {
        (3, 3) => 1.0,
        (_, 3) => 0.0,
        (column, row) => transform[4 * row + column],
    };
    (0..16).map(element).collect()
}

/// Whether a transform keeps axes at right angles, and none of them vanishes.
fn has_right_angles(transform: &[f32; 12]) -> bool {
    let column = |column: usize| [0, 4, 8].map(|row: usize| f64::from(transform[row + column]));
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let columns = [0, 1, 2].map(column);
    let lengths = columns.map(|column| dot(column, column).sqrt());
    let pairs = [(0, 1), (1, 2), (2, 0)];
    lengths.iter().all(|&length| length > 0.0)
        && pairs.iter().all(|&(a, b)| {
            let cosine = dot(columns[a], columns[b]) / (lengths[a] * lengths[b]);
            cosine.abs() < f64::from(RIGHT_ANGLE)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file's JSON and its binary chunk, held against the container's rules (4.4).
    fn parts(file: &[u8]) -> (Value, Vec<u8>) {
        let word = |at: usize| {
            let bytes = file[at..at + 4].try_into().expect("four bytes");
            u32::from_le_bytes(bytes) as usize
        };
        assert_eq!(&file[..4], b"glTF");
        assert_eq!((word(4), word(8)), (2, file.len()));
        let (mut at, mut chunks) = (12, Vec::new());
        while at < file.len() {
            let length = word(at);
            assert_eq!(length % 4, 0, "chunks are aligned");
            chunks.push((&file[at + 4..at + 8], &file[at + 8..at + 8 + length]));
            at += 8 + length;
        }
        assert_eq!(chunks[0].0, b"JSON");
        let json = serde_json::from_slice(chunks[0].1).expect("JSON");
        let binary = chunks.get(1).map_or(&[][..], |(kind, bytes)| {
            assert_eq!(kind, b"BIN\0");
            bytes
        });
        assert!(chunks.len() <= 2);
        (json, binary.to_vec())
    }

    fn list<'a>(json: &'a Value, name: &str) -> &'a [Value] {
        json.get(name).map_or(&[], |list| {
            let list = list.as_array().expect("a list");
            assert!(!list.is_empty(), "{name} must not be empty");
            list
        })
    }

    fn number(value: &Value) -> usize {
        value.as_u64().expect("a number") as usize
    }

    /// The vertices of each primitive with its mode, held against the rules for accessors: bounds,
    /// alignment (3.6.2.4), the least and the most (3.6.2.5), indices below the count.
    fn checked(file: &[u8]) -> (Value, Vec<(usize, Vec<[f32; 3]>)>) {
        let (json, binary) = parts(file);
        assert_eq!(json["asset"]["version"], "2.0");
        if let [buffer] = list(&json, "buffers") {
            let length = number(&buffer["byteLength"]);
            assert!(length <= binary.len() && binary.len() < length + 4);
        }
        let views = list(&json, "bufferViews");
        for view in views {
            assert_eq!(view["buffer"], 0);
            let end = number(&view["byteOffset"]) + number(&view["byteLength"]);
            assert!(end <= binary.len() && number(&view["byteLength"]) > 0);
        }
        let accessors = list(&json, "accessors");
        let words = |index: &Value, per_element: usize, target: u32| -> Vec<[u8; 4]> {
            let accessor = &accessors[number(index)];
            let view = &views[number(&accessor["bufferView"])];
            assert_eq!(view["target"], target);
            let start = number(&view["byteOffset"]);
            assert_eq!(start % 4, 0, "a multiple of the component's size");
            let bytes = number(&accessor["count"]) * per_element * 4;
            assert!(bytes > 0 && bytes <= number(&view["byteLength"]));
            let words = binary[start..start + bytes].chunks(4);
            words
                .map(|word| word.try_into().expect("four bytes"))
                .collect()
        };
        let mut found = Vec::new();
        for mesh in list(&json, "meshes") {
            assert!(!list(mesh, "primitives").is_empty());
            for primitive in list(mesh, "primitives") {
                let positions = &primitive["attributes"]["POSITION"];
                let accessor = &accessors[number(positions)];
                assert_eq!(
                    (&accessor["type"], &accessor["componentType"]),
                    (&json!("VEC3"), &json!(5126))
                );
                let floats: Vec<f32> = words(positions, 3, 34962)
                    .into_iter()
                    .map(f32::from_le_bytes)
                    .collect();
                let vertices: Vec<[f32; 3]> =
                    floats.chunks(3).map(|v| [v[0], v[1], v[2]]).collect();
                for axis in 0..3 {
                    let of = |name: &str| accessor[name][axis].as_f64().expect("a number") as f32;
                    let numbers = vertices.iter().map(|vertex| vertex[axis]);
                    assert_eq!(numbers.clone().fold(f32::INFINITY, f32::min), of("min"));
                    assert_eq!(numbers.fold(f32::NEG_INFINITY, f32::max), of("max"));
                }
                let accessor = &accessors[number(&primitive["indices"])];
                assert_eq!(
                    (&accessor["type"], &accessor["componentType"]),
                    (&json!("SCALAR"), &json!(5125))
                );
                let indices = words(&primitive["indices"], 1, 34963);
                let corner = |index: [u8; 4]| vertices[u32::from_le_bytes(index) as usize];
                let corners: Vec<[f32; 3]> = indices.into_iter().map(corner).collect();
                let mode = number(&primitive["mode"]);
                let of_one = if mode == 4 { 3 } else { 2 };
                assert_eq!(corners.len() % of_one, 0);
                found.push((mode, corners));
            }
        }
        for node in list(&json, "nodes") {
            assert!(node["mesh"].is_null() || number(&node["mesh"]) < list(&json, "meshes").len());
        }
        (json, found)
    }

    fn instance(index: u32, object_to_world: [f32; 12]) -> InstanceContent {
        InstanceContent {
            index,
            object_to_world,
            custom_index: 7,
            mask: 0xF0,
            sbt_offset: 2,
            flags: 4,
            reference: 0x1000,
        }
    }

    const TURNED: [f32; 12] = [0.0, -2.0, 0.0, 5.0, 2.0, 0.0, 0.0, 6.0, 0.0, 0.0, 2.0, 7.0];
    const SHEARED: [f32; 12] = [1.0, 1.0, 0.0, 5.0, 0.0, 1.0, 0.0, 6.0, 0.0, 0.0, 1.0, 7.0];

    fn contents() -> [Content; 3] {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        let of = |geometry, primitive, shape| Content {
            geometry,
            primitive,
            shape,
        };
        [
            of(0, 0, PrimitiveShape::Triangle(triangle)),
            of(1, 3, PrimitiveShape::Box([[0.0; 3], [1.0, 2.0, 3.0]])),
            of(
                1,
                4,
                PrimitiveShape::Box([[0.0; 3], [1.0, f32::INFINITY, 3.0]]),
            ),
        ]
    }

    #[test]
    fn instances_share_a_mesh() {
        let mut scene = GltfScene::default();
        for index in 0..2 {
            scene.add(&instance(index, TURNED), || contents().into_iter());
        }
        assert_eq!(scene.left_out, 1, "a box that is infinite");
        let (json, found) = checked(&scene.finish());
        assert_eq!(json["scenes"][0]["nodes"], json!([0, 1]));
        for node in list(&json, "nodes") {
            assert_eq!(
                (&node["mesh"], &node["extras"]["mask"]),
                (&json!(0), &json!(0xF0))
            );
            let columns = [
                [0.0, 2.0, 0.0, 0.0],
                [-2.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 2.0, 0.0],
                [5.0, 6.0, 7.0, 1.0],
            ];
            assert_eq!(node["matrix"], json!(columns.as_flattened()));
        }
        let [(4, triangle), (1, lines)] = &found[..] else {
            panic!("{found:?}");
        };
        assert_eq!(
            triangle[..],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]
        );
        // Each of the twelve edges once: along one axis, for all corners of the other two.
        assert_eq!(lines.len(), 24);
        let mut edges: Vec<String> = (lines.chunks(2))
            .map(|edge| {
                let differ = (0..3).filter(|&axis| edge[0][axis] != edge[1][axis]);
                assert_eq!(differ.count(), 1);
                format!("{edge:?}")
            })
            .collect();
        edges.sort();
        edges.dedup();
        assert_eq!(edges.len(), 12);
    }

    #[test]
    fn transforms_that_nodes_cannot_have_are_in_the_vertices() {
        let mut scene = GltfScene::default();
        scene.add(&instance(0, SHEARED), || contents().into_iter().take(1));
        scene.add(&instance(1, [f32::NAN; 12]), || contents().into_iter());
        assert_eq!(scene.left_out, 1);
        let (json, found) = checked(&scene.finish());
        assert_eq!(list(&json, "nodes")[0].get("matrix"), None);
        let moved = [[5.0, 6.0, 7.0], [6.0, 6.0, 7.0], [6.0, 7.0, 7.5]];
        assert_eq!(found[0].1[..], moved);
    }

    #[test]
    fn nothing_is_a_file_too() {
        let (json, found) = checked(&GltfScene::default().finish());
        assert!(found.is_empty() && json.get("buffers").is_none());
        let mut scene = GltfScene::default();
        scene.add(&instance(0, TURNED), || [].into_iter());
        let (json, _) = checked(&scene.finish());
        assert!(list(&json, "nodes")[0].get("mesh").is_none());
    }
}
