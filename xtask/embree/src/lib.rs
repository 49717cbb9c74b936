//! Embree 4, opened at run time: the few functions and structures of its C interface that a bench
//! of single rays needs (`rtcore.h` of version 4).

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use libloading::Library;
use scenes::Mesh;
use traversal::Ray;

type Device = *mut c_void;
type RtcScene = *mut c_void;
type Geometry = *mut c_void;

/// `RTCRayHit`, with room to spare behind it.
#[repr(C, align(64))]
struct RayHit {
    origin: [f32; 3],
    t_near: f32,
    direction: [f32; 3],
    time: f32,
    t_far: f32,
    mask: c_uint,
    id: c_uint,
    flags: c_uint,
    normal: [f32; 3],
    weights: [f32; 2],
    primitive: c_uint,
    geometry: c_uint,
    instances: [c_uint; 9],
}

const INVALID: c_uint = c_uint::MAX;

impl RayHit {
    fn new(ray: &Ray) -> RayHit {
        RayHit {
            origin: ray.origin,
            t_near: ray.t_min,
            direction: ray.direction,
            time: 0.0,
            t_far: ray.t_max,
            mask: INVALID,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            weights: [0.0; 2],
            primitive: INVALID,
            geometry: INVALID,
            instances: [INVALID; 9],
        }
    }
}

type MemoryMonitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;

macro_rules! functions {
    ($($field:ident = $symbol:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            /// # Safety
            /// The library is Embree 4 and stays open.
            unsafe fn load(library: &Library) -> Result<Functions> {
                Ok(Functions {
                    // SAFETY: the type is that of the header.
                    $($field: *unsafe { library.get($symbol) }?,)*
                })
            }
        }
    };
}

functions! {
    new_device = b"rtcNewDevice\0": fn(*const c_char) -> Device;
    device_property = b"rtcGetDeviceProperty\0": fn(Device, c_int) -> isize;
    set_memory_monitor = b"rtcSetDeviceMemoryMonitorFunction\0": fn(Device, Option<MemoryMonitor>, *mut c_void);
    device_error = b"rtcGetDeviceError\0": fn(Device) -> c_int;
    release_device = b"rtcReleaseDevice\0": fn(Device);
    new_scene = b"rtcNewScene\0": fn(Device) -> RtcScene;
    set_scene_flags = b"rtcSetSceneFlags\0": fn(RtcScene, c_int);
    set_scene_quality = b"rtcSetSceneBuildQuality\0": fn(RtcScene, c_int);
    commit_scene = b"rtcCommitScene\0": fn(RtcScene);
    release_scene = b"rtcReleaseScene\0": fn(RtcScene);
    new_geometry = b"rtcNewGeometry\0": fn(Device, c_int) -> Geometry;
    set_quality = b"rtcSetGeometryBuildQuality\0": fn(Geometry, c_int);
    set_buffer = b"rtcSetSharedGeometryBuffer\0": fn(Geometry, c_int, c_uint, c_int, *const c_void, usize, usize, usize);
    commit_geometry = b"rtcCommitGeometry\0": fn(Geometry);
    attach_geometry = b"rtcAttachGeometry\0": fn(RtcScene, Geometry) -> c_uint;
    release_geometry = b"rtcReleaseGeometry\0": fn(Geometry);
    intersect = b"rtcIntersect1\0": fn(RtcScene, *mut RayHit, *mut c_void);
    occluded = b"rtcOccluded1\0": fn(RtcScene, *mut RayHit, *mut c_void);
}

/// `RTCBuildQuality`.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    Low = 0,
    Medium = 1,
}

/// The library and a device with one thread.
pub struct Embree {
    functions: Functions,
    device: Device,
    /// Bytes that the device holds, counted by its own monitor.
    bytes: Box<std::sync::atomic::AtomicIsize>,
    /// Never closed: its threads may run on for a while.
    _library: ManuallyDrop<Library>,
}

impl Embree {
    /// The library at `path`, or where it is usually found; `None` without a path if there is none.
    pub fn open(path: Option<&Path>) -> Result<Option<Embree>> {
        let candidates = match path {
            Some(path) => vec![path.to_path_buf()],
            None => usual_places(),
        };
        for candidate in &candidates {
            // SAFETY: Embree's initialisers have no conditions.
            match unsafe { Library::new(candidate) } {
                Ok(library) => return Embree::with(library).map(Some),
                Err(error) if path.is_some() => {
                    return Err(error).with_context(|| format!("opening {}", candidate.display()));
                }
                Err(_) => {}
            }
        }
        Ok(None)
    }

    fn with(library: Library) -> Result<Embree> {
        // SAFETY: it has Embree's name, and stays open as long as the functions.
        let functions = unsafe { Functions::load(&library) }.context("not Embree 4")?;
        // SAFETY: a string of settings.
        let device = unsafe { (functions.new_device)(c"threads=1".as_ptr()) };
        ensure!(!device.is_null(), "Embree gave no device");
        let bytes = Box::<std::sync::atomic::AtomicIsize>::default();
        let counter = std::ptr::from_ref(&*bytes).cast_mut().cast();
        // SAFETY: the counter outlives the device.
        unsafe { (functions.set_memory_monitor)(device, Some(count_bytes), counter) };
        Ok(Embree {
            functions,
            device,
            bytes,
            _library: ManuallyDrop::new(library),
        })
    }

