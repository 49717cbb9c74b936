//! Where rays meet a mesh, as [`exact`] sees it, but in f64 wherever a bound of its error shows
//! that whole numbers would say the same. They are asked about the rest.
//!
//! Nothing here is shared with the walks that it checks.

use glam::DVec3;

use crate::{Mesh, exact, wide};
use traversal::Ray;

/// A determinant of three vectors in f64 is off by less than this times the product of their
/// lengths.
///
/// Let u = 2⁻⁵³. A vertex less the origin is rounded once, each component by u of itself. So a
/// component of the cross product is off by 4u of the sum of its products' sizes (two factors, one
/// of which was rounded, the product, the difference), the scalar product by 1 + 1 + 2 = 4u more,
/// all in all 8u to first order. The sum of sizes is a permanent of three rows, which is at most 3!
/// / 3^1.5 = 1.155 times the product of their lengths. Lengths are off by 4u of themselves. 1.155 ·
/// 8u = 1.03·10⁻¹⁵; twice that is more than enough. Nothing underflows: products of three numbers
/// of f32 are at least 2⁻⁴⁴⁷, and lengths, whose squares are at least 2⁻²⁹⁸, are as exact.
const CERTAIN: f64 = 2.1e-15;

/// Distances that are certain to this part of themselves need no whole numbers.
const NEAR_ENOUGH: f64 = 1e-9;

/// The hits of a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Met {
    /// Triangles that it crosses after its origin: [`exact::crossings`].
    pub crossings: usize,
    /// How far the first of those is whose inside or rim it meets, to 10⁻⁹: [`exact::nearest`].
    pub nearest: Option<f64>,
    /// Triangles about which whole numbers were asked.
    pub asked: u32,
}

/// A mesh with what does not depend on rays.
pub struct Surface<'a> {
    mesh: &'a Mesh,
    vertices: Vec<DVec3>,
    planes: Vec<[Plane; 4]>,
    /// Per vertex, of the ray at hand.
    seen: Vec<RelativeVertex>,
}

/// Points by how far they are before it.
struct Plane {
    way: DVec3,
    distance: f64,
}

impl Plane {
    fn through(point: DVec3, way: DVec3) -> Plane {
        let way = way.normalize_or_zero();
        Plane {
            way,
            distance: way.dot(point),
        }
    }

    fn before(&self, point: DVec3) -> f64 {
        self.way.dot(point) - self.distance
    }
}

/// A vertex as a ray sees it.
#[derive(Clone, Copy)]
struct RelativeVertex {
    /// From the ray's origin.
    at: DVec3,
    /// The direction × that.
    turned: DVec3,
    length: f64,
}

/// Signs of a triangle's three determinants, as far as f64 is certain.
enum Sides {
    Beside,
    /// All of one sign; their sum, and what that may be off by.
    Inside(f64, f64),
    Unsure,
}

/// The position of a point by f64: inside, outside or uncertain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Containment {
    Inside,
    Outside,
    Unsure,
}

