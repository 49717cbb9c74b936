//! Scenes that are hard to get right, each by a number that makes it harder.

use traversal::Ray;

use crate::exact;
use crate::{DMat3, DVec3, Mesh, Random, icosphere, narrow, normalize, ray, wide};

/// A mesh, rays at it, and where each meets it first.
pub struct Hard {
    pub mesh: Mesh,
    pub rays: Vec<(Ray, Option<f64>)>,
}

/// A way in which scenes get harder.
pub struct HardSeries {
    pub name: &'static str,
    pub title: &'static str,
    /// The meaning of the columns.
    pub across: &'static str,
    pub columns: &'static [f64],
    make: fn(f64, &mut Random, usize) -> Hard,
}

impl HardSeries {
    /// The scene of one column, with so many rays.
    pub fn make(&self, column: f64, count: usize) -> Hard {
        (self.make)(column, &mut Random(0x9E37_79B9_7F4A_7C15), count)
    }
}

pub const CASES: &[HardSeries] = &[
    HardSeries {
        name: "slivers",
        title: "Slivers: a closed mesh of needles",
        across: "length of a needle over its width",
        columns: &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
        make: slivers,
    },
    HardSeries {
        name: "reach",
        title: "Reach: a box whose walls are hit near their seams, from inside",
        across: "how far the walls reach, over the distance of the hit",
        columns: &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8],
        make: reach,
    },
    HardSeries {
        name: "needles",
        title: "Needles: strips side by side",
        across: "length of a strip over its width",
        columns: &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6],
        make: needles,
    },
    HardSeries {
        name: "offset",
        title: "Far away: a closed mesh of radius 1",
        across: "distance from the origin of space",
        columns: &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8],
        make: |distance, random, count| {
            let offset = DVec3::new(distance, 1.3 * distance, 0.7 * distance);
            ball(&|p| p + offset, 1.0, 1.0, random, count)
        },
    },
    HardSeries {
        name: "scale",
        title: "Size: a closed mesh, seen from two radii away",
        across: "radius",
        columns: &[
            1e-44, 1e-41, 1e-38, 1e-30, 1e-20, 1e-15, 1e-10, 1.0, 1e10, 1e15, 1e20, 1e30, 1e37,
        ],
        make: |scale, random, count| ball(&|p| p * scale, scale, 1.0, random, count),
    },
    HardSeries {
        name: "direction",
        title: "Directions that are not of unit length",
        across: "length of the direction",
        columns: &[
            1e-44, 1e-41, 1e-38, 1e-30, 1e-20, 1e-10, 1e-5, 1.0, 1e5, 1e10, 1e20, 1e30, 1e37,
        ],
        make: |length, random, count| ball(&|p| p, 1.0, length, random, count),
    },
    HardSeries {
        name: "grazing",
        title: "Grazing rays at a flat grid",
        across: "angle to the surface",
        columns: &[1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7],
        make: grazing,
    },
    HardSeries {
        name: "parallel",
        title: "Rays along an axis, at the edges and vertices of a grid",
        across: "the direction's other components",
        columns: &[1.0, 1e-5, 1e-10, 1e-20, 1e-30, 1e-38, 1e-41, 1e-44, 0.0],
        make: parallel,
    },
    HardSeries {
        name: "start",
        title: "Hits near the ray's start",
        across: "distance of the surface, whose triangles are of size 0.1",
        columns: &[1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9],
        make: near_start,
    },
    HardSeries {
        name: "end",
        title: "Hits near the end of the ray's interval, before and behind it",
        across: "distance from the end, of the distance",
        columns: &[1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7],
        make: near_end,
    },
    HardSeries {
        name: "layers",
        title: "Stacks: four layers, one behind the other",
        across: "distance between layers",
        columns: &[1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 1e-7, 0.0],
        make: layers,
    },
    HardSeries {
        name: "nested",
        title: "Nested triangles, each a tenth smaller: deep trees",
        across: "triangles",
        columns: &[4.0, 16.0, 64.0, 128.0, 256.0, 512.0],
        make: nested,
    },
];

