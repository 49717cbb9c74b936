//! Trees: tapering branches that fork, and cards of leaves at their ends.

use glam::{Affine3A, Mat3, Quat, Vec3};

use super::mesh::Part;
use super::random::Random;

/// The wood and the leaves of one tree, standing at the origin.
pub struct Tree {
    pub wood: Part,
    pub leaves: Part,
}

const TAU: f32 = std::f32::consts::TAU;

/// A turn about a unit axis, by means that round the same everywhere.
fn turn(axis: Vec3, angle: f32) -> Quat {
    let (sine, cosine) = libm::sincosf(0.5 * angle);
    let v = axis * sine;
    Quat::from_xyzw(v.x, v.y, v.z, cosine)
}

/// Some unit vector square to `v`.
fn square_to(v: Vec3) -> Vec3 {
    let other = if v.x.abs() < 0.7 { Vec3::X } else { Vec3::Z };
    v.cross(other).normalize()
}

/// A tapering tube along a path of (centre, radius).
fn tube(wood: &mut Part, path: &[(Vec3, f32)], sides: u32) {
    let first = wood.vertices.len() as u32;
    let mut across = square_to((path[1].0 - path[0].0).normalize());
    let mut along = 0.0;
    for (i, (centre, radius)) in path.iter().enumerate() {
        let next = path[(i + 1).min(path.len() - 1)].0;
        let before = path[i.saturating_sub(1)].0;
        let direction = (next - before).normalize();
        across = (across - direction * direction.dot(across)).normalize();
        let other = direction.cross(across);
        along += (*centre - before).length();
        for side in 0..=sides {
            let share = side as f32 / sides as f32;
            let (sine, cosine) = libm::sincosf(TAU * share);
            let normal = across * cosine + other * sine;
            wood.vertex(
                *centre + normal * *radius,
                normal,
                (share * 2.0, along * 0.7),
            );
        }
    }
    for ring in 0..path.len() as u32 - 1 {
        for side in 0..sides {
            let a = first + ring * (sides + 1) + side;
            wood.quad(a, a + 1, a + sides + 2, a + sides + 1);
        }
    }
}

/// A card of leaves: a square cut from the atlas, one of its four cells.
fn card(leaves: &mut Part, centre: Vec3, right: Vec3, up: Vec3, normal: Vec3, cell: u32) {
    let (u, v) = ((cell & 1) as f32 * 0.5, (cell >> 1 & 1) as f32 * 0.5);
    let corner = |leaves: &mut Part, s: f32, t: f32| {
        let position = centre + right * (s - 0.5) + up * (0.5 - t);
        leaves.vertex(position, normal, (u + 0.5 * s, v + 0.5 * t))
    };
    let a = corner(leaves, 0.0, 0.0);
    let b = corner(leaves, 0.0, 1.0);
    let c = corner(leaves, 1.0, 1.0);
    let d = corner(leaves, 1.0, 0.0);
    leaves.quad(a, b, c, d);
}

struct Broadleaf {
    random: Random,
    tree: Tree,
    crown: Vec3,
}

impl Broadleaf {
    fn branch(&mut self, start: Vec3, direction: Vec3, length: f32, radius: f32, level: u32) {
        let segments = if level == 0 { 6 } else { 4 };
        let mut path = vec![(start, radius * if level == 0 { 1.35 } else { 1.0 })];
        let (mut position, mut direction) = (start, direction);
        for segment in 1..=segments {
            let share = segment as f32 / segments as f32;
            let axis = turn(direction, self.random.between(0.0, TAU)) * square_to(direction);
            direction = turn(axis, self.random.between(-0.22, 0.22)) * direction;
            direction = (direction + Vec3::Y * 0.06).normalize();
            position += direction * (length / segments as f32);
            let end = if level == 3 { 0.25 } else { 0.55 };
            path.push((position, radius * (1.0 - share * (1.0 - end))));
        }
        tube(&mut self.tree.wood, &path, [9, 7, 5, 4][level as usize]);
        if level >= 2 {
            let cards = if level == 3 { 7 } else { 3 };
            for i in 0..cards {
                let along = 0.35 + 0.65 * (i as f32 + self.random.unit()) / cards as f32;
                self.leaf(start.lerp(position, along));
            }
        }
        if level == 3 {
            return;
        }
        let forks = [6, 4, 4][level as usize];
        for fork in 0..forks {
            let share = match level {
                0 => 0.48 + 0.52 * (fork as f32 + 0.5) / forks as f32,
                _ => 0.3 + 0.7 * (fork as f32 + 0.7) / forks as f32,
            };
            let at = share * segments as f32;
            let i = (at as usize).min(path.len() - 2);
            let from = path[i].0.lerp(path[i + 1].0, at - i as f32);
            let here = (path[i + 1].0 - path[i].0).normalize();
            let around = TAU * (fork as f32 * 0.382 + self.random.between(-0.08, 0.08));
            let axis = turn(here, around) * square_to(here);
            let lean = self.random.between(0.55, 0.95);
            let shorter = [0.62, 0.6, 0.55][level as usize] * self.random.between(0.8, 1.15);
            let thinner = path[i].1 * self.random.between(0.45, 0.6);
            self.branch(
                from,
                turn(axis, lean) * here,
                length * shorter,
                thinner,
                level + 1,
            );
        }
    }

