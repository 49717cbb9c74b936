//! The gain of reordering in a path tracer whose materials are in its ray generation shader: the
//! same picture with and without, alternating.

use std::time::Instant;

use anyhow::{Result, ensure};
use clap::Args;
use tuff_tests::*;

#[derive(Args)]
pub struct Options {
    /// Width and height of the picture
    #[arg(long, default_value_t = 256)]
    size: u32,
    /// Turns of the loop that a material is: about six operations each
    #[arg(long, value_delimiter = ',', default_values_t = [24, 96, 384])]
    work: Vec<u32>,
    /// Rays along a path
    #[arg(long, default_value_t = 6)]
    bounces: u32,
    /// Pictures of each kind
    #[arg(long, default_value_t = 5)]
    turns: usize,
}

/// Materials that differ in what they compute, and a scene of triangles that have one each at
/// random.
fn raygen(bounces: u32, work: u32, reorder: &str) -> String {
    let cases: String = (0..8)
        .map(|i| {
            format!(
                "case {i}u: for (int k = 0; k < {work}; k++) {{ x = fract(x * {a} + y); y = sqrt(abs(x - {b} * y)) + 0.1; }} break;\n",
                a = 1.7 + 0.31 * f64::from(i),
                b = 0.3 + 0.07 * f64::from(i),
            )
        })
        .collect();
    format!(
        "#extension GL_NV_shader_invocation_reorder : enable
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1, std430) buffer Results {{ float results[]; }};
        layout(location = 0) rayPayloadEXT uint payload;
        uint hash(uint v) {{ v = (v ^ v >> 16) * 0x7feb352du; v = (v ^ v >> 15) * 0x846ca68bu; return v ^ v >> 16; }}
        void main() {{
            uint i = gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
            vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy) * 2.0 - 1.0;
            vec3 from = vec3(at, -2.0), along = vec3(0, 0, 1);
            float x = at.x, y = at.y, sum = 0.0;
            for (uint bounce = 0; bounce < {bounces}u; bounce++) {{
                hitObjectNV object;
                hitObjectTraceRayNV(object, world, 1u, 0xffu, 0u, 0u, 0u, from, 0.001, along, 100.0, 0);
                uint material = 8u;
                if (hitObjectIsHitNV(object))
                    material = hash(uint(hitObjectGetPrimitiveIndexNV(object))) & 7u;
                {reorder}
                if (material == 8u)
                    break;
                switch (material) {{
                {cases}
                }}
                sum += x;
                from += along * hitObjectGetRayTMaxNV(object);
                uint bits = hash(i * 31u + bounce);
                vec3 turn = vec3(bits & 1023u, bits >> 10 & 1023u, bits >> 20 & 1023u) / 511.5 - 1.0;
                along = normalize(turn + vec3(0.0, 0.0, -0.001));
            }}
            results[i] = sum;
        }}"
    )
}

const MISS: &str = "layout(location = 0) rayPayloadInEXT uint payload; void main() {}";
const HIT: &str = "layout(location = 0) rayPayloadInEXT uint payload; void main() {}";

/// A closed box of small triangles with as many floating inside.
fn world(gpu: &Gpu) -> Structure {
    let mut random = Rng::with_seed(3);
    let mut corners = Vec::new();
    for _ in 0..20_000 {
        let mut c = || between(&mut random, -3.0, 3.0);
        let center = [c(), c(), c()];
        for _ in 0..3 {
            corners.push(center.map(|c| c + between(&mut random, -0.3, 0.3)));
        }
    }
    gpu.scene(&[Geometry::opaque(&corners)])
}

/// Prints a row for each amount of work.
pub fn run(options: &Options) -> Result<()> {
    let gpu = Gpu::without_validation();
    ensure!(
        gpu.optional.reorder.ray_tracing_invocation_reorder == vk::TRUE,
        "the driver has no VK_NV_ray_tracing_invocation_reorder"
    );
    let world = world(&gpu);
    println!(
        "{:>8} {:>16} {:>16} {:>8}",
        "work", "as they come", "reordered", "gain"
    );
    for &work in &options.work {
        let [plain, reordered] = milliseconds(&gpu, world, options, work)?;
        let gain = plain / reordered;
        println!("{work:>8} {plain:>13.1} ms {reordered:>13.1} ms {gain:>7.2}x");
    }
    Ok(())
}

/// The best time of a picture as its lanes come, and with those of one material brought together.
fn milliseconds(gpu: &Gpu, world: Structure, options: &Options, work: u32) -> Result<[f64; 2]> {
    let count = u64::from(options.size).pow(2);
    let prepared = ["", "reorderThreadNV(material, 4u);"].map(|reorder| {
        let output = gpu.buffer(4 * count);
        let case = Case::new(&raygen(options.bounces, work, reorder));
        let case = case.miss(MISS).hit(HIT).bind(world).bind(output);
        let rays = gpu.rays(&case);
        let regions = gpu.regions(&rays, &case.table());
        (rays, regions, output)
    });
    let mut best = [f64::INFINITY; 2];
    for _ in 0..options.turns {
        for ((rays, regions, _), best) in prepared.iter().zip(&mut best) {
            let started = Instant::now();
            let size = [options.size, options.size, 1];
            gpu.run(|commands| gpu.record_trace(commands, rays, regions, size));
            *best = best.min(1e3 * started.elapsed().as_secs_f64());
        }
    }
    let [plain, reordered] = prepared
        .each_ref()
        .map(|(_, _, output)| output.read::<f32>());
    ensure!(plain == reordered, "the pictures differ");
    Ok(best)
}
