//! Walks against brute force over random scenes, ray flags, instance flags, masks and transforms.

use proptest::prelude::*;
use scenes::*;
use std::collections::BTreeMap;
use traversal::*;

/// Instance, geometry, primitive.
type Key = (u32, u32, u32);

/// How far distances may be off: rays are as close to triangles' planes as an angle of about a
/// ten-thousandth.
const GRAZING: f64 = 1e-4;

struct FlagScene {
    bottoms: Vec<Bottom>,
    instances: Vec<InstanceRecord>,
    top: Bytes,
}

struct Bottom {
    blob: Bytes,
    meshes: Vec<Mesh>,
    /// Boxes of geometries, and whether each geometry is opaque.
    boxes: Vec<(Vec<[f32; 6]>, bool)>,
}

/// A crowd of small triangles, or a few large ones.
fn random_mesh(random: &mut Random, triangles: usize) -> Mesh {
    let crowd = random.unit() < 0.05;
    let triangles = if crowd { 20 * triangles } else { triangles };
    let vertices = (0..triangles)
        .flat_map(|_| {
            let center = random.vector();
            [(); 3].map(|()| {
                let offset = random.vector();
                match crowd {
                    true => narrow(center + 0.1 * offset),
                    false => narrow(offset),
                }
            })
        })
        .collect();
    Mesh {
        vertices,
        indices: (0..triangles as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
        opaque: random.unit() < 0.5,
    }
}

fn random_boxes(random: &mut Random, count: usize) -> Vec<[f32; 6]> {
    (0..count)
        .map(|_| {
            let (center, size) = (random.vector(), random.vector());
            std::array::from_fn(|i| {
                let half = 0.3 * size[i % 3].abs();
                (center[i % 3] + if i < 3 { -half } else { half }) as f32
            })
        })
        .collect()
}

/// Any quality of build, with or without updates.
fn random_flags(random: &mut Random) -> u32 {
    let quality = QUALITIES[(random.unit() * QUALITIES.len() as f64) as usize];
    match random.unit() < 0.5 {
        true => quality | BuildFlags::ALLOW_UPDATE,
        false => quality,
    }
}

/// A transform without much shear, mirrored half of the time.
fn random_transform(random: &mut Random) -> [f32; 12] {
    let x = random.direction();
    let y = normalize(x.cross(random.direction()));
    let z = x.cross(y);
    let scale: [f64; 3] = std::array::from_fn(|_| {
        (0.5 + random.unit()) * if random.unit() < 0.5 { -1.0 } else { 1.0 }
    });
    let at = random.vector();
    std::array::from_fn(|i| match i % 4 {
        3 => (2.0 * at[i / 4]) as f32,
        column => ([x, y, z][column][i / 4] * scale[column]) as f32,
    })
}

fn random_world(random: &mut Random) -> FlagScene {
    let bottoms: Vec<Bottom> = (0..3)
        .map(|i| {
            let count = |random: &mut Random| (random.unit() * 24.0) as usize;
            if i == 2 {
                let boxes: Vec<_> = (0..2)
                    .map(|_| {
                        let count = count(random);
                        (random_boxes(random, count), random.unit() < 0.5)
                    })
                    .collect();
                let geometries: Vec<_> = boxes
                    .iter()
                    .map(|(boxes, opaque)| AabbGeometry {
                        boxes: memory(boxes),
                        stride_bytes: 24,
                        primitive_count: boxes.len() as u32,
                        flags: GeometryFlags((*opaque).into()),
                    })
                    .collect();
                let blob = build_blob(&BuildInput {
                    flags: BuildFlags(random_flags(random)),
                    geometries: Geometries::Aabbs(&geometries),
                });
                Bottom {
                    blob,
                    meshes: vec![],
                    boxes,
                }
            } else {
                let meshes: Vec<_> = (0..3)
                    .map(|_| {
                        let count = count(random);
                        random_mesh(random, count)
                    })
                    .collect();
                Bottom {
                    blob: build_meshes(&meshes, random_flags(random)),
                    meshes,
                    boxes: vec![],
                }
            }
        })
        .collect();
    let instances: Vec<_> = (0..6)
        .map(|i| {
            let bottom = &bottoms[(random.unit() * 3.0) as usize];
            let mut record = InstanceRecord::new(&bottom.blob, random_transform(random));
            let mask = if random.unit() < 0.3 { 0x0F } else { 0xF0 };
            record.custom_index_and_mask = (1000 + i) | mask << 24;
            let mut flags = (random.unit() * 16.0) as u32;
            if flags & 0xC == 0xC {
                flags &= 3;
            }
            record.sbt_offset_and_flags = (7 * i) | flags << 24;
            if random.unit() < 0.1 {
                record.reference = 0;
            }
            record
        })
        .collect();
    let top = build_instances(&instances, random_flags(random));
    FlagScene {
        bottoms,
        instances,
        top,
    }
}

/// Solves `matrix · x + translation = point` by Cramer's rule, or without the translation.
fn solve(matrix: &[f32; 12], point: DVec3, translate: bool) -> DVec3 {
    let column = |c: usize| DVec3::from([0, 1, 2].map(|r| matrix[4 * r + c].into()));
    let (a, b, c) = (column(0), column(1), column(2));
    let p = if translate { point - column(3) } else { point };
    let determinant = a.dot(b.cross(c));
    let axes = DVec3::new(p.dot(b.cross(c)), a.dot(p.cross(c)), a.dot(b.cross(p)));
    axes / determinant
}

#[derive(Clone, Copy, Debug)]
struct Expected {
    t: f64,
    opaque: bool,
    hit_kind: u8,
    triangle: bool,
}

impl FlagScene {
    /// Every candidate by the specification's rules; `None` if rounding could decide.
    fn expected(&self, ray: &Ray) -> Option<BTreeMap<Key, Expected>> {
        use ray_flags::*;
        let mut all = BTreeMap::new();
        let on = |bit: u32| ray.flags & bit != 0;
        for (index, instance) in self.instances.iter().enumerate() {
            let Some(bottom) = self
                .bottoms
                .iter()
                .find(|bottom| bottom.blob.address() == instance.reference)
            else {
                continue;
            };
            if instance.custom_index_and_mask >> 24 & ray.cull_mask == 0 {
                continue;
            }
            let flags = instance.sbt_offset_and_flags >> 24;
            let origin = solve(&instance.transform, wide(ray.origin), true);
            let direction = solve(&instance.transform, wide(ray.direction), false);
            let opacity = |geometry: bool| {
                let mut opaque = geometry;
                if flags & 4 != 0 {
                    opaque = true;
                }
                if flags & 8 != 0 {
                    opaque = false;
                }
                if on(OPAQUE) {
                    opaque = true;
                }
                if on(NO_OPAQUE) {
                    opaque = false;
                }
                let culled = if opaque {
                    on(CULL_OPAQUE)
                } else {
                    on(CULL_NO_OPAQUE)
                };
                (!culled).then_some(opaque)
            };
            for (geometry, mesh) in bottom.meshes.iter().enumerate() {
                let Some(opaque) = opacity(mesh.opaque) else {
                    continue;
                };
                if on(SKIP_TRIANGLES) {
                    continue;
                }
                for primitive in 0..mesh.indices.len() {
                    let triangle = mesh.triangle(primitive).map(wide);
                    let (e1, e2) = (triangle[1] - triangle[0], triangle[2] - triangle[0]);
                    let normal = e1.cross(e2);
                    let facing = normal.dot(direction);
                    let t = (triangle[0] - origin).dot(normal) / facing;
                    let p = origin + t * direction;
                    let inside = (0..3)
                        .map(|i| {
                            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                            normal.dot((b - a).cross(p - a)) / normal.dot(normal)
                        })
                        .fold(f64::INFINITY, f64::min);
                    let near_end = |end: f32| (t - f64::from(end)).abs() < 1e-4;
                    if inside.abs() < 1e-4 || facing.abs() < 1e-4 && inside > 0.0 {
                        return None;
                    }
                    if inside < 0.0 {
                        continue;
                    }
                    if near_end(ray.t_min) || near_end(ray.t_max) {
                        return None;
                    }
                    if t < ray.t_min.into() || t > ray.t_max.into() {
                        continue;
                    }
                    let front = (facing < 0.0) != (flags & 2 != 0);
                    let culls = flags & 1 == 0;
                    let culled = if front {
                        on(CULL_FRONT_FACING_TRIANGLES)
                    } else {
                        on(CULL_BACK_FACING_TRIANGLES)
                    };
                    if culls && culled {
                        continue;
                    }
                    let key = (index as u32, geometry as u32, primitive as u32);
                    all.insert(
                        key,
                        Expected {
                            t,
                            opaque,
                            hit_kind: if front { 0xFE } else { 0xFF },
                            triangle: true,
                        },
                    );
                }
            }
            for (geometry, (boxes, opaque)) in bottom.boxes.iter().enumerate() {
                let Some(opaque) = opacity(*opaque) else {
                    continue;
                };
                if on(SKIP_AABBS) {
                    continue;
                }
                for (primitive, bounds) in boxes.iter().enumerate() {
                    let (mut near, mut far) = (f64::from(ray.t_min), f64::from(ray.t_max));
                    for i in 0..3 {
                        let a = (f64::from(bounds[i]) - origin[i]) / direction[i];
                        let b = (f64::from(bounds[i + 3]) - origin[i]) / direction[i];
                        near = near.max(a.min(b));
                        far = far.min(a.max(b));
                    }
                    if (near - far).abs() < 1e-4 {
                        return None;
                    }
                    if near < far {
                        let key = (index as u32, geometry as u32, primitive as u32);
                        all.insert(
                            key,
                            Expected {
                                t: near,
                                opaque,
                                hit_kind: 42,
                                triangle: false,
                            },
                        );
                    }
                }
            }
        }
        let mut distances: Vec<f64> = all.values().map(|e| e.t).collect();
        distances.sort_by(f64::total_cmp);
        // Boxes around the ray's origin all begin at t_min: any of them may be the hit.
        let close = distances.windows(2).any(|w| w[1] - w[0] < 1e-4);
        (!close).then_some(all)
    }
}

fn key(hit: &Hit) -> Key {
    (hit.instance_index, hit.geometry_index, hit.primitive_index)
}

/// Walks, accepting any-hit candidates or not; a box is hit where the ray enters it. Returns the
/// hit and what was asked.
fn walk_through(
    world: &FlagScene,
    ray: &Ray,
    expected: &BTreeMap<Key, Expected>,
    accept: bool,
    fuel_step: u64,
    walker: &mut Walker,
) -> (Option<Hit>, Vec<Hit>) {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(world.top.address(), ray) };
    let mut asked = Vec::new();
    let mut verdict = Verdict::Continue;
    loop {
        let mut fuel = fuel_step;
        verdict = match walk.resume(walker, verdict, &mut fuel) {
            Event::Done => return (walk.committed().copied(), asked),
            Event::OutOfFuel => Verdict::Continue,
            Event::AnyHitCandidate => {
                asked.push(*walk.candidate());
                if accept {
                    Verdict::Accept
                } else {
                    Verdict::Continue
                }
            }
            Event::ProceduralCandidate => {
                let candidate = *walk.candidate();
                asked.push(candidate);
                // Boxes that the ray only comes near to may be reported; nothing is in them.
                if let Some(e) = expected.get(&key(&candidate))
                    && (accept || candidate.opaque)
                    && (walk.t_min()..=walk.t_max()).contains(&(e.t as f32))
                    && walk.commit_procedural(e.t as f32, 42)
                {
                    let mut none = 0;
                    let event = walk.resume(walker, Verdict::Continue, &mut none);
                    assert_eq!(event, Event::Done);
                    return (walk.committed().copied(), asked);
                }
                Verdict::Continue
            }
        };
    }
}

