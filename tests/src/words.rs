//! Layers of triangles, and what shaders that leave words begin with.

/// A screen-filling triangle at z = 1, 2, 3, … for each layer.
pub fn layers(count: u32) -> Vec<[f32; 3]> {
    (1..=count)
        .flat_map(|z| {
            let z = z as f32;
            [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]]
        })
        .collect()
}

/// The world, in the first binding.
pub const WORLD: &str = "layout(set = 0, binding = 0) uniform accelerationStructureEXT world;\n";
/// Where shaders leave words, in the second binding.
pub const RESULTS: &str =
    "layout(set = 0, binding = 1, std430) buffer Results { uint results[]; };\n";
/// A miss shader that leaves what no other word is.
pub const MISS: &str = r"
layout(location = 0) rayPayloadInEXT uint payload;
void main() { payload = 0xffffffffu; }
";
