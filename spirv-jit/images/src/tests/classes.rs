//! Samples and gathers in vectors against the general way, in every instruction set that the
//! machine has: every format, dimension, address mode and filter, on memory that ends with the
//! image.

use fastrand::Rng;
use lanes::{LaneMask, Tier};

use super::super::decode::Decoder;
use super::super::fast::Fast;
use super::super::operands::Operands;
use super::super::plain::Plain;
use super::super::wave::{self, Wave};
use super::super::{lod, sample};
use super::*;

/// Memory between pages that cannot be read: its last byte is a page's last.
struct Guarded {
    map: *mut u8,
    #[cfg_attr(windows, expect(dead_code, reason = "Windows knows it"))]
    size: usize,
    data: *mut u8,
}

const PAGE: usize = 65536;

impl Guarded {
    #[cfg(unix)]
    fn new(bytes: usize) -> Guarded {
        let inner = bytes.next_multiple_of(PAGE);
        let size = inner + 2 * PAGE;
        // SAFETY: a new mapping, of which the middle becomes accessible.
        unsafe {
            let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            let map = libc::mmap(std::ptr::null_mut(), size, libc::PROT_NONE, flags, -1, 0);
            assert_ne!(map, libc::MAP_FAILED);
            let map = map.cast::<u8>();
            let middle = map.add(PAGE);
            let rights = libc::PROT_READ | libc::PROT_WRITE;
            assert_eq!(libc::mprotect(middle.cast(), inner, rights), 0);
            let data = middle.add(inner - bytes);
            Guarded { map, size, data }
        }
    }

    #[cfg(windows)]
    fn new(bytes: usize) -> Guarded {
        use windows_sys::Win32::System::Memory::{
            MEM_COMMIT, MEM_RESERVE, PAGE_NOACCESS, PAGE_READWRITE, VirtualAlloc,
        };
        let inner = bytes.next_multiple_of(PAGE);
        let size = inner + 2 * PAGE;
        // SAFETY: new pages, of which the middle becomes accessible.
        unsafe {
            let map = VirtualAlloc(std::ptr::null(), size, MEM_RESERVE, PAGE_NOACCESS).cast::<u8>();
            assert!(!map.is_null());
            let middle = map.add(PAGE);
            let there = VirtualAlloc(middle.cast(), inner, MEM_COMMIT, PAGE_READWRITE);
            assert!(!there.is_null());
            let data = middle.add(inner - bytes);
            Guarded { map, size, data }
        }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        // SAFETY: the mapping is this one's own.
        #[cfg(unix)]
        unsafe {
            libc::munmap(self.map.cast(), self.size);
        }
        // SAFETY: the mapping is this one's own.
        #[cfg(windows)]
        unsafe {
            use windows_sys::Win32::System::Memory::{MEM_RELEASE, VirtualFree};
            VirtualFree(self.map.cast(), 0, MEM_RELEASE);
        }
    }
}

/// Words of which parts are numbers of all kinds in some format.
const SPECIAL: [u32; 12] = [
    0,
    u32::MAX,
    0x7fc0_0000,
    0x7fa0_0001,
    0x7f80_0000,
    0xff80_0000,
    0x8000_0001,
    0x3f80_0000,
    0x7c01_7c00,
    0xfc00_7e00,
    0x8001_0001,
    0x007f_ffff,
];

