//! Attachments in memory, chunks of triangles, and numbers by chance.

use std::sync::Arc;

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::ir::text::parse_module;
use spirv_jit::reach::Reach;

use crate::object::Image;
use crate::object::graphics_state::{GraphicsState, MAX_VERTEX_INPUTS};
use crate::raster::primitive::{Bins, Bounds, Coverage, Edge, Grid, PlaneEquation, Record, Shape};
use crate::raster::tile::Tiles;
use crate::raster::{Chunk, Context, Counters, Draw, Stages, Target, Targets, VertexBuffer, Work};
use crate::transfer::surface::Surface;
use crate::wave::{Limits, Stopped, Workers};
pub use fastrand::Rng as Random;

pub const COMPARE: [vk::CompareOp; 8] = [
    vk::CompareOp::NEVER,
    vk::CompareOp::LESS,
    vk::CompareOp::EQUAL,
    vk::CompareOp::LESS_OR_EQUAL,
    vk::CompareOp::GREATER,
    vk::CompareOp::NOT_EQUAL,
    vk::CompareOp::GREATER_OR_EQUAL,
    vk::CompareOp::ALWAYS,
];

/// An image with its memory, all zeros.
pub struct Canvas {
    pub image: Image,
    _memory: Vec<u128>,
}

impl Canvas {
    pub fn new(format: vk::Format, width: u32, height: u32, layers: u32, samples: u32) -> Self {
        let image = Image::new(&vk::ImageCreateInfo {
            image_type: vk::ImageType::TYPE_2D,
            format,
            extent: vk::Extent3D {
                width,
                height,
                depth: 1,
            },
            mip_levels: 1,
            array_layers: layers,
            samples: vk::SampleCountFlags::from_raw(samples),
            ..Default::default()
        })
        .expect("a format that there is");
        let mut memory = vec![0u128; image.size_bytes as usize / 16 + 1];
        image.bind(memory.as_mut_ptr() as u64);
        Self {
            image,
            _memory: memory,
        }
    }

    pub fn target(&self, aspect: vk::ImageAspectFlags) -> Target {
        Target {
            surface: Surface::new(&self.image, aspect, 0).expect("a bound image"),
            first_layer: 0,
            layers: self.image.array_layers,
        }
    }

    /// A texel's words.
    pub fn texel(&self, aspect: vk::ImageAspectFlags, [x, y, layer, sample]: [u32; 4]) -> [u32; 4] {
        let surface = self.target(aspect).surface;
        let texel = surface.texel(x, y, layer, sample);
        // SAFETY: a texel of the image.
        let bytes = unsafe { std::slice::from_raw_parts(texel, surface.texel_size_bytes) };
        surface.format.decode(bytes)
    }

    pub fn set(&self, aspect: vk::ImageAspectFlags, place: [u32; 4], words: [u32; 4]) {
        let surface = self.target(aspect).surface;
        let texel = surface.texel(place[0], place[1], place[2], place[3]);
        // SAFETY: a texel of the image.
        let bytes = unsafe { std::slice::from_raw_parts_mut(texel, surface.texel_size_bytes) };
        surface.format.encode(words, bytes);
    }

    /// All its memory.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: the memory is that of the image.
        unsafe { std::slice::from_raw_parts(self.image.data(), self.image.size_bytes as usize) }
    }
}

/// Attachments of one size.
pub fn targets(color: Option<&Canvas>, depth_stencil: Option<&Canvas>) -> Targets {
    let image = &color.or(depth_stencil).expect("an attachment").image;
    let mut colors = [None; 8];
    colors[0] = color.map(|canvas| canvas.target(vk::ImageAspectFlags::COLOR));
    let side = |aspect| {
        let canvas = depth_stencil?;
        let plane = canvas.image.planes.iter().find(|it| it.aspect == aspect);
        plane.map(|_| canvas.target(aspect))
    };
    Targets {
        clamps_to_one: false,
        area: vk::Rect2D {
            offset: vk::Offset2D { x: 0, y: 0 },
            extent: vk::Extent2D {
                width: image.extent.width,
                height: image.extent.height,
            },
        },
        layers: image.array_layers,
        view_mask: 0,
        samples: image.samples,
        colors,
        depth: side(vk::ImageAspectFlags::DEPTH),
        stencil: side(vk::ImageAspectFlags::STENCIL),
        rates: None,
    }
}