    /// As "4.4.0".
    pub fn version(&self) -> String {
        // SAFETY: `RTC_DEVICE_PROPERTY_VERSION` of a live device.
        let version = unsafe { (self.functions.device_property)(self.device, 0) };
        format!(
            "{}.{}.{}",
            version / 10000,
            version / 100 % 100,
            version % 100
        )
    }

    /// Bytes that its structures take now.
    pub fn bytes(&self) -> isize {
        self.bytes.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Builds the structure of a mesh, which has to stay.
    pub fn build<'a>(
        &'a self,
        mesh: &'a Mesh,
        quality: Quality,
        robust: bool,
    ) -> Result<Built<'a>> {
        const VERTEX: c_int = 1;
        const INDEX: c_int = 0;
        const FLOAT3: c_int = 0x9003;
        const UINT3: c_int = 0x5003;
        const ROBUST: c_int = 4;
        let f = &self.functions;
        // SAFETY: the calls of Embree's tutorial, in its order; Embree reads at most 16 bytes from
        // the start of the last vertex, and the mesh keeps one more behind it.
        let (scene, error) = unsafe {
            let scene = (f.new_scene)(self.device);
            (f.set_scene_flags)(scene, if robust { ROBUST } else { 0 });
            (f.set_scene_quality)(scene, quality as c_int);
            let geometry = (f.new_geometry)(self.device, 0);
            (f.set_quality)(geometry, quality as c_int);
            let (vertices, indices) = (mesh.vertices.as_ptr(), mesh.indices.as_ptr());
            let (vertex_count, index_count) = (mesh.vertices.len(), mesh.indices.len());
            (f.set_buffer)(
                geometry,
                VERTEX,
                0,
                FLOAT3,
                vertices.cast(),
                0,
                12,
                vertex_count - 1,
            );
            (f.set_buffer)(
                geometry,
                INDEX,
                0,
                UINT3,
                indices.cast(),
                0,
                12,
                index_count,
            );
            (f.commit_geometry)(geometry);
            (f.attach_geometry)(scene, geometry);
            (f.release_geometry)(geometry);
            (f.commit_scene)(scene);
            (scene, (f.device_error)(self.device))
        };
        let built = Built {
            embree: self,
            scene,
            _mesh: mesh,
        };
        ensure!(error == 0, "Embree reports error {error}");
        Ok(built)
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: scenes borrow the device, so there are none.
        unsafe { (self.functions.release_device)(self.device) }
    }
}

/// A structure of Embree's.
pub struct Built<'a> {
    embree: &'a Embree,
    scene: RtcScene,
    _mesh: &'a Mesh,
}

impl Built<'_> {
    /// Walks each ray for its closest hit; returns how many hit and the sum of their distances.
    pub fn closest(&self, rays: &[Ray]) -> (usize, f64) {
        let (mut hits, mut sum) = (0, 0.0);
        for ray in rays {
            let mut query = RayHit::new(ray);
            // SAFETY: a committed scene and a ray of its layout.
            unsafe {
                (self.embree.functions.intersect)(self.scene, &mut query, std::ptr::null_mut())
            };
            if query.geometry != INVALID {
                hits += 1;
                sum += f64::from(query.t_far);
            }
        }
        (hits, sum)
    }

    /// Walks each ray until it hits anything; returns how many do.
    pub fn occluded(&self, rays: &[Ray]) -> (usize, f64) {
        let mut hits = 0;
        for ray in rays {
            let mut query = RayHit::new(ray);
            // SAFETY: a committed scene, and a ray of its layout at the start.
            unsafe {
                (self.embree.functions.occluded)(self.scene, &mut query, std::ptr::null_mut())
            };
            hits += usize::from(query.t_far < 0.0);
        }
        (hits, 0.0)
    }
}

impl Drop for Built<'_> {
    fn drop(&mut self) {
        // SAFETY: committed once, released once.
        unsafe { (self.embree.functions.release_scene)(self.scene) }
    }
}

unsafe extern "C" fn count_bytes(counter: *mut c_void, bytes: isize, _after: bool) -> bool {
    // SAFETY: the counter that the monitor was installed with.
    let counter = unsafe { &*counter.cast::<std::sync::atomic::AtomicIsize>() };
    counter.fetch_add(bytes, std::sync::atomic::Ordering::Relaxed);
    true
}

/// Names for the dynamic loader, then the library of the Python package `embreex`.
fn usual_places() -> Vec<PathBuf> {
    let mut places = vec![
        PathBuf::from("libembree4.so.4"),
        PathBuf::from("libembree4.so"),
    ];
    let question = "import embreex, os; print(os.path.dirname(embreex.__file__))";
    let answer = std::process::Command::new("python3")
        .args(["-c", question])
        .output();
    if let Ok(answer) = answer
        && let Ok(package) = std::str::from_utf8(&answer.stdout)
    {
        let libraries = Path::new(package.trim()).with_file_name("embreex.libs");
        for entry in libraries.read_dir().into_iter().flatten().flatten() {
            if entry
                .file_name()
                .to_string_lossy()
                .starts_with("libembree4")
            {
                places.push(entry.path());
            }
        }
    }
    places
}

const _: () = {
    assert!(std::mem::offset_of!(RayHit, t_far) == 32);
    assert!(std::mem::offset_of!(RayHit, normal) == 48);
    assert!(std::mem::offset_of!(RayHit, geometry) == 72);
};