/// Where rays are aimed at.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Aim {
    /// Points inside triangles, on edges and at vertices in turn.
    Everywhere,
    /// Points inside triangles that have no neighbours.
    Inside,
}

/// Rays from `from` to points of triangles.
fn aimed(
    mesh: Mesh,
    aim: Aim,
    random: &mut Random,
    count: usize,
    mut from: impl FnMut(DVec3, usize, &mut Random) -> Option<(DVec3, f64)>,
) -> Hard {
    let mut rays = Vec::with_capacity(count);
    let mut attempts = 0;
    while rays.len() < count && attempts < 20 * count {
        attempts += 1;
        let index = (random.unit() * mesh.indices.len() as f64) as usize;
        let triangle = mesh.triangle(index).map(wide);
        let weights = match attempts % 3 {
            _ if aim == Aim::Inside => [0.3, 0.25, 0.45],
            0 => {
                let (u, v) = (random.unit(), random.unit());
                if u + v > 1.0 {
                    [u + v - 1.0, 1.0 - u, 1.0 - v]
                } else {
                    [1.0 - u - v, u, v]
                }
            }
            1 => {
                let u = random.unit();
                [1.0 - u, u, 0.0]
            }
            _ => [1.0, 0.0, 0.0],
        };
        let target = (0..3).map(|k| weights[k] * triangle[k]).sum::<DVec3>();
        let Some((origin, scale)) = from(target, index, random) else {
            continue;
        };
        let origin = narrow(origin);
        let direction = narrow((target - wide(origin)) * scale);
        let ray = ray(origin, direction);
        let truth = exact::nearest(&mesh, &ray).map(|(_, crossing)| crossing.t);
        rays.push((ray, truth));
    }
    Hard { mesh, rays }
}

/// A sphere, moved by `place` to a radius of about `scale`, from two radii away and well inside its
/// outline; directions are about `length` long.
fn ball(
    place: &dyn Fn(DVec3) -> DVec3,
    scale: f64,
    length: f64,
    random: &mut Random,
    count: usize,
) -> Hard {
    let (points, indices) = icosphere(3);
    let vertices = points.iter().map(|&p| narrow(place(p))).collect();
    let corners = indices.clone();
    let mesh = Mesh {
        vertices,
        indices,
        opaque: true,
    };
    // Directions keep the scene's size, unless they are to have another.
    let factor = if length == 1.0 {
        1.0
    } else {
        length / (2.0 * scale)
    };
    aimed(
        mesh,
        Aim::Everywhere,
        random,
        count,
        |target, index, random| {
            let normal = points[corners[index][0] as usize];
            let tilt = random.direction();
            let way = normalize(normal * 0.9 + tilt * 0.5);
            Some((target + 2.0 * scale * way, factor))
        },
    )
}

/// Rays within 10⁻⁴ of the edges of a cube that begins at the origin, from about one away.
fn reach(size: f64, random: &mut Random, count: usize) -> Hard {
    let size = f64::from((size * 0.955) as f32);
    let corner = |k: u32| narrow([0, 1, 2].map(|i| f64::from(k >> i & 1) * size));
    let mut mesh = Mesh {
        vertices: (0..8).map(corner).collect(),
        indices: Vec::new(),
        opaque: true,
    };
    for [a, b, c, d] in [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ] {
        mesh.indices.extend([[a, b, c], [a, c, d]]);
    }
    let mut rays = Vec::with_capacity(count);
    while rays.len() < count {
        let axis = rays.len() % 3;
        let along = random.unit() * size;
        let mut point = |beside: f64| {
            DVec3::from([0, 1, 2].map(|i| match i == axis {
                true => along + random.signed() * beside.min(along).min(size - along),
                false => random.unit() * beside,
            }))
        };
        let (origin, target) = (narrow(point(0.9_f64.min(size))), point(1e-4));
        let direction = narrow(target - wide(origin));
        if direction == [0.0; 3] || origin.contains(&0.0) {
            continue;
        }
        let ray = ray(origin, direction);
        let truth = exact::nearest(&mesh, &ray).map(|(_, crossing)| crossing.t);
        rays.push((ray, truth));
    }
    Hard { mesh, rays }
}