/// A program from the IR's text.
pub fn program(text: &str) -> Arc<Program> {
    Arc::new(Program::new(&parse_module(text).expect("text")).expect("a program"))
}

/// A vertex program that leaves four words of location 0; it is never run.
pub fn vertex_program() -> Arc<Program> {
    program(
        "module vertex
        output_rows 4
        outputs location.0.0.0, location.0.1.0, location.0.2.0, location.0.3.0
        func f0 {
            v0: i32 = const 0
            end(v0, v0, v0, v0)
        }",
    )
}

/// The rows of two locations, of which tests have an attachment for the first alone: as programs do
/// that compilers of OpenGL make of `gl_FragColor`.
fn two_locations() -> String {
    let row = |it: usize| format!("location.{}.{}.0", it / 4, it % 4);
    (0..8).map(row).collect::<Vec<String>>().join(", ")
}

/// A fragment program that passes location 0 on, flat or smooth, and leaves other words to the
/// location behind it.
pub fn pass_on(mode: &str) -> Arc<Program> {
    let rows = [0, 1, 2, 3].map(|it| format!("varying.0.{it}.{mode}"));
    program(&format!(
        "module fragment
        inputs {}
        output_rows 8
        outputs {}
        fragment colors.1
        func f0 {{
            v0: i32 = input[0]
            v1: i32 = input[1]
            v2: i32 = input[2]
            v3: i32 = input[3]
            end(v0, v1, v2, v3, v1, v2, v3, v0)
        }}",
        rows.join(", "),
        two_locations(),
    ))
}

/// A fragment program that leaves the same, with some work.
pub fn halve_and_double(mode: &str) -> Arc<Program> {
    let rows = [0, 1, 2, 3].map(|it| format!("varying.0.{it}.{mode}"));
    let mut work = String::new();
    for it in 0..20i32 {
        let (value, before) = (it + 2, it - 2);
        work += &match it / 4 {
            0 => format!("v{value}: i32 = input[{it}]\n"),
            1 => format!("v{value}: f32 = bitcast v{before}\n"),
            2 => format!("v{value}: f32 = fmul v{before}, v0\n"),
            3 => format!("v{value}: f32 = fmul v{before}, v1\n"),
            _ => format!("v{value}: i32 = bitcast v{before}\n"),
        };
    }
    program(&format!(
        "module fragment
        inputs {}
        output_rows 8
        outputs {}
        fragment colors.1
        func f0 {{
            v0: f32 = const 0x3f000000
            v1: f32 = const 0x40000000
            {}
            end(v18, v19, v20, v21, v19, v20, v21, v18)
        }}",
        rows.join(", "),
        two_locations(),
        work
    ))
}

/// A draw with a state.
pub fn draw(state: GraphicsState, fragment: Option<Arc<Program>>) -> Draw {
    Draw {
        stages: Arc::new(Stages::from_iter(
            [vertex_program()].into_iter().chain(fragment),
        )),
        state: Arc::new(state),
        environment: Arc::new(Environment {
            number: Environment::next_number(),
            ..Environment::unbound()
        }),
        keep: Arc::new(()),
        vertex_buffers: Arc::new([VertexBuffer::default(); MAX_VERTEX_INPUTS]),
        indices: None,
        calls: SmallVec::new(),
        counters: SmallVec::from_iter([Arc::new(Counters::default())]),
        feedback: None,
    }
}

/// A triangle: its corners in 1/256 pixel, a depth and a colour.
#[derive(Clone, Copy)]
pub struct Triangle {
    pub corners: [[i32; 2]; 3],
    pub depth: f32,
    pub color: [u32; 4],
    pub front: bool,
}

impl Triangle {
    /// One that covers all of an image.
    pub fn everywhere(depth: f32, color: [u32; 4]) -> Self {
        Self {
            corners: [[-256, -256], [1 << 21, -256], [-256, 1 << 21]],
            depth,
            color,
            front: true,
        }
    }
}

/// The edges of a triangle, whatever way round it goes: inside is where none is negative; of two
/// triangles that share an edge, one holds it.
pub fn edges(corners: [[i32; 2]; 3]) -> [Edge; 4] {
    let [p, q, r] = corners.map(|corner| corner.map(i64::from));
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let order = if area > 0 { [p, q, r] } else { [p, r, q] };
    let mut edges = [Edge::default(); 4];
    for index in 0..3 {
        let (from, to) = (order[index], order[(index + 1) % 3]);
        let (a, b) = (from[1] - to[1], to[0] - from[0]);
        let is_top_or_left = a > 0 || (a == 0 && b > 0);
        edges[index] = Edge {
            a: a as i32,
            b: b as i32,
            c: -(a * from[0] + b * from[1]) - i64::from(!is_top_or_left),
        };
    }
    edges
}

