//! Meshes that reach far or are thin.

use crate::*;

fn mesh(vertices: &[[f64; 3]], faces: &[Vec<u32>]) -> Mesh {
    let mut mesh = Mesh {
        vertices: vertices.iter().map(|&v| narrow(v)).collect(),
        indices: Vec::new(),
        opaque: true,
    };
    for face in faces {
        for i in 1..face.len() - 1 {
            mesh.indices.push([face[0], face[i], face[i + 1]]);
        }
    }
    mesh
}

/// A box with a corner at the origin.
pub fn cuboid(size: [f64; 3]) -> Mesh {
    let corner = |k: u32| std::array::from_fn(|i| f64::from(k >> i & 1) * size[i]);
    let vertices: Vec<[f64; 3]> = (0..8).map(corner).collect();
    let faces = ["0231", "4576", "0154", "2673", "0462", "1375"]
        .map(|face| face.bytes().map(|b| u32::from(b - b'0')).collect());
    mesh(&vertices, &faces)
}

pub(super) fn circle(sides: u32, radius: f64) -> Vec<[f64; 2]> {
    let angle = |i: u32| f64::from(i) / f64::from(sides) * std::f64::consts::TAU + 0.3;
    (0..sides)
        .map(|i| libm::sincos(angle(i)))
        .map(|(sine, cosine)| [radius * cosine, radius * sine])
        .collect()
}

/// A prism along z over a polygon all of which is seen from its first corner.
pub(super) fn prism(corners: &[[f64; 2]], length: f64) -> Mesh {
    let sides = corners.len() as u32;
    let at = |z: f64| corners.iter().map(move |&[x, y]| [x, y, z]);
    let vertices: Vec<_> = at(0.0).chain(at(length)).collect();
    let mut faces = vec![(0..sides).collect::<Vec<_>>(), (sides..2 * sides).collect()];
    faces.extend((0..sides).map(|i| {
        let next = (i + 1) % sides;
        vec![i, next, sides + next, sides + i]
    }));
    mesh(&vertices, &faces)
}

/// A tetrahedron with a corner at the origin.
pub(super) fn tetrahedron([a, b, c]: [[f64; 3]; 3]) -> Mesh {
    let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    mesh(&[[0.0; 3], a, b, c], &faces.map(Vec::from))
}

/// A circle, and a fan of triangles to a point at either side.
pub(super) fn spindle(sides: u32, radius: f64, length: f64) -> Mesh {
    let rim = circle(sides, radius);
    let mut vertices: Vec<_> = rim.into_iter().map(|[x, y]| [x, y, 0.0]).collect();
    vertices.extend([[0.0, 0.0, length], [0.0, 0.0, -length]]);
    let ends = [sides, sides + 1];
    let fan = |i: u32| ends.map(|end| vec![i, (i + 1) % sides, end]);
    let faces: Vec<_> = (0..sides).flat_map(fan).collect();
    mesh(&vertices, &faces)
}

/// Ground of strips side by side, and a flat bottom below.
pub(super) fn terrain(strips: u32, length: f64) -> Mesh {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let points = strips + 1;
    let mut vertices = Vec::new();
    for is_top in [true, false] {
        for y in [0.0, length] {
            let mut x = 0.0;
            for _ in 0..points {
                let height = if is_top { random.unit() } else { -2.0 };
                vertices.push([x, y, height]);
                x += 0.75;
            }
        }
    }
    let at = |below: u32, far: u32, i: u32| (2 * below + far) * points + i;
    let mut faces = Vec::new();
    for i in 0..strips {
        for below in [0, 1] {
            let [a, b] = [at(below, 0, i), at(below, 0, i + 1)];
            let [c, d] = [at(below, 1, i), at(below, 1, i + 1)];
            faces.extend([vec![a, b, d], vec![a, d, c]]);
        }
        for far in [0, 1] {
            let [a, b] = [at(0, far, i), at(0, far, i + 1)];
            let [c, d] = [at(1, far, i), at(1, far, i + 1)];
            faces.extend([vec![a, b, d], vec![a, d, c]]);
        }
    }
    for i in [0, strips] {
        faces.push(vec![at(0, 0, i), at(0, 1, i), at(1, 1, i), at(1, 0, i)]);
    }
    mesh(&vertices, &faces)
}

/// A ball of 80 faces, every third point of which is drawn out into a spike.
pub(super) fn star(length: f64) -> Mesh {
    let (points, indices) = icosphere(1);
    let out = |(i, point): (usize, DVec3)| narrow(point * if i % 3 == 0 { length } else { 0.5 });
    Mesh {
        vertices: points.into_iter().enumerate().map(out).collect(),
        indices,
        opaque: true,
    }
}

/// A grid of quads, closed in its first direction; the faces.
fn grid(around: u32, rows: u32, is_closed: bool) -> Vec<Vec<u32>> {
    let at = |row: u32, i: u32| row % rows * around + i % around;
    let quad = |row: u32, i: u32| {
        let corners = [(0, 0), (0, 1), (1, 1), (1, 0)];
        corners
            .map(|(down, right)| at(row + down, i + right))
            .into()
    };
    let last = if is_closed { rows } else { rows - 1 };
    (0..last)
        .flat_map(|row| (0..around).map(move |i| (row, i)))
        .map(|(row, i)| quad(row, i))
        .collect()
}

/// A torus by its numbers of faces and its radii, around the axis and around the tube.
pub(super) fn torus([around, tube]: [u32; 2], [radius, thickness]: [f64; 2]) -> Mesh {
    let turns = circle(around, 1.0);
    let vertices: Vec<_> = circle(tube, thickness)
        .into_iter()
        .flat_map(|[out, up]| {
            let turns = turns.clone().into_iter();
            turns.map(move |[x, y]| [(radius + out) * x, (radius + out) * y, up])
        })
        .collect();
    mesh(&vertices, &grid(around, tube, true))
}

/// A cylinder of so many sides and so high, whose rows are turned by half a side each (Schwarz):
/// the flatter, the more its faces are folded.
pub(super) fn lantern(sides: u32, rows: u32, height: f64) -> Mesh {
    let mut vertices = Vec::new();
    for row in 0..rows {
        let turn = std::f64::consts::PI / f64::from(sides) * f64::from(row % 2);
        let z = height * f64::from(row) / f64::from(rows - 1);
        let place = |[x, y]: [f64; 2]| {
            let (sin, cos) = libm::sincos(turn);
            [cos * x - sin * y, sin * x + cos * y, z]
        };
        vertices.extend(circle(sides, 1.0).into_iter().map(place));
    }
    let mut faces = Vec::new();
    for (i, quad) in grid(sides, rows, false).into_iter().enumerate() {
        let [a, b, c, d] = quad[..] else {
            unreachable!("it has four corners")
        };
        // Rows that are turned have their points half a side on.
        faces.extend(match i as u32 / sides % 2 {
            0 => [vec![a, b, d], vec![b, c, d]],
            _ => [vec![a, b, c], vec![a, c, d]],
        });
    }
    for end in [0, rows - 1] {
        faces.push((end * sides..(end + 1) * sides).collect());
    }
    mesh(&vertices, &faces)
}
