//! Each large allocation of the driver fails once: whatever is sized by the application ends in an
//! error or a lost device, and the process lives.
//!
//! The C library's allocator is wrapped for this whole program. A first process draws, traces,
//! builds and computes, and says from which places of the driver it was asked for large blocks.
//! Then each place has a process of its own, in which the first such block is refused. Vulkan
//! leaves open what a driver can bear (most would end the process), so this test looks only at
//! Tuff.
#![cfg(unix)]

use std::collections::BTreeSet;
use std::ffi::{CStr, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use tuff_tests::*;

/// Bytes from which on a block counts as large: what is smaller is a worker's table of constant
/// size, or bounded by the objects that an application keeps (docs/security.md has the list).
const LARGE: usize = 128 << 10;

/// Says what a process of this test is to do: which place is refused, or none.
const PLACE: &str = "TUFF_TESTS_NO_MEMORY";

unsafe extern "C" {
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_calloc(count: usize, size: usize) -> *mut c_void;
    fn __libc_realloc(old: *mut c_void, size: usize) -> *mut c_void;
    fn __libc_memalign(alignment: usize, size: usize) -> *mut c_void;
    fn backtrace(frames: *mut *mut c_void, count: c_int) -> c_int;
    fn backtrace_symbols_fd(frames: *const *mut c_void, count: c_int, file: c_int);
}

/// Where the driver lies; nothing is watched as long as it is nowhere.
static DRIVER: [AtomicUsize; 2] = [const { AtomicUsize::new(0) }; 2];
/// The place that is refused, until it was.
static REFUSED: AtomicU64 = AtomicU64::new(0);
/// Whether places are said.
static SAYS: AtomicBool = AtomicBool::new(false);

/// The frames of the driver that a place is known by: more would tell the branches of a recursion
/// apart.
const DEPTH: usize = 5;

/// True for a block that the driver asks for and does not get.
fn is_refused(size: usize) -> bool {
    if size < LARGE {
        return false;
    }
    let [start, end] = DRIVER.each_ref().map(|at| at.load(Ordering::Relaxed));
    if start == end {
        return false;
    }
    let mut frames = [std::ptr::null_mut(); 40];
    // SAFETY: there is room for as many frames.
    let count = unsafe { backtrace(frames.as_mut_ptr(), frames.len() as c_int) };
    let mut place = 0u64;
    let mut depth = 0;
    for frame in &frames[..count as usize] {
        let at = *frame as usize;
        if (start..end).contains(&at) && depth < DEPTH {
            place =
                (place.rotate_left(7) ^ (at - start) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            depth += 1;
        }
    }
    if depth == 0 {
        return false;
    }
    if SAYS.load(Ordering::Relaxed) {
        let text = format!("place {place}\n");
        // SAFETY: the text is as long as it says.
        unsafe { libc::write(1, text.as_ptr().cast(), text.len()) };
        return false;
    }
    let refused =
        (REFUSED.compare_exchange(place, 0, Ordering::Relaxed, Ordering::Relaxed)).is_ok();
    if refused {
        // SAFETY: the frames were written.
        unsafe { backtrace_symbols_fd(frames.as_ptr(), count, 2) };
    }
    refused
}

/// The blocks that the text of a place is made of are small, so that it does not come back here.
macro_rules! allocator {
    ($($name:ident($($argument:ident: $ty:ty),*) $size:expr => $call:expr;)*) => {$(
        #[unsafe(no_mangle)]
        extern "C" fn $name($($argument: $ty),*) -> *mut c_void {
            match is_refused($size) {
                true => std::ptr::null_mut(),
                // SAFETY: the caller keeps the C library's contract.
                false => unsafe { $call },
            }
        }
    )*};
}

allocator! {
    malloc(size: usize) size => __libc_malloc(size);
    calloc(count: usize, size: usize) count.saturating_mul(size) => __libc_calloc(count, size);
    realloc(old: *mut c_void, size: usize) size => __libc_realloc(old, size);
    memalign(alignment: usize, size: usize) size => __libc_memalign(alignment, size);
    aligned_alloc(alignment: usize, size: usize) size => __libc_memalign(alignment, size);
}

#[unsafe(no_mangle)]
extern "C" fn posix_memalign(to: *mut *mut c_void, alignment: usize, size: usize) -> c_int {
    let block = match is_refused(size) {
        true => std::ptr::null_mut(),
        // SAFETY: the caller keeps the C library's contract.
        false => unsafe { __libc_memalign(alignment, size) },
    };
    if block.is_null() {
        return libc::ENOMEM;
    }
    // SAFETY: the caller keeps the C library's contract.
    unsafe { to.write(block) };
    0
}

/// Watches the driver of a device from now on.
fn watch(gpu: &Gpu) {
    let function = gpu.device.fp_v1_0().create_buffer as *const c_void;
    // SAFETY: null pointers are values of the structure.
    let mut info = unsafe { std::mem::zeroed::<libc::Dl_info>() };
    // SAFETY: the function lies in the driver; the name lives as long as the driver is loaded.
    let path = unsafe {
        assert!(
            libc::dladdr(function, &mut info) != 0,
            "the driver is loaded"
        );
        CStr::from_ptr(info.dli_fname)
            .to_string_lossy()
            .into_owned()
    };
    let maps = std::fs::read_to_string("/proc/self/maps").expect("/proc is there");
    let ranges: Vec<[usize; 2]> = maps
        .lines()
        .filter(|line| line.ends_with(&path))
        .map(|line| {
            let (range, _) = line.split_once(' ').expect("a range comes first");
            let (start, end) = range.split_once('-').expect("of a start and an end");
            [start, end].map(|at| usize::from_str_radix(at, 16).expect("in hexadecimal"))
        })
        .collect();
    // The first stack walk makes what later ones need.
    let mut frame = std::ptr::null_mut();
    // SAFETY: there is room for one.
    unsafe { backtrace(&mut frame, 1) };
    DRIVER[1].store(ranges[ranges.len() - 1][1], Ordering::Relaxed);
    DRIVER[0].store(ranges[0][0], Ordering::Relaxed);
}

/// The permitted errors of a step.
const ANSWERS: [&str; 5] = [
    "OUT_OF_HOST_MEMORY",
    "OUT_OF_DEVICE_MEMORY",
    "DEVICE_LOST",
    "OUT_OF_POOL_MEMORY",
    "FRAGMENTED_POOL",
];

/// Does something; an error is an answer. True if all of it was done.
fn attempt(what: &str, step: impl FnOnce()) -> bool {
    let Err(panic) = catch_unwind(AssertUnwindSafe(step)) else {
        return true;
    };
    let said = panic.downcast_ref::<String>().cloned();
    let said = said.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).into()));
    let said = said.unwrap_or_default();
    assert!(
        ANSWERS.iter().any(|answer| said.contains(answer)),
        "{what}: {said}"
    );
    false
}