/// An image of any bits.
fn any_image(
    random: &mut Rng,
    format: Format,
    dim: Dim,
    size: [u32; 3],
    level_count: u8,
    layers: u32,
) -> (Guarded, ImageDescriptor) {
    let info = format.info().unwrap();
    let [across, down] = info.block_extent();
    let texel = info.size_bytes as u64;
    let mut levels = [Level::default(); MAX_LEVELS];
    let mut end = 0;
    let gap = random.u64(..2);
    for (index, level) in levels.iter_mut().enumerate().take(level_count as usize) {
        let [width, height, depth] = size.map(|n| (n >> index).max(1));
        let row = (width.div_ceil(across) as u64 + gap) * texel;
        let slice = row * height.div_ceil(down) as u64;
        *level = Level {
            offset_bytes: end,
            row_stride_bytes: row,
            slice_stride_bytes: slice,
            width,
            height,
            depth,
        };
        end += slice * depth as u64;
    }
    // Nothing is behind the last texel.
    let total = end * layers as u64 - gap * texel;
    let memory = Guarded::new(total as usize);
    for at in (0..total).step_by(4) {
        let word = match random.u32(..4) {
            0 => SPECIAL[random.usize(..SPECIAL.len())],
            _ => random.u32(..),
        };
        for (k, byte) in word.to_le_bytes().into_iter().enumerate() {
            if at + (k as u64) < total {
                // SAFETY: the memory's own bytes.
                unsafe { *memory.data.add(at as usize + k) = byte };
            }
        }
    }
    let descriptor = ImageDescriptor {
        data: memory.data,
        size_bytes: total,
        format,
        dim,
        layer_count: layers,
        layer_stride_bytes: end,
        level_count,
        levels,
        ..ImageDescriptor::NULL
    };
    (memory, descriptor)
}

fn pick<T: Copy>(random: &mut Rng, all: &[T]) -> T {
    all[random.usize(..all.len())]
}

const MODES: [AddressMode; 5] = [
    AddressMode::Repeat,
    AddressMode::MirroredRepeat,
    AddressMode::ClampToEdge,
    AddressMode::ClampToBorder,
    AddressMode::MirrorClampToEdge,
];
const FILTERS: [Filter; 2] = [Filter::Nearest, Filter::Linear];

/// More subgroups than are done at a time.
const SUBGROUPS: usize = 19;