/// A chunk of triangles of one draw; the bounds are those of all tiles.
pub fn chunk(draw: u32, targets: &Targets, triangles: &[Triangle]) -> Chunk {
    let mut chunk = Chunk::default();
    let extent = targets.area.extent;
    let whole = Bounds {
        left: 0,
        top: 0,
        right: extent.width as i32,
        bottom: extent.height as i32,
    };
    for triangle in triangles {
        let first = chunk.outputs.len() as u32;
        chunk.outputs.extend(triangle.color);
        let flat = |at| PlaneEquation {
            at,
            dx: 0.0,
            dy: 0.0,
        };
        chunk.shapes.push(Shape {
            record: chunk.records.len() as u32,
            coverage: Coverage::Triangle(triangle.corners),
            bounds: whole,
        });
        chunk.records.push(Record {
            draw,
            primitive_id: chunk.records.len() as u32,
            layer: 0,
            view_index: 0,
            viewport: 0,
            front: triangle.front,
            vertices: [first; 3],
            provoking: 0,
            words: 0,
            origin: [0, 0],
            depth: flat(triangle.depth),
            perspective: [flat(1.0), flat(0.0), flat(0.0)],
            is_affine: false,
            linear: chunk.linear.len() as u32,
            extra: u32::MAX,
        });
        chunk.linear.push([flat(1.0), flat(0.0), flat(0.0)]);
    }
    chunk.bins = bins(targets, chunk.shapes.len());
    chunk
}

/// Corners, depth, the linear coordinates of the second and third vertex, their origin, and the
/// vertices' words of location 0.
pub type Sloped = (
    [[i32; 2]; 3],
    PlaneEquation,
    [PlaneEquation; 2],
    [i16; 2],
    [[u32; 4]; 3],
);

/// A chunk of triangles with slopes, of one draw.
pub fn chunk_of(draw: u32, targets: &Targets, shapes: impl Iterator<Item = Sloped>) -> Chunk {
    let mut whole = Chunk::default();
    for (corners, depth, linear, origin, words) in shapes {
        let mut one = chunk(draw, targets, &[Triangle::everywhere(0.0, [0; 4])]);
        let first = whole.outputs.len() as u32;
        whole.outputs.extend(words.into_iter().flatten());
        let (mut shape, mut record) = (one.shapes.remove(0), one.records.remove(0));
        shape.coverage = Coverage::Triangle(corners);
        shape.record = whole.records.len() as u32;
        let area = &targets.area;
        shape.bounds.left = area.offset.x;
        shape.bounds.top = area.offset.y;
        shape.bounds.right = area.offset.x + area.extent.width as i32;
        shape.bounds.bottom = area.offset.y + area.extent.height as i32;
        record.vertices = [first, first + 4, first + 8];
        record.depth = depth;
        record.origin = origin;
        record.linear = whole.linear.len() as u32;
        whole
            .linear
            .push([PlaneEquation::default(), linear[0], linear[1]]);
        whole.shapes.push(shape);
        whole.records.push(record);
    }
    whole.bins = bins(targets, whole.shapes.len());
    whole
}

/// All shapes in all tiles.
pub fn bins(targets: &Targets, shapes: usize) -> Bins {
    let tiles = Grid::of(&targets.area).len();
    Bins {
        starts: (0..=tiles).map(|tile| (tile * shapes) as u32).collect(),
        shapes: (0..tiles).flat_map(|_| 0..shapes as u32).collect(),
    }
}

/// Works chunks off.
pub fn run(threads: usize, targets: &Targets, work: &[Work], chunks: &[Chunk]) {
    let result = run_within(&Limits::default(), threads, targets, work, chunks);
    assert_eq!(result, Ok(()));
}

/// Works chunks off as far as limits allow.
pub fn run_within(
    limits: &Limits,
    threads: usize,
    targets: &Targets,
    work: &[Work],
    chunks: &[Chunk],
) -> Result<(), Stopped> {
    let workers = Workers::new(threads);
    let context = Context {
        workers: &workers,
        limits,
        reach: &Reach::default(),
        counts: None,
    };
    Tiles::default().run(context, targets, work, chunks, 0)
}