/// Strips along x that share their long edges, from above.
fn needles(aspect: f64, random: &mut Random, count: usize) -> Hard {
    let width = 2.0 / aspect;
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for i in 0..=64 {
        let y = f64::from(i) * width;
        for x in [-1.0, 1.0] {
            let aside = (0.3 * x + random.signed() * 0.2) * width;
            let above = random.signed() * width;
            mesh.vertices.push(narrow([x, y + aside, above]));
        }
    }
    for first in (0..128).step_by(2) {
        mesh.indices.push([first, first + 1, first + 3]);
        mesh.indices.push([first, first + 3, first + 2]);
    }
    aimed(mesh, Aim::Everywhere, random, count, |target, _, random| {
        let tilt = random.vector();
        let far = libm::pow(10.0, -2.0 * random.unit());
        let from = DVec3::new(tilt.x, 0.3 * tilt.y, 1.0);
        Some((target + far * from, 1.0))
    })
}

fn slivers(aspect: f64, random: &mut Random, count: usize) -> Hard {
    let (points, indices) = icosphere(3);
    let vertices = points
        .iter()
        .map(|p| narrow([p[0], p[1], p[2] * aspect]))
        .collect();
    let corners = indices.clone();
    let mesh = Mesh {
        vertices,
        indices,
        opaque: true,
    };
    aimed(
        mesh,
        Aim::Everywhere,
        random,
        count,
        |target, index, random| {
            let normal = points[corners[index][0] as usize];
            let aside = random.signed() * 0.5;
            // From the side: a needle's tip is no place to aim at.
            (normal.z.abs() < 0.7).then(|| {
                let turned = DVec3::new(-normal.y, normal.x, 0.0);
                let way = normalize(normal.with_z(0.0) + aside * turned);
                (target + 2.0 * way, 1.0)
            })
        },
    )
}

/// Three axes at right angles, the third of them normal to the grids below.
pub const FRAME: DMat3 =
    DMat3::from_cols_array_2d(&[[0.8, 0.36, 0.48], [-0.6, 0.48, 0.64], [0.0, -0.8, 0.6]]);

/// A flat grid of 16 × 16 squares from −1 to 1, at these heights.
fn grid(heights: &[f64], frame: DMat3) -> Mesh {
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for &height in heights {
        mesh.patch(16, 16, |u, v| {
            let [x, y] = [u, v].map(|share| 2.0 * f64::from(share) - 1.0);
            narrow(frame * DVec3::new(x, y, height)).into()
        });
    }
    mesh
}

/// Whether a point is well inside the outline of a grid.
fn is_inner(target: DVec3, frame: DMat3) -> bool {
    target.dot(frame.x_axis).abs() < 0.9 && target.dot(frame.y_axis).abs() < 0.9
}

fn grazing(angle: f64, random: &mut Random, count: usize) -> Hard {
    aimed(
        grid(&[0.0], FRAME),
        Aim::Everywhere,
        random,
        count,
        |target, _, random| {
            let turn = random.unit() * std::f64::consts::TAU;
            let (up, along) = libm::sincos(angle.min(1.5));
            let (sine, cosine) = libm::sincos(turn);
            let way = FRAME * DVec3::new(cosine * along, sine * along, up);
            is_inner(target, FRAME).then(|| (target + 3.0 * way, 1.0))
        },
    )
}

