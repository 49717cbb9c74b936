//! `TUFF_TIER` binds all that the driver computes: instructions that are at work are counted, by
//! how they are encoded.
#![cfg(all(target_arch = "x86_64", unix))]

use std::process::Command;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use tuff_tests::*;

/// Says in a child that it is one.
const CHILD: &str = "TUFF_TEST_INSTRUCTIONS";

/// Where the driver's code lies, from and to.
static DRIVER: OnceLock<Vec<[usize; 2]>> = OnceLock::new();

/// Samples in the driver: of all instructions, of those of AVX and AVX2 (and BMI), of AVX-512.
static SEEN: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];

/// Samples that are enough to tell.
const ENOUGH: u32 = 500;
/// Rounds of work that a child does at most for them: some milliseconds each.
const ROUNDS: u32 = 5000;

/// Looks at the instruction that a thread has come to.
extern "C" fn look(_: libc::c_int, _: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the system's context of the thread.
    let at = unsafe {
        let context = &*context.cast::<libc::ucontext_t>();
        context.uc_mcontext.gregs[libc::REG_RIP as usize] as usize
    };
    let Some(driver) = DRIVER.get() else { return };
    if !driver.iter().any(|[from, to]| (*from..*to).contains(&at)) {
        return;
    }
    SEEN[0].fetch_add(1, Ordering::Relaxed);
    // Prefixes of segments and of lengths of addresses may stand before.
    // SAFETY: code that runs can be read, and an instruction is not the last of it.
    let byte = |offset: usize| unsafe { *(at as *const u8).add(offset) };
    let is_prefix = |byte| matches!(byte, 0x26 | 0x2e | 0x36 | 0x3e | 0x64 | 0x65 | 0x67);
    let start = (0..4).find(|&offset| !is_prefix(byte(offset))).unwrap_or(0);
    let bytes: [u8; 7] = std::array::from_fn(|offset| byte(start + offset));
    match bytes {
        // Rust's own `fma` for processors of any kind, one instruction long: correctly rounded, as
        // its other form.
        [0xc4, 0xe2, _, _, _, 0xc3, _] | [0xc4, 0xe3, _, 0x6a | 0x6b, _, _, 0xc3] => 0,
        [0xc4 | 0xc5, ..] => SEEN[1].fetch_add(1, Ordering::Relaxed),
        [0x62, ..] => SEEN[2].fetch_add(1, Ordering::Relaxed),
        _ => 0,
    };
}

/// Looks a thousand times a second of processor time from now on.
fn start_looking() {
    let maps = std::fs::read_to_string("/proc/self/maps").expect("Linux");
    let code = maps
        .lines()
        .filter(|line| line.contains(" r-xp ") && line.contains("vulkan_tuff"));
    let ranges = code.map(|line| {
        let (from, rest) = line.split_once('-').expect("a range");
        let (to, _) = rest.split_once(' ').expect("a range");
        [from, to].map(|number| usize::from_str_radix(number, 16).expect("an address"))
    });
    DRIVER.set(ranges.collect()).expect("once");
    // SAFETY: the handler does what handlers may: it reads, and adds to atomics.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = look as *const () as usize;
        action.sa_flags = libc::SA_SIGINFO | libc::SA_RESTART;
        assert_eq!(
            libc::sigaction(libc::SIGPROF, &action, std::ptr::null_mut()),
            0
        );
        let period = libc::timeval {
            tv_sec: 0,
            tv_usec: 1000,
        };
        let timer = libc::itimerval {
            it_interval: period,
            it_value: period,
        };
        assert_eq!(
            libc::setitimer(libc::ITIMER_PROF, &timer, std::ptr::null_mut()),
            0
        );
    }
}