fn check(world: &FlagScene, ray: &Ray, walker: &mut Walker) -> Result<bool, TestCaseError> {
    let Some(expected) = world.expected(ray) else {
        return Ok(false);
    };
    for accept in [true, false] {
        let (hit, asked) = walk_through(world, ray, &expected, accept, u64::MAX, walker);
        // A walk in small steps is the same walk.
        let steps = walk_through(world, ray, &expected, accept, 1, walker);
        prop_assert_eq!(&(hit, asked.clone()), &steps);

        let countable: BTreeMap<_, _> = expected
            .iter()
            .filter(|(_, e)| accept || e.opaque)
            .collect();
        let nearest = countable.iter().min_by(|a, b| a.1.t.total_cmp(&b.1.t));
        let terminates = ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
        match (nearest, &hit) {
            (None, None) => {}
            (Some((nearest, _)), Some(hit)) => {
                let e = countable
                    .get(&key(hit))
                    .ok_or_else(|| TestCaseError::fail(format!("{hit:?} is no hit")))?;
                prop_assert!(terminates || key(hit) == **nearest, "{hit:?} {nearest:?}");
                prop_assert!((f64::from(hit.t) - e.t).abs() < GRAZING, "{hit:?} {e:?}");
                prop_assert_eq!(hit.hit_kind, e.hit_kind);
                prop_assert_eq!(hit.opaque, e.opaque);
                prop_assert_eq!(hit.triangle, e.triangle);
                prop_assert_eq!(hit.instance_custom_index, 1000 + hit.instance_index);
                prop_assert_eq!(hit.instance_sbt_offset, 7 * hit.instance_index);
            }
            other => prop_assert!(false, "{other:?}"),
        }
        // The candidates asked about: each at most once, only permitted ones, and all that are
        // nearer than the hit.
        let mut keys: Vec<Key> = asked.iter().map(key).collect();
        keys.sort();
        keys.dedup();
        prop_assert_eq!(keys.len(), asked.len());
        for candidate in asked.iter().filter(|candidate| candidate.triangle) {
            let e = expected
                .get(&key(candidate))
                .ok_or_else(|| TestCaseError::fail(format!("{candidate:?} is no candidate")))?;
            prop_assert!(!e.opaque && !candidate.opaque);
            prop_assert!((f64::from(candidate.t) - e.t).abs() < GRAZING);
            prop_assert_eq!(candidate.hit_kind, e.hit_kind);
        }
        if !terminates && !accept {
            let limit = hit.map_or(f64::INFINITY, |hit| hit.t.into());
            for (k, e) in expected.iter().filter(|(_, e)| e.t < limit) {
                let must = !(e.opaque && e.triangle);
                prop_assert!(!must || keys.contains(k), "{k:?} {e:?} was not asked");
            }
        }
    }
    Ok(true)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(400)))]

    #[test]
    fn walks_agree_with_brute_force(
        seed in 1u64..,
        flag_bits in 0u32..0x400,
        some_flags in 0u32..0x400,
        cull_mask in prop::sample::select(vec![0xFFu32, 0x0F, 0xF0, 0x1F, 0]),
        t_min in prop::sample::select(vec![0.0f32, 0.5, 1.5]),
        t_max in prop::sample::select(vec![f32::INFINITY, 3.0, 2.0]),
    ) {
        let mut random = Random(seed);
        for _ in 0..8 {
            random.unit();
        }
        let world = random_world(&mut random);
        let mut flags = flag_bits & some_flags;
        // Combinations that the specification forbids.
        if flags & 0x300 == 0x300 { flags &= !0x100; }
        for bits in [0x3u32, 0xC1, 0xC2, 0x30] {
            if (flags & bits).count_ones() > 1 { flags &= !bits; }
        }
        let mut walker = Walker::new();
        let mut clear = 0;
        for _ in 0..40 {
            let origin = narrow(3.0 * random.vector());
            let target = 1.5 * random.vector();
            let length = 0.3 + random.unit();
            let direction = narrow((target - wide(origin)).map(|c| c * length));
            let ray = Ray { origin, t_min, direction, t_max, flags, cull_mask };
            clear += u32::from(check(&world, &ray, &mut walker)?);
        }
        prop_assert!(clear > 5, "only {clear} rays are clear");
    }
}