fn parallel(component: f64, random: &mut Random, count: usize) -> Hard {
    let mesh = grid(&[0.0], DMat3::IDENTITY);
    let mut hard = aimed(mesh, Aim::Everywhere, random, count, |target, _, _| {
        let from = target + DVec3::new(component, -0.5 * component, 1.0);
        is_inner(target, DMat3::IDENTITY).then_some((from, 1.0))
    });
    // A difference of positions cannot be so small.
    for (ray, truth) in &mut hard.rays {
        ray.direction = narrow([-component, 0.5 * component, -1.0]);
        *truth = exact::nearest(&hard.mesh, ray).map(|(_, crossing)| crossing.t);
    }
    hard
}

fn near_start(distance: f64, random: &mut Random, count: usize) -> Hard {
    aimed(
        grid(&[0.0], FRAME),
        Aim::Everywhere,
        random,
        count,
        |target, _, random| {
            let tilt = random.direction();
            let way = normalize(FRAME.z_axis + 0.3 * tilt);
            let from = target + distance * way;
            is_inner(target, FRAME).then_some((from, 1.0 / distance))
        },
    )
}

fn near_end(share: f64, random: &mut Random, count: usize) -> Hard {
    let mut hard = ball(&|p| p, 1.0, 1.0, random, count);
    hard.rays.retain(|(_, truth)| truth.is_some());
    for (number, (ray, truth)) in hard.rays.iter_mut().enumerate() {
        let t = truth.expect("the others are gone");
        let end = if number % 2 == 0 {
            1.0 + share
        } else {
            1.0 - share
        };
        ray.t_max = (t * end) as f32;
        *truth = (t < f64::from(ray.t_max)).then_some(t);
    }
    hard
}

fn layers(gap: f64, random: &mut Random, count: usize) -> Hard {
    // Not in the order in which they are met.
    let heights = [2.0, 0.0, 3.0, 1.0].map(|k| k * gap);
    aimed(
        grid(&heights, FRAME),
        Aim::Everywhere,
        random,
        count,
        |target, _, random| {
            let tilt = random.direction();
            let way = normalize(FRAME.z_axis + 0.3 * tilt);
            let from = target + 2.0 * way;
            is_inner(target, FRAME).then_some((from, 1.0))
        },
    )
}

fn nested(count_of_triangles: f64, random: &mut Random, count: usize) -> Hard {
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for k in 0..count_of_triangles as u32 {
        let size = 0.9f64.powi(k as i32);
        let first = mesh.vertices.len() as u32;
        for [x, y] in [[1.0, 0.1], [-0.6, 0.8], [-0.5, -0.9]] {
            mesh.vertices
                .push(narrow([x * size, y * size, -0.2 * size]));
        }
        mesh.indices.push([first, first + 1, first + 2]);
    }
    aimed(mesh, Aim::Inside, random, count, |target, _, random| {
        let size = target.length();
        let tilt = random.direction();
        let way = normalize([0.4 * tilt[0], 0.4 * tilt[1], -1.0]);
        Some((target + 2.0 * size * way, 1.0))
    })
}

/// The error of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    Missed,
    Invented,
    /// The distance is off by more than [`TOLERANCE`].
    Misplaced,
}

/// How far off a distance may be, of itself.
pub const TOLERANCE: f64 = 1e-4;

/// Holds an answer against the truth.
pub fn fault(found: Option<f32>, truth: Option<f64>) -> Option<Fault> {
    match (found, truth) {
        (None, None) => None,
        (None, Some(_)) => Some(Fault::Missed),
        (Some(_), None) => Some(Fault::Invented),
        (Some(found), Some(truth)) => {
            let off = (f64::from(found) - truth).abs();
            let last_place = f64::from(f32::from_bits(1));
            (off > TOLERANCE * truth.abs() + last_place).then_some(Fault::Misplaced)
        }
    }
}

/// The normal of a triangle, of length 1.
pub fn unit_normal(triangle: &[[f32; 3]; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(wide);
    normalize((b - a).cross(c - a))
}