/// Performs an operation in a wave of subgroups, whose lanes are turned by their subgroup's number:
/// the results are those of one subgroup, turned. Only wanted results have rows.
fn compare_turned(
    rows: &[&Row],
    mask: u16,
    expected: &[Row],
    wanted: u8,
    is_same: impl Fn(u32, u32) -> bool,
    perform: impl FnOnce(&Wave<'_>),
    what: &str,
) {
    let turned = |row: &Row, by: usize| -> Row { std::array::from_fn(|k| row[(k + by) % 16]) };
    let turns = || 0..SUBGROUPS;
    let all = |row: &&Row| -> Vec<Row> { turns().map(|by| turned(row, by)).collect() };
    let mut operands: Vec<Row> = rows.iter().flat_map(all).collect();
    let mut results = vec![[0; 16]; SUBGROUPS * expected.len()];
    let of_subgroups = |rows: &mut [Row]| wave::Rows {
        first: rows.as_mut_ptr(),
        step_bytes: size_of::<Row>(),
    };
    let operand_rows: Vec<_> = (operands.chunks_exact_mut(SUBGROUPS).map(of_subgroups)).collect();
    let mut result_rows = [wave::Rows::NONE; 4];
    let rows_of_results = results.chunks_exact_mut(SUBGROUPS).map(of_subgroups);
    for (component, rows) in rows_of_results.enumerate().take(4) {
        if wanted >> component & 1 == 1 {
            result_rows[component] = rows;
        }
    }
    let of_turn = |by: usize| mask.rotate_right(by as u32);
    let lanes: Vec<LaneMask> = turns().map(|by| LaneMask::from_bits(of_turn(by))).collect();
    let numbers: Vec<u16> = turns().rev().map(|by| by as u16).collect();
    perform(&Wave {
        subgroups: &numbers,
        lanes: &lanes,
        operands: &operand_rows,
        results: result_rows,
        derives: false,
    });
    for (component, expected) in expected.iter().enumerate() {
        for by in turns().filter(|_| wanted >> component & 1 == 1) {
            let found = results[component * SUBGROUPS + by];
            let expected = turned(expected, by);
            for lane in (0..16).filter(|lane| of_turn(by) >> lane & 1 == 1) {
                let (a, b) = (found[lane], expected[lane]);
                assert!(
                    is_same(a, b),
                    "{a:x}, not {b:x}, in lane {lane} of {by}, component {component}: {what}"
                );
            }
        }
    }
}

/// Compares a sample of a format, of which everything else is random.
fn compare_one(random: &mut Rng, format: Format) {
    let info = format.info().unwrap();
    let dim = pick(
        random,
        &[Dim::D1, Dim::D2, Dim::D2, Dim::D3, Dim::D3, Dim::Cube],
    );
    let is_integer = info.numeric.is_integer();
    let filter = pick(random, &FILTERS);
    let is_gather = random.u32(..5) == 0 && matches!(dim, Dim::D2 | Dim::Cube);
    let mut s = SamplerDescriptor {
        mag_filter: filter,
        min_filter: filter,
        mipmap_mode: pick(random, &FILTERS),
        address_mode: [0; 3].map(|_: i32| pick(random, &MODES)),
        mip_lod_bias: pick(random, &[0.0, 0.7, -1.3]),
        min_lod: pick(random, &[0.0, 1.2]),
        border_color: pick(
            random,
            &[
                [0.25f32, 0.5, -0.75, 2.0],
                [0.0; 4],
                [f32::NAN, 1.0, 0.0, 0.1],
            ],
        )
        .map(f32::to_bits),
        ..sampler()
    };
    if is_integer {
        (s.mag_filter, s.min_filter) = (Filter::Nearest, Filter::Nearest);
        s.mipmap_mode = Filter::Nearest;
    }
    let is_cube = dim == Dim::Cube;
    let most = if dim == Dim::D3 { 12 } else { 30 };
    let mut size = [1; 3];
    for axis in size
        .iter_mut()
        .take(if is_cube { 1 } else { dim as usize + 1 })
    {
        *axis = random.u32(1..most);
    }
    if is_cube {
        size[1] = size[0];
    }
    let is_arrayed = dim != Dim::D3 && random.bool();
    let layers = (if is_arrayed { 3 } else { 1 }) * (if is_cube { 6 } else { 1 });
    let mut level_count = random.u8(1..4);
    s.unnormalized_coordinates = random.u32(..12) == 0 && !is_cube && dim != Dim::D3;
    if s.unnormalized_coordinates {
        s.address_mode = [AddressMode::ClampToEdge; 3];
        level_count = 1;
    }
    let (_memory, mut image) = any_image(random, format, dim, size, level_count, layers);
    let compares = info.has_depth && dim != Dim::D3 && random.bool();
    if compares {
        s.compare = Some(pick(
            random,
            &[
                CompareOp::Never,
                CompareOp::Less,
                CompareOp::Equal,
                CompareOp::LessOrEqual,
                CompareOp::Greater,
                CompareOp::NotEqual,
                CompareOp::GreaterOrEqual,
                CompareOp::Always,
            ],
        ));
    } else if random.u32(..3) == 0 {
        image.swizzle = [0; 4].map(|_: i32| random.u8(..6));
    }
    let lod = match is_gather {
        true => LodMode::Implicit,
        false => pick(
            random,
            &[
                LodMode::Implicit,
                LodMode::Bias,
                LodMode::Lod,
                LodMode::Grad,
            ],
        ),
    };
    if lod == LodMode::Grad {
        s.max_anisotropy = pick(random, &[1.0, 4.0]);
    }
    let op = ImageOp {
        arrayed: is_arrayed,
        depth_compare: compares,
        lod,
        has_offset: !is_cube && random.u32(..3) == 0,
        texel: if is_integer {
            TexelType::I32
        } else {
            TexelType::F32
        },
        signed: info.numeric == super::super::format::Numeric::Sint,
        ..ImageOp::plain(
            match is_gather {
                true => ImageOpKind::Gather(random.u8(..4)),
                false => ImageOpKind::Sample,
            },
            dim,
        )
    };
    let spatial = op.spatial_count();
    let is_inner = random.bool();
    let scale = if s.unnormalized_coordinates {
        20.0
    } else {
        1.0
    };
    let mut rows: Vec<Row> = Vec::new();
    for _ in 0..spatial {
        let from = random.f32();
        let coordinate = |random: &mut Rng| match random.u32(..if is_inner { 200 } else { 20 }) {
            0 => pick(
                random,
                &[
                    f32::NAN,
                    f32::INFINITY,
                    -1e30,
                    1e30,
                    3e9,
                    -1e-9,
                    f32::MIN_POSITIVE,
                ],
            ),
            1 => pick(random, &[0.0, 1.0, -1.0, 0.5, 0.99999994]),
            _ if is_cube => 2.0 * random.f32() - 1.0,
            _ if is_inner => from + 0.2 * random.f32(),
            _ => 7.0 * random.f32() - 3.5,
        };
        rows.push([0; 16].map(|_: u32| (scale * coordinate(random)).to_bits()));
    }
    if is_arrayed {
        rows.push([0; 16].map(|_: u32| (6.0 * random.f32() - 2.0).to_bits()));
    }
    if compares {
        rows.push([0; 16].map(|_: u32| pick(random, &[0.0f32, 0.5, 1.0, 1.5, 0.25]).to_bits()));
    }
    match lod {
        LodMode::Implicit => {}
        LodMode::Grad => {
            for _ in 0..2 * spatial {
                rows.push([0; 16].map(|_: u32| (0.4 * random.f32() - 0.2).to_bits()));
            }
        }
        _ if random.bool() => rows.push(row(5.0 * random.f32() - 1.0)),
        _ => rows.push([0; 16].map(|_: u32| (5.0 * random.f32() - 1.0).to_bits())),
    }
    if op.has_offset {
        for _ in 0..spatial {
            rows.push([pick(random, &[0, 1, -1, 7, -8, i32::MAX, i32::MIN]) as u32; 16]);
        }
    }
    let rows: Vec<&Row> = rows.iter().collect();
    let what = format!("{} {op:?} {s:?} {size:?} {level_count}", info.name);
    let mask = if random.bool() {
        u16::MAX
    } else {
        random.u16(1..)
    };
    let takes_integers = !lod::is_anisotropic(&s) && !info.is_wide();
    let Some(fast) = Fast::new(&op, &image, info, &s, 0xf) else {
        assert!(is_integer && !takes_integers, "{what}");
        return;
    };
    let mut expected = [[0; 16]; 8];
    let operands = Operands::new(&op, &rows);
    // SAFETY: the image's memory is there.
    unsafe {
        let tier = Tier::best();
        sample::sample(tier, &op, &operands, &image, info, &s, mask, &mut expected);
    }
    let is_nan = |word: u32| f32::from_bits(word).is_nan() && !is_integer;
    let is_same = |a: u32, b: u32| a == b || is_nan(a) && is_nan(b);
    let turns = random.u32(..4) == 0;
    for &tier in Tier::available() {
        let mut results = [[0; 16]; 8];
        let rows_of_results = &mut results[..op.result_rows()];
        wave::of_one(&rows, mask, rows_of_results, |one| {
            // SAFETY: the image's memory is there, and the machine has the tier.
            unsafe { wave::sample(tier, &fast, one) };
        });
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            for component in 0..op.result_rows() {
                let (a, b) = (results[component][lane], expected[component][lane]);
                assert!(
                    is_same(a, b),
                    "{a:x}, not {b:x}, in lane {lane}, component {component}, {tier}: {what}"
                );
            }
        }
        if turns {
            let expected = &expected[..op.result_rows()];
            let wanted = random.u8(1..16);
            // SAFETY: the image's memory is there, and the machine has the tier.
            let perform = |wave: &Wave<'_>| unsafe { wave::sample(tier, &fast, wave) };
            compare_turned(&rows, mask, expected, wanted, is_same, perform, &what);
        }
    }
}

