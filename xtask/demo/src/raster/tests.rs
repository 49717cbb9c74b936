//! Rasterization and rays see the same: at each pixel's centre the same primitive, but where the
//! centre lies on an edge, or two surfaces at the same depth.
//!
//! Which of the two is right where they differ is computed in 64 bits, whose error is far below the
//! bounds.

use ash::vk;
use glam::{DMat3, DVec2, DVec3, Vec3};

use super::{Drawing, Rasterizer, SEEN};
use crate::render::{self, BOUNCES, DeviceScene, Renderer, Settings};
use crate::scene::{Model, Scene};
use crate::vulkan::{Context, Wish};

const SIZE: (u32, u32) = (640, 360);

/// Vertices are snapped to 1/256 of a pixel, that is, by up to √2/512; the rest is for the rounding
/// of `f32` on the way there.
const SNAPPING: f64 = 1.0 / 256.0;

/// Of all pixels. An edge passes a pixel's centre within the snapping distance in 2/256 of the
/// cases for each edge that crosses the pixel, if it is moved that far; most are moved less, and
/// most pixels have none.
const MAX_SHARE: f64 = 0.003;

/// The object at a pixel's centre: an instance's number plus one, a geometry or procedural
/// primitive, a primitive; and the bits of a depth (rasterized) or of a distance (traced).
type PixelObject = [u32; 4];

/// The camera that the shaders have.
struct Eye {
    position: DVec3,
    /// From a direction to the picture: right, down, forward.
    to_picture: DMat3,
}

impl Eye {
    fn new(scene: &Scene, settings: Settings) -> Eye {
        let [position, right, up, forward] =
            render::view(&scene.camera, (settings.width, settings.height)).map(Vec3::as_dvec3);
        Eye {
            position,
            to_picture: DMat3::from_cols(right, -up, forward).inverse(),
        }
    }

    /// A point's place in pixels, times its distance along the view's axis, which is the third
    /// component.
    fn see(&self, point: DVec3) -> DVec3 {
        let p = self.to_picture * (point - self.position);
        let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
        DVec3::new(0.5 * width * (p.x + p.z), 0.5 * height * (p.y + p.z), p.z)
    }
}

/// A triangle in the picture.
struct PictureTriangle([DVec3; 3]);

impl PictureTriangle {
    fn of(scene: &Scene, eye: &Eye, seen: PixelObject) -> Option<PictureTriangle> {
        let instance = &scene.instances[seen[0] as usize - 1];
        let Model::Mesh(_) = instance.model else {
            return None;
        };
        let geometry = &scene.geometries[seen[1] as usize];
        let first = (geometry.first_index + 3 * seen[2]) as usize;
        let m = instance.transform.matrix3;
        let turn = DMat3::from_cols(
            Vec3::from(m.x_axis).as_dvec3(),
            Vec3::from(m.y_axis).as_dvec3(),
            Vec3::from(m.z_axis).as_dvec3(),
        );
        let shift = Vec3::from(instance.transform.translation).as_dvec3();
        Some(PictureTriangle(std::array::from_fn(|i| {
            let vertex = geometry.first_vertex + scene.indices[first + i];
            let position = scene.vertices[vertex as usize].position.as_dvec3();
            eye.see(turn * position + shift)
        })))
    }

    /// How far a place is from the nearest edge, in pixels, and whether it is inside.
    fn edges(&self, at: DVec2) -> (f64, bool) {
        let [a, b, c] = self.0;
        let turn = a.dot(b.cross(c)).signum();
        let (mut nearest, mut inside) = (f64::INFINITY, true);
        for (a, b) in [(a, b), (b, c), (c, a)] {
            let line = a.cross(b);
            let off = line.dot(at.extend(1.0)) / line.truncate().length();
            inside &= off * turn > 0.0;
            let distance = if a.z > 0.0 && b.z > 0.0 {
                let (a, b) = (a.truncate() / a.z, b.truncate() / b.z);
                let along = (at - a).dot(b - a) / (b - a).length_squared();
                at.distance(a + (b - a) * along.clamp(0.0, 1.0))
            } else {
                off.abs()
            };
            nearest = nearest.min(distance);
        }
        (nearest, inside)
    }

    /// One over the distance along the view's axis at a place, and by how much snapping can move
    /// that.
    fn nearness(&self, at: DVec2) -> (f64, f64) {
        let [a, b, c] = self.0;
        let plane = DMat3::from_cols(a, b, c).transpose().inverse() * DVec3::ONE;
        (
            plane.dot(at.extend(1.0)),
            plane.truncate().length() * SNAPPING,
        )
    }
}