/// In a child: builds, walks, shaders, samplers and transfers, in turn, and what was seen of their
/// instructions.
#[test]
fn probe() {
    if std::env::var_os(CHILD).is_none() {
        return;
    }
    let gpu = Gpu::without_validation();
    start_looking();
    let mut random = fastrand::Rng::with_seed(1);
    let mut corners = Vec::new();
    for _ in 0..20_000 {
        let at: [f32; 3] = std::array::from_fn(|_| random.f32() * 2.0 - 1.0);
        for _ in 0..3 {
            corners.push(at.map(|c| c + 0.05 * random.f32()));
        }
    }
    let shape = Shape::flat(vk::Format::R8G8B8A8_UNORM, 256, 256);
    let picture = gpu.picture(
        shape,
        vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
    );
    let sampler = gpu.sampler(&vk::SamplerCreateInfo {
        mag_filter: vk::Filter::LINEAR,
        min_filter: vk::Filter::LINEAR,
        ..Default::default()
    });
    let texels: Vec<u32> = (0..256 * 256).map(|_| random.u32(..)).collect();
    gpu.upload(&picture, 0, &texels);
    let output = gpu.buffer(4 * 128 * 128);
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1) uniform sampler2D picture;
    layout(set = 0, binding = 2, std430) buffer Results { float results[]; };
    layout(location = 0) rayPayloadEXT float payload;
    void main() {
        vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / vec2(gl_LaunchSizeEXT.xy);
        float sum = 0.0;
        for (int i = 0; i < 8; i++) {
            payload = 0.0;
            vec3 direction = vec3(sin(float(i) + at.x), cos(float(i) * at.y), 0.3);
            traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(at * 2.0 - 1.0, -2), 0.0, direction, 100.0, 0);
            sum += payload + textureLod(picture, at * 3.0 + sum, 0.0).x + pow(at.x, at.y);
        }
        results[gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x] = sum;
    }";
    let miss = "layout(location = 0) rayPayloadInEXT float payload; void main() { payload = 0.5; }";
    let hit = r"layout(location = 0) rayPayloadInEXT float payload;
    void main() { payload = sqrt(gl_HitTEXT) + exp(-gl_HitTEXT); }";
    let mut case = None;
    for _ in 0..ROUNDS {
        if SEEN[0].load(Ordering::Relaxed) >= ENOUGH {
            break;
        }
        let world = gpu.scene(&[Geometry::opaque(&corners)]);
        let case = case.get_or_insert_with(|| {
            let case = Case::new(raygen).miss(miss).hit(hit).bind(world);
            case.bind(Bound::Sampled(picture.view, sampler))
                .bind(output)
        });
        for _ in 0..8 {
            case.trace(&gpu, [128, 128, 1]);
            gpu.upload(&picture, 0, &texels);
        }
    }
    println!(
        "seen: {:?}",
        SEEN.each_ref().map(|count| count.load(Ordering::Relaxed))
    );
}

/// The results of a child process with a tier.
fn seen(tier: &str) -> [u32; 3] {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program);
    child.args(["--exact", "probe", "--nocapture"]);
    let output = child.env(CHILD, "1").env("TUFF_TIER", tier).output();
    let output = output.expect("this program runs again");
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    let (_, list) = text
        .split_once("seen: [")
        .unwrap_or_else(|| panic!("{text}{errors}"));
    let (list, _) = list.split_once(']').expect("a list");
    let mut numbers = list
        .split(", ")
        .map(|number| number.parse().expect("a number"));
    std::array::from_fn(|_| numbers.next().expect("three numbers"))
}

#[test]
fn the_tier_binds_every_instruction() {
    let is_tuff = Gpu::without_validation().with("a driver with tiers", Gpu::is_tuff);
    if is_tuff.is_none() {
        return;
    }
    let [all, avx, avx512] = seen("portable");
    assert!(all >= ENOUGH, "{all}");
    assert_eq!([avx, avx512], [0, 0], "of {all}");
    if is_x86_feature_detected!("avx2") {
        let [all, avx, avx512] = seen("avx2");
        assert!(avx > all / 20, "{avx} of {all}");
        assert_eq!(avx512, 0, "of {all}");
    }
    if is_x86_feature_detected!("avx512bw") {
        let [all, _, avx512] = seen("");
        assert!(avx512 > all / 20, "{avx512} of {all}");
    }
}