/// Compares a fetch from an image of a format, inside and outside of it.
fn compare_fetch(random: &mut Rng, format: Format) {
    let info = format.info().unwrap();
    let dim = pick(random, &[Dim::D1, Dim::D2, Dim::D3]);
    let mut size = [1; 3];
    for axis in size.iter_mut().take(dim as usize + 1) {
        *axis = random.u32(1..12);
    }
    let is_arrayed = dim != Dim::D3 && random.bool();
    let layers = if is_arrayed { 3 } else { 1 };
    let (_memory, mut image) = any_image(random, format, dim, size, 2, layers);
    if random.u32(..3) == 0 {
        image.swizzle = [0; 4].map(|_: i32| random.u8(..6));
    }
    let op = ImageOp {
        arrayed: is_arrayed,
        lod: LodMode::Lod,
        has_offset: random.u32(..3) == 0,
        texel: if info.numeric.is_integer() {
            TexelType::I32
        } else {
            TexelType::F32
        },
        ..ImageOp::plain(ImageOpKind::Fetch, dim)
    };
    let spatial = op.spatial_count();
    let mut rows: Vec<Row> = Vec::new();
    for axis in 0..spatial {
        let most = size[axis] as i32;
        rows.push([0; 16].map(|_: u32| random.i32(-1..most + 1) as u32));
    }
    if is_arrayed {
        rows.push([0; 16].map(|_: u32| random.i32(-1..4) as u32));
    }
    rows.push([random.i32(-1..3) as u32; 16]);
    if op.has_offset {
        for _ in 0..spatial {
            rows.push([random.i32(-2..3) as u32; 16]);
        }
    }
    let rows: Vec<&Row> = rows.iter().collect();
    let what = format!("{} {op:?} {size:?}", info.name);
    let mask = random.u16(1..);
    let mut expected = [[0; 16]; 8];
    // SAFETY: the image's memory is there.
    unsafe { execute_block(&op, Some(&image), None, mask, &rows, &mut expected) };
    let Some(plain) = Plain::new(&op, &image, info) else {
        assert!(Decoder::of(info) == Decoder::Each, "{what}");
        return;
    };
    for &tier in Tier::available() {
        let mut results = [[0; 16]; 4];
        // Results that the shader does not use have no rows.
        let wanted = random.u8(1..16);
        let done = wave::of_one(&rows, mask, &mut results, |one| {
            let mut one = *one;
            for (component, rows) in one.results.iter_mut().enumerate() {
                if wanted >> component & 1 == 0 {
                    *rows = wave::Rows::NONE;
                }
            }
            // SAFETY: the image's memory is there, and the machine has the tier.
            unsafe { wave::load(tier, &plain, &one) }
        });
        // Lanes of no level that there is are not for vectors.
        if done == 0 {
            return;
        }
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            for component in (0..4).filter(|component| wanted >> component & 1 != 0) {
                let (a, b) = (results[component][lane], expected[component][lane]);
                assert_eq!(
                    a, b,
                    "in lane {lane}, component {component} of {wanted:#06b}, {tier}: {what}"
                );
            }
        }
        let perform = |wave: &Wave<'_>| {
            // SAFETY: the image's memory is there, and the machine has the tier.
            let done = unsafe { wave::load(tier, &plain, wave) };
            assert_eq!(done, SUBGROUPS, "{what}");
        };
        let expected = &expected[..4];
        let is_same = |a, b| a == b;
        compare_turned(&rows, mask, expected, wanted, is_same, perform, &what);
    }
}

/// Formats of every kind, and those of other blocks than vectors take.
fn compare_all() {
    let formats: Vec<Format> = Format::all()
        .filter(|format| matches!(format.info().unwrap().block_extent(), [1, 1] | [4, 4]))
        .collect();
    for (number, &format) in formats.iter().enumerate() {
        let info = format.info().unwrap();
        // Those that have ways of their own.
        let usual = match Decoder::of(info) {
            Decoder::Each => 10,
            Decoder::Colors | Decoder::Ramps => 100,
            _ => 40,
        };
        let mut random = Rng::with_seed(number as u64);
        for _ in 0..effort::rounds(usual) {
            compare_one(&mut random, format);
            compare_fetch(&mut random, format);
        }
    }
}

/// Without optimisation, all that is inlined for a tier has places of its own on the stack.
const STACK_BYTES: usize = 64 << 20;

#[test]
fn every_class_of_samples_is_the_same() {
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES);
    thread.spawn(compare_all).unwrap().join().unwrap();
}
