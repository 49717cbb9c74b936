//! The shaders, put together from their parts.

use std::collections::HashMap;
use std::sync::Mutex;

use tuff_tests::Stage;

const COMMON: &str = include_str!("shaders/common.glsl");
const RAYGEN: &str = include_str!("shaders/raygen.glsl");

pub const MISS: &str = include_str!("shaders/miss.glsl");
pub const HIT: &str = include_str!("shaders/hit.glsl");
pub const PRIMARY: &str = include_str!("shaders/primary.glsl");
pub const SHADOW: &str = include_str!("shaders/shadow.glsl");
pub const OCCLUSION: &str = include_str!("shaders/occlusion.glsl");
pub const PATH: &str = include_str!("shaders/path.glsl");
pub const REFLECTION: &str = include_str!("shaders/reflection.glsl");
pub const REFLECTION_HIT: &str = include_str!("shaders/reflection_hit.glsl");
pub const REFLECTION_MISS: &str = include_str!("shaders/reflection_miss.glsl");
pub const FOLIAGE: &str = include_str!("shaders/foliage.glsl");
pub const FOLIAGE_ANY_HIT: &str = include_str!("shaders/foliage_any_hit.glsl");
pub const BALL: &str = include_str!("shaders/ball.glsl");
pub const BALL_HIT: &str = include_str!("shaders/ball_hit.glsl");
pub const ARITHMETIC: &str = include_str!("shaders/arithmetic.glsl");
pub const GENERATED: &str = include_str!("shaders/generated.glsl");
pub const POINTERS: &str = include_str!("shaders/pointers.glsl");
pub const TEXTURES: &str = include_str!("shaders/textures.glsl");
pub const TRIANGLE: &str = include_str!("shaders/triangle.glsl");
pub const TRIANGLE_HIT: &str = include_str!("shaders/triangle_hit.glsl");
pub const TRIANGLE_MISS: &str = include_str!("shaders/triangle_miss.glsl");
pub const BOXES: &str = include_str!("shaders/boxes.glsl");
pub const MIRRORS: &str = include_str!("shaders/mirrors.glsl");
pub const CALLABLE: &str = include_str!("shaders/callable.glsl");
pub const CALLABLE_HIT: &str = include_str!("shaders/callable_hit.glsl");
pub const CALLABLE_MISS: &str = include_str!("shaders/callable_miss.glsl");
pub const TEXTURED: &str = include_str!("shaders/textured.glsl");
pub const TEXTURED_HIT: &str = include_str!("shaders/textured_hit.glsl");
pub const HYBRID: &str = include_str!("shaders/hybrid.glsl");
pub const FORMATS: &str = include_str!("shaders/formats.glsl");
pub const STACK: &str = include_str!("shaders/stack.glsl");
pub const NETWORK: &str = include_str!("shaders/network.glsl");
pub const NETWORK_VECTORS: &str = include_str!("shaders/network_vectors.glsl");
pub const NETWORK_PLAIN: &str = include_str!("shaders/network_plain.glsl");
const NETWORK_HIT: &str = include_str!("shaders/network_hit.glsl");
const PATTERN: &str = include_str!("shaders/pattern.glsl");
const BINDLESS_HIT: &str = include_str!("shaders/bindless_hit.glsl");
const TONE: &str = include_str!("shaders/tone.glsl");
const SHOW: &str = include_str!("shaders/show.glsl");
const MATERIAL: &str = include_str!("shaders/material_hit.glsl");
const LAYER: &str = include_str!("shaders/large.glsl");
const QUERY: &str = include_str!("shaders/query.glsl");

/// Compiles GLSL once: compiling it is not the drivers' work, and must not be timed as theirs.
pub fn glsl(stage: Stage, source: &str) -> Vec<u32> {
    static COMPILED: Mutex<Option<HashMap<String, Vec<u32>>>> = Mutex::new(None);
    let mut compiled = COMPILED
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    let compiled = compiled.get_or_insert_default();
    let key = format!("{stage:?} {source}");
    let words = compiled.entry(key);
    words
        .or_insert_with(|| tuff_tests::glsl(stage, source))
        .clone()
}

/// A shader with the common declarations before it.
pub fn with_common(stage: Stage, source: &str) -> Vec<u32> {
    glsl(stage, &format!("{COMMON}{source}"))
}

/// A ray generation shader that shoots with the common payload.
pub fn raygen(source: &str) -> Vec<u32> {
    glsl(Stage::RayGeneration, &format!("{COMMON}{RAYGEN}{source}"))
}

/// The closest-hit shader of one of many materials.
pub fn material(number: u32) -> Vec<u32> {
    let source = format!("const int KIND = {number};\n{COMMON}{MATERIAL}");
    glsl(Stage::ClosestHit, &source)
}

/// A ray generation shader of about 10,000 instructions: many layers, one of which each pixel
/// takes. Shaders of other salts differ a little.
pub fn large(salt: usize) -> Vec<u32> {
    const LAYERS: usize = 43;
    let layers: String = (0..LAYERS)
        .map(|kind| {
            let named = LAYER.replace("KIND", &kind.to_string());
            named.replace("SALT", &salt.to_string())
        })
        .collect();
    let cases: String = (0..LAYERS)
        .map(|kind| format!("case {kind}u: color = layer_{kind}(at, normal, seed); break;\n"))
        .collect();
    raygen(&format!(
        "{layers}
        void main() {{
            vec3 at = direction() * 4.0, normal = normalize(at.yzx + 0.1), color = vec3(0.0);
            uint seed = hash(number());
            switch (seed % {LAYERS}u) {{ {cases} }}
            put(color, 1.0);
        }}"
    ))
}

/// Instructions of a module.
#[cfg(test)]
pub fn instruction_count(words: &[u32]) -> usize {
    const HEADER: usize = 5;
    let mut rest = &words[HEADER..];
    let mut count = 0;
    while let Some(&first) = rest.first() {
        rest = &rest[(first >> 16) as usize..];
        count += 1;
    }
    count
}

/// The compute shader that traces paths by ray queries.
pub fn query() -> Vec<u32> {
    with_common(Stage::Compute, QUERY)
}

/// The compute shader that reads an image into the picture.
pub fn show() -> Vec<u32> {
    glsl(Stage::Compute, SHOW)
}

/// The compute shader that maps light to colours.
pub fn tone() -> Vec<u32> {
    glsl(Stage::Compute, TONE)
}

/// The callable shader of one of three patterns.
pub fn pattern(number: u32) -> Vec<u32> {
    let source = format!("const int KIND = {number};\n{COMMON}{PATTERN}");
    glsl(Stage::Callable, &source)
}

/// The closest-hit shader that picks one of so many textures.
pub fn bindless_hit(textures: u32) -> Vec<u32> {
    let source = format!("const int TEXTURES = {textures};\n{COMMON}{BINDLESS_HIT}");
    glsl(Stage::ClosestHit, &source)
}

/// The closest-hit shader that evaluates the network whose source this is.
pub fn network_hit(network: &str) -> Vec<u32> {
    glsl(
        Stage::ClosestHit,
        &format!("{network}{COMMON}{NETWORK_HIT}"),
    )
}