    fn leaf(&mut self, at: Vec3) {
        let random = &mut self.random;
        let out = (at - self.crown).normalize_or(Vec3::Y);
        let jitter = Vec3::new(
            random.between(-1.0, 1.0),
            random.between(-0.6, 1.0),
            random.between(-1.0, 1.0),
        );
        let facing = (out + jitter * 0.9).normalize_or(Vec3::Y);
        let right = turn(facing, random.between(0.0, TAU)) * square_to(facing);
        let size = random.between(0.55, 0.95);
        let normal = (out * 0.75 + facing * 0.6).normalize_or(facing);
        let normal = if normal.dot(facing) < 0.0 {
            facing
        } else {
            normal
        };
        let centre = at + jitter * 0.18;
        let cell = random.bits() >> 8;
        let up = facing.cross(right) * size;
        card(
            &mut self.tree.leaves,
            centre,
            right * size,
            up,
            normal,
            cell,
        );
    }
}

/// A broad-leaved tree about 8 m high.
pub fn broadleaf(seed: u32) -> Tree {
    let empty = Tree {
        wood: Part::default(),
        leaves: Part::default(),
    };
    let mut grown = Broadleaf {
        random: Random::new(seed),
        tree: empty,
        crown: Vec3::new(0.0, 4.4, 0.0),
    };
    grown.branch(Vec3::new(0.0, -0.3, 0.0), Vec3::Y, 5.2, 0.24, 0);
    grown.tree
}

/// A conifer about 10 m high: whorls of drooping branches, each a row of needle cards.
pub fn conifer(seed: u32) -> Tree {
    let mut random = Random::new(seed);
    let mut tree = Tree {
        wood: Part::default(),
        leaves: Part::default(),
    };
    let height = 10.0;
    let trunk: Vec<(Vec3, f32)> = (0..=8)
        .map(|i| {
            let share = i as f32 / 8.0;
            let sway = Vec3::new(
                random.between(-0.06, 0.06),
                0.0,
                random.between(-0.06, 0.06),
            );
            let foot = Vec3::Y * (share * height - 0.3);
            (foot + sway * share, 0.2 * (1.0 - share) + 0.015)
        })
        .collect();
    tube(&mut tree.wood, &trunk, 7);
    let whorls = 22;
    for whorl in 0..whorls {
        let share = (whorl as f32 + random.between(0.0, 0.6)) / whorls as f32;
        let y = 1.1 + (height - 1.3) * share;
        let reach = 2.3 * libm::powf(1.0 - share, 0.8) + 0.25;
        let count = 5 + (reach * 1.6) as u32;
        let twist = random.between(0.0, TAU);
        for i in 0..count {
            let angle = twist + TAU * (i as f32 + random.between(-0.25, 0.25)) / count as f32;
            let (sine, cosine) = libm::sincosf(angle);
            let out = Vec3::new(cosine, 0.0, sine);
            let length = reach * random.between(0.8, 1.1);
            let droop = -0.32 + 0.5 * share + random.between(-0.08, 0.08);
            let direction = (out + Vec3::Y * droop).normalize();
            let start = Vec3::Y * y;
            let end = start + direction * length;
            tube(&mut tree.wood, &[(start, 0.03), (end, 0.008)], 3);
            let pieces = 1 + (length * 1.5) as u32;
            for piece in 0..pieces {
                let along = (piece as f32 + 0.75) / pieces as f32;
                let centre = start + direction * (length * along);
                let wide = 0.95 * (1.15 - 0.55 * along) * reach.sqrt() * 0.8;
                let side = direction.cross(Vec3::Y).normalize();
                let tilt = turn(direction, random.between(-0.5, 0.5));
                let long = length / pieces as f32 * 1.9;
                let normal = (tilt * side.cross(direction) + out * 0.5).normalize();
                let cell = random.bits() >> 8;
                card(
                    &mut tree.leaves,
                    centre,
                    tilt * side * wide,
                    direction * long,
                    normal,
                    cell,
                );
            }
        }
    }
    tree
}

/// A tuft of grass blades over about two metres of ground.
pub fn grass_tuft(seed: u32, blades: u32) -> Part {
    let mut random = Random::new(seed);
    let mut part = Part::default();
    for _ in 0..blades {
        let (r, angle) = (random.unit().sqrt() * 1.15, random.between(0.0, TAU));
        let (sine, cosine) = libm::sincosf(angle);
        let foot = Vec3::new(r * cosine, -0.03, r * sine);
        let (sine, cosine) = libm::sincosf(random.between(0.0, TAU));
        let lean = Vec3::new(cosine, 0.0, sine);
        let side = Vec3::new(-sine, 0.0, cosine) * random.between(0.006, 0.011);
        let height = random.between(0.10, 0.27) * (1.1 - 0.4 * r);
        let bend = random.between(0.02, 0.13);
        let middle = foot + Vec3::Y * (height * 0.6) + lean * (bend * 0.35);
        let tip = foot + Vec3::Y * height + lean * bend;
        let normal = (Vec3::Y * 0.8 + lean * -0.5).normalize();
        let shade = random.unit();
        let a = part.vertex(foot - side, normal, (shade, 0.98));
        let b = part.vertex(foot + side, normal, (shade, 0.98));
        let c = part.vertex(middle + side * 0.8, normal, (shade, 0.5));
        let d = part.vertex(middle - side * 0.8, normal, (shade, 0.5));
        let e = part.vertex(tip, normal, (shade, 0.02));
        part.quad(a, b, c, d);
        part.triangle(d, c, e);
    }
    part
}

/// A place, a turn about the vertical and a size.
pub fn upright_transform(position: Vec3, angle: f32, size: Vec3) -> Affine3A {
    let rotation = Mat3::from_quat(turn(Vec3::Y, angle));
    Affine3A::from_mat3_translation(rotation * Mat3::from_diagonal(size), position)
}