const SIDE: u32 = 512;

/// Steps that ask a driver for all kinds of memory.
fn scenario(gpu: &Gpu) {
    let general = vk::ImageLayout::GENERAL;
    attempt("sets and query pools", || {
        let buffer = gpu.buffer(64);
        let bound = vec![Bound::Storage(buffer); 4096];
        gpu.set(&[(0, &bound)]);
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(50_000);
        let pool = gpu.query_pool(&info);
        gpu.try_run(|commands| {
            // SAFETY: the pool is of this device.
            unsafe { gpu.device.cmd_reset_query_pool(commands, pool, 0, 50_000) };
        })
        .unwrap();
    });
    attempt("many commands", || {
        let buffer = gpu.buffer(1 << 16);
        let words = vec![7u8; 1 << 16];
        gpu.try_run(|commands| {
            for _ in 0..4000 {
                // SAFETY: the buffer holds as much.
                unsafe {
                    gpu.device
                        .cmd_update_buffer(commands, buffer.handle, 0, &words[..1024])
                };
            }
            // SAFETY: the same.
            unsafe {
                gpu.device
                    .cmd_update_buffer(commands, buffer.handle, 0, &words)
            };
        })
        .unwrap();
    });
    attempt("images", || {
        let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let shape = Shape::flat(vk::Format::R8G8B8A8_UNORM, SIDE, SIDE);
        let [from, to] = [(); 2].map(|()| gpu.picture(shape, usage | vk::ImageUsageFlags::SAMPLED));
        let layers = vk::ImageSubresourceLayers::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .layer_count(1);
        let end = vk::Offset3D {
            x: SIDE as i32,
            y: SIDE as i32,
            z: 1,
        };
        let half = vk::Offset3D {
            x: 100,
            y: 70,
            z: 1,
        };
        let blit = vk::ImageBlit::default()
            .src_subresource(layers)
            .src_offsets([vk::Offset3D::default(), end])
            .dst_subresource(layers)
            .dst_offsets([vk::Offset3D::default(), half]);
        let copies = vec![
            vk::ImageCopy::default()
                .src_subresource(layers)
                .dst_subresource(layers)
                .extent(vk::Extent3D {
                    width: 3,
                    height: 5,
                    depth: 1
                });
            8000
        ];
        gpu.try_run(|commands| {
            let filter = vk::Filter::LINEAR;
            // SAFETY: the images are of this device, and as large.
            unsafe {
                let device = &gpu.device;
                device.cmd_blit_image(
                    commands,
                    from.handle,
                    general,
                    to.handle,
                    general,
                    &[blit],
                    filter,
                );
                device.cmd_copy_image(commands, from.handle, general, to.handle, general, &copies);
            }
        })
        .unwrap();
    });
    attempt("a dispatch", || {
        let source = "
            layout(local_size_x = 128) in;
            layout(set = 0, binding = 0, std430) buffer B { uint b[]; };
            shared uint meet[8192];
            void main() {
                uint v[64];
                for (uint k = 0u; k < 64u; k++) v[k] = b[k] * k;
                meet[gl_LocalInvocationIndex] = v[b[0] & 63u];
                barrier();
                b[gl_GlobalInvocationID.x & 1023u] = meet[127u - gl_LocalInvocationIndex] + v[b[1] & 63u];
            }";
        gpu.compute(source, &[gpu.buffer(4096)], [300, 1, 1]);
    });
    attempt("structures and rays", || {
        let corner = |i: u32| {
            [
                (i % 97) as f32,
                (i % 89) as f32 * 0.5,
                (i / 3) as f32 * 0.01,
            ]
        };
        let corners: Vec<[f32; 3]> = (0..90_000).map(corner).collect();
        let boxes: Vec<[f32; 6]> = (0..20_000u32)
            .map(|i| {
                let [x, y, z] = corner(i);
                [x, y, z, x + 1.0, y + 1.0, z + 1.0]
            })
            .collect();
        let flags = vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE;
        let bottom = gpu.bottom_with(&[Geometry::opaque(&corners)], flags);
        gpu.bottom(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::OPAQUE)]);
        let placed = |i: u32| Instance {
            transform: translated([i as f32 * 100.0, 0.0, 0.0]),
            ..Instance::of(bottom)
        };
        let top = gpu.top(&(0..8000).map(placed).collect::<Vec<_>>());
        gpu.depths(top, 20_000);
    });
    if gpu.has_graphics() {
        attempt("draws", || draw(gpu));
    }
}