/// The reason why either of two primitives may be seen at a place, or the fault.
fn excuse(
    scene: &Scene,
    eye: &Eye,
    at: DVec2,
    drawn: PixelObject,
    traced: PixelObject,
) -> Result<f64, String> {
    let mut on_edge: Option<f64> = None;
    let mut depths = Vec::new();
    for (seen, who) in [(drawn, "rasterization"), (traced, "the ray")] {
        let Some(triangle) = (seen[0] != 0)
            .then(|| PictureTriangle::of(scene, eye, seen))
            .flatten()
        else {
            continue;
        };
        let (distance, inside) = triangle.edges(at);
        if distance <= SNAPPING {
            on_edge = Some(on_edge.map_or(distance, |other| other.min(distance)));
        } else if !inside {
            return Err(format!("{who} is {distance} pixels beside its triangle"));
        }
        depths.push(triangle.nearness(at));
    }
    if let Some(distance) = on_edge {
        return Ok(distance);
    }
    if let [(a, a_moves), (b, b_moves)] = depths[..] {
        // Both round their distances.
        let rounding = 16.0 * f64::from(f32::EPSILON) * a.max(b);
        if (a - b).abs() <= a_moves + b_moves + rounding {
            return Ok(0.0);
        }
    }
    Err(format!("depths {depths:?}"))
}

#[test]
fn rasterization_and_rays_have_the_same_silhouettes() {
    let scene = Scene::landscape();
    let wish = Wish {
        draws: true,
        ..Default::default()
    };
    let context = Context::new(None, wish).expect("a device that draws and traces");
    let (width, height) = SIZE;
    let settings = Settings {
        width,
        height,
        first_row: 0,
        rows: height,
        first_column: 0,
        spp: 1,
        bounces: BOUNCES,
        frame: 0,
    };
    let set_layout = render::set_layout(&context, scene.textures.len() as u32).unwrap();
    let pipeline = render::seen_pipeline(&context, set_layout).unwrap();
    let world = DeviceScene::new(&context, set_layout, &scene).unwrap();
    let renderer = Renderer::new(&world, &pipeline, &scene, &scene.camera, settings).unwrap();
    let rasterizer = Rasterizer::new(&world, &scene).unwrap();
    let drawing = Drawing::new(&rasterizer, &renderer).unwrap();
    let traced = renderer.render(|_| ()).unwrap().radiance;
    let traced: &[PixelObject] = bytemuck::cast_slice(&traced);
    let area = vk::Rect2D::default().extent(vk::Extent2D { width, height });
    let drawn: Vec<PixelObject> = drawing.seen(area).unwrap();
    assert_eq!(SEEN, vk::Format::R32G32B32A32_UINT);

    let eye = Eye::new(&scene, settings);
    let (mut differ, mut farthest, mut wrong) = (0, 0.0, Vec::new());
    for (index, (drawn, traced)) in drawn.iter().zip(traced).enumerate() {
        if drawn[..3] == traced[..3] {
            continue;
        }
        differ += 1;
        let (x, y) = (index as u32 % width, index as u32 / width);
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        match excuse(&scene, &eye, at, *drawn, *traced) {
            Ok(distance) => farthest = distance.max(farthest),
            Err(why) => wrong.push(format!("({x}, {y}): {drawn:?}, {traced:?}: {why}")),
        }
    }
    let sky = |seen: &[PixelObject]| seen.iter().filter(|seen| seen[0] == 0).count();
    println!(
        "{differ} of {} pixels differ, at most {farthest:.5} pixels from an edge; sky: {} and {}",
        drawn.len(),
        sky(&drawn),
        sky(traced)
    );
    assert!(
        wrong.is_empty(),
        "{} pixels: {:#?}",
        wrong.len(),
        &wrong[..wrong.len().min(20)]
    );
    assert!(f64::from(differ) < MAX_SHARE * drawn.len() as f64);
    // The sky is seen, and so are sculptures, trees and the meadow.
    let share = sky(&drawn) as f64 / drawn.len() as f64;
    assert!((0.05..0.6).contains(&share), "{share}");
    drop(drawing);
    drop(rasterizer);
    drop(renderer);
    drop(world);
    drop(pipeline);
    // SAFETY: the pipelines and the sets that were made of it are gone.
    unsafe {
        context
            .device
            .destroy_descriptor_set_layout(set_layout, None)
    };
}