impl<'a> Surface<'a> {
    pub fn new(mesh: &'a Mesh) -> Surface<'a> {
        let planes = (0..mesh.indices.len()).map(|index| {
            let [a, b, c] = mesh.triangle(index).map(wide);
            let normal = (b - a).cross(c - a);
            let rim = |p: DVec3, q: DVec3| Plane::through(p, (q - p).cross(normal));
            [Plane::through(a, normal), rim(a, b), rim(b, c), rim(c, a)]
        });
        Surface {
            vertices: mesh.vertices.iter().map(|&vertex| wide(vertex)).collect(),
            planes: planes.collect(),
            seen: Vec::new(),
            mesh,
        }
    }

    /// Turns to a ray.
    fn look(&mut self, origin: DVec3, direction: DVec3) {
        self.seen.clear();
        self.seen.extend(self.vertices.iter().map(|&vertex| {
            let at = vertex - origin;
            RelativeVertex {
                at,
                turned: direction.cross(at),
                length: at.length(),
            }
        }));
    }

    /// How the ray's line passes a triangle; `length` is the direction's.
    fn sides(&self, corners: &[RelativeVertex; 3], length: f64) -> Sides {
        let [a, b, c] = corners;
        let margin = CERTAIN * length;
        let [mut above, mut below] = [0u32; 2];
        let [mut sum, mut off] = [0.0; 2];
        for (p, q) in [(c, b), (a, c), (b, a)] {
            let edge = p.turned.dot(q.at);
            let margin = margin * p.length * q.length;
            above += u32::from(edge > margin);
            below += u32::from(edge < -margin);
            sum += edge;
            off += margin;
        }
        match (above, below) {
            (1.., 1..) => Sides::Beside,
            (3, 0) | (0, 3) => Sides::Inside(sum, off),
            _ => Sides::Unsure,
        }
    }

    fn corners(&self, index: usize) -> [RelativeVertex; 3] {
        self.mesh.indices[index].map(|i| self.seen[i as usize])
    }

    /// The hits of a finite ray from its origin on, for any interval.
    pub fn intersect(&mut self, ray: &Ray) -> Met {
        let direction = wide(ray.direction);
        self.look(wide(ray.origin), direction);
        let length = direction.length();
        let mut met = Met::default();
        for index in 0..self.mesh.indices.len() {
            let corners = self.corners(index);
            let sides = self.sides(&corners, length);
            if let Sides::Beside = sides {
                continue;
            }
            let (crosses, t) = match self.certainly(&corners, &sides, NEAR_ENOUGH) {
                Some(t) => (t > 0.0, (t > 0.0).then_some(t)),
                None => {
                    met.asked += 1;
                    let triangle = self.mesh.triangle(index);
                    let found = exact::intersect(ray, &triangle).filter(|found| found.t > 0.0);
                    (exact::crosses(ray, &triangle), found.map(|found| found.t))
                }
            };
            met.crossings += usize::from(crosses);
            if let Some(t) = t
                && (t as f32).is_finite()
                && met.nearest.is_none_or(|nearest| t < nearest)
            {
                met.nearest = Some(t);
            }
        }
        met
    }

    /// How far a triangle is that is met, where f64 is certain of that to this part of it.
    fn certainly(&self, corners: &[RelativeVertex; 3], sides: &Sides, enough: f64) -> Option<f64> {
        let Sides::Inside(sum, off) = *sides else {
            return None;
        };
        let [a, b, c] = corners;
        let volume = a.at.dot(b.at.cross(c.at));
        let volume_off = CERTAIN * a.length * b.length * c.length;
        let relative = volume_off / volume.abs() + off / sum.abs();
        // Each of the three is that of its edge backwards, and so is their sum.
        (relative < enough).then_some(-volume / sum)
    }

    /// Where a point is if the mesh is closed: by the crossings of rays, none of which comes near
    /// an edge. Unsure if it is not further from the surface than by this part of how far it is
    /// from the origin of space.
    pub fn place(&mut self, point: DVec3, clear: f64) -> Containment {
        if !self.is_clear(point, clear) {
            return Containment::Unsure;
        }
        const WAYS: [[f64; 3]; 3] = [
            [0.531, 0.622, 0.575],
            [-0.288, 0.713, -0.639],
            [0.913, -0.237, 0.331],
        ];
        let mut ways = WAYS.map(DVec3::from).into_iter();
        let inside = ways.find_map(|way| {
            self.look(point, way);
            let mut inside = false;
            for index in 0..self.mesh.indices.len() {
                let corners = self.corners(index);
                let sides = self.sides(&corners, way.length());
                if let Sides::Beside = sides {
                    continue;
                }
                inside ^= self.certainly(&corners, &sides, 0.5)? > 0.0;
            }
            Some(inside)
        });
        match inside {
            Some(true) => Containment::Inside,
            Some(false) => Containment::Outside,
            None => Containment::Unsure,
        }
    }

    /// Whether a point is further from each triangle than by this part of how far it is from the
    /// origin of space: further from its plane, or outside of an edge.
    pub fn is_clear(&self, point: DVec3, clear: f64) -> bool {
        let least = clear * point.abs().max_element();
        self.planes.iter().all(|[plane, rims @ ..]| {
            let outside = rims.iter().map(|rim| rim.before(point));
            outside.fold(plane.before(point).abs(), f64::max) > least
        })
    }
}