fn draw(gpu: &Gpu) {
    let canvas = gpu.canvas_of(RGBA, SIDE, SIDE, 1, 4);
    let resolved = gpu.canvas(RGBA, SIDE, SIDE);
    let depth = gpu.canvas_of(vk::Format::D32_SFLOAT, SIDE, SIDE, 1, 4);
    let vertex = "
        layout(location = 0) out vec4 shade;
        void main() {
            int i = gl_VertexIndex;
            vec2 at = sin(vec2(i / 3, i / 3 * 7)) + 0.01 * vec2(i % 3, i % 2);
            gl_Position = vec4(at, fract(float(i) * 0.01), 1.0);
            shade = gl_Position;
        }";
    let fragment = "
        layout(location = 0) in vec4 shade;
        layout(location = 0) out vec4 color;
        void main() { color = sin(shade * 9.0); }";
    let mut painting = Painting::new(gpu, vertex, fragment, RGBA);
    painting.samples = 4;
    painting.depth = depth.format;
    painting.depth_stencil = painting
        .depth_stencil
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS);
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        resolves: &[resolved],
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::black(&canvas)
    };
    gpu.try_run(|commands| {
        gpu.record_pass(commands, &pass, |commands| {
            gpu.bind(commands, pipeline);
            // SAFETY: in a pass, with a pipeline.
            unsafe { gpu.device.cmd_draw(commands, 60_000, 2, 0, 0) };
        });
    })
    .unwrap();
}

/// This program again, for a place: what it says, and how it ended.
fn started(place: &str) -> (String, String, std::process::ExitStatus) {
    let program = std::env::current_exe().expect("this program lies somewhere");
    let output = Command::new(program)
        .args(["--exact", "each_large_allocation_may_fail", "--nocapture"])
        .env(PLACE, place)
        .env("TUFF_THREADS", "2")
        .output()
        .expect("it starts again");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr), output.status)
}

#[test]
fn each_large_allocation_may_fail() {
    if let Ok(place) = std::env::var(PLACE) {
        let Some(gpu) = Gpu::surviving() else { return };
        SAYS.store(place == "all", Ordering::Relaxed);
        REFUSED.store(place.parse().unwrap_or(0), Ordering::Relaxed);
        watch(&gpu);
        scenario(&gpu);
        // With memory again, all is as ever.
        SAYS.store(false, Ordering::Relaxed);
        REFUSED.store(0, Ordering::Relaxed);
        drop(gpu);
        let Some(gpu) = Gpu::surviving() else { return };
        let buffer = gpu.buffer(256);
        let source = "
            layout(local_size_x = 64) in;
            layout(set = 0, binding = 0, std430) buffer B { uint b[]; };
            void main() { b[gl_LocalInvocationIndex] = gl_LocalInvocationIndex; }";
        gpu.compute(source, &[buffer], [1, 1, 1]);
        assert_eq!(buffer.read::<u32>(), (0..64).collect::<Vec<u32>>());
        return;
    }
    if Gpu::surviving().is_none() {
        return;
    }
    let (said, errors, status) = started("all");
    assert!(status.success(), "{status}: {errors}");
    let places: BTreeSet<&str> = said
        .lines()
        .filter_map(|line| line.split_once("place "))
        .map(|(_, place)| place)
        .collect();
    assert!(places.len() > 3, "the driver asks for blocks: {said}");
    let mut bad = Vec::new();
    for place in &places {
        let (_, errors, status) = started(place);
        if !status.success() {
            bad.push(format!("{place}: {status}\n{errors}"));
        }
    }
    let count = bad.len();
    assert!(
        bad.is_empty(),
        "{count} of {} places:\n{}",
        places.len(),
        bad.join("\n")
    );
}
