//! The functions of Embree 3 and 4 that are called. The layouts are those of `rtcore_ray.h` and
//! `rtcore_common.h`; the versions differ in the last arguments of the two queries.

#![allow(unsafe_code, reason = "Embree is a C library")]

use super::Quality;
use crate::single::{SingleHit, SingleRay, meshes};
use libloading::Library;
use std::ffi::{CString, OsStr, OsString, c_char, c_int, c_uint, c_void};
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, OnceLock};
use whitstone_core::{DVec3, Geometry, TriangleMesh};

/// Names of the library, best first.
const NAMES: [&str; 8] = [
    "libembree4.so.4",
    "libembree4.so",
    "libembree3.so.3",
    "libembree3.so",
    "libembree4.dylib",
    "libembree3.dylib",
    "embree4.dll",
    "embree3.dll",
];

/// Environment variable that names the library, if the system does not find it.
const VARIABLE: &str = "WHITSTONE_EMBREE";

const INVALID: u32 = u32::MAX;
const TYPE_TRIANGLE: c_int = 0;
const BUFFER_INDEX: c_int = 0;
const BUFFER_VERTEX: c_int = 1;
const FORMAT_UINT3: c_int = 0x5003;
const FORMAT_FLOAT3: c_int = 0x9003;
const FLAG_ROBUST: c_int = 1 << 2;
const PROPERTY_VERSION: c_int = 0;

/// A device, a scene or a geometry.
type Handle = *mut c_void;

/// `RTCRayHit`.
#[repr(C, align(16))]
struct RayHit {
    ray: RawRay,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: u32,
    geometry: u32,
    /// Instance IDs, for as many levels as a library may have been compiled for.
    instance: [u32; 17],
}

/// `RTCRay`.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
struct RawRay {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

/// `RTCIntersectContext` of version 3.
#[repr(C)]
struct Context {
    /// 0 for incoherent rays.
    flags: c_int,
    filter: *const c_void,
    /// As in [`RayHit`].
    instance: [u32; 16],
}

type Monitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;

macro_rules! functions {
    ($($field:ident: $name:literal, fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// Functions that both versions have.
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn load(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: both versions declare these functions with these types in their headers,
                // and the library is never unloaded.
                unsafe { Ok(Self { $($field: *library.get($name)?,)* }) }
            }
        }
    };
}

functions! {
    new_device: "rtcNewDevice", fn(*const c_char) -> Handle;
    release_device: "rtcReleaseDevice", fn(Handle);
    device_error: "rtcGetDeviceError", fn(Handle) -> c_int;
    device_property: "rtcGetDeviceProperty", fn(Handle, c_int) -> isize;
    set_monitor: "rtcSetDeviceMemoryMonitorFunction", fn(Handle, Option<Monitor>, *mut c_void);
    new_scene: "rtcNewScene", fn(Handle) -> Handle;
    release_scene: "rtcReleaseScene", fn(Handle);
    set_flags: "rtcSetSceneFlags", fn(Handle, c_int);
    set_scene_quality: "rtcSetSceneBuildQuality", fn(Handle, c_int);
    commit_scene: "rtcCommitScene", fn(Handle);
    new_geometry: "rtcNewGeometry", fn(Handle, c_int) -> Handle;
    release_geometry: "rtcReleaseGeometry", fn(Handle);
    set_geometry_quality: "rtcSetGeometryBuildQuality", fn(Handle, c_int);
    commit_geometry: "rtcCommitGeometry", fn(Handle);
    attach_geometry: "rtcAttachGeometryByID", fn(Handle, Handle, c_uint);
    set_buffer: "rtcSetSharedGeometryBuffer",
        fn(Handle, c_int, c_uint, c_int, *const c_void, usize, usize, usize);
}

/// `rtcIntersect1` and `rtcOccluded1`.
enum Queries {
    Three {
        intersect: unsafe extern "C" fn(Handle, *mut Context, *mut RayHit),
        occluded: unsafe extern "C" fn(Handle, *mut Context, *mut RawRay),
    },
    Four {
        intersect: unsafe extern "C" fn(Handle, *mut RayHit, *const c_void),
        occluded: unsafe extern "C" fn(Handle, *mut RawRay, *const c_void),
    },
}

struct Embree {
    functions: Functions,
    queries: Queries,
    version: isize,
    /// Never unloaded: it lives in a static variable.
    _library: Library,
}

/// The library, loaded on first use.
fn embree() -> Result<&'static Embree, &'static str> {
    static EMBREE: OnceLock<Result<Embree, String>> = OnceLock::new();
    EMBREE.get_or_init(load).as_ref().map_err(String::as_str)
}

fn load() -> Result<Embree, String> {
    let named = std::env::var_os(VARIABLE);
    let names: Vec<OsString> = match &named {
        Some(name) => vec![name.clone()],
        None => NAMES.iter().map(OsString::from).collect(),
    };
    let library = names
        .iter()
        .find_map(|name| open(name).ok())
        .ok_or_else(|| match &named {
            Some(name) => format!(
                "{VARIABLE} is {}, which is not a loadable library",
                name.display()
            ),
            None => format!("none of {} was found", NAMES[..4].join(", ")),
        })?;
    let functions = Functions::load(&library).map_err(|error| error.to_string())?;
    // SAFETY: a null pointer stands for no arguments, as the header allows.
    let device = unsafe { (functions.new_device)(ptr::null()) };
    if device.is_null() {
        return Err("it cannot be started on this processor".to_owned());
    }
    // SAFETY: the device is valid and released once, after its last use.
    let version = unsafe {
        let version = (functions.device_property)(device, PROPERTY_VERSION);
        (functions.release_device)(device);
        version
    };
    let queries = match version / 10_000 {
        // SAFETY: as in `Functions::load`, of version 3.
        3 => unsafe {
            (|| {
                Ok(Queries::Three {
                    intersect: *library.get("rtcIntersect1")?,
                    occluded: *library.get("rtcOccluded1")?,
                })
            })()
        },
        // SAFETY: as in `Functions::load`, of version 4.
        4 => unsafe {
            (|| {
                Ok(Queries::Four {
                    intersect: *library.get("rtcIntersect1")?,
                    occluded: *library.get("rtcOccluded1")?,
                })
            })()
        },
        other => return Err(format!("expected version 3 or 4, found {other}")),
    }
    .map_err(|error: libloading::Error| error.to_string())?;
    Ok(Embree {
        functions,
        queries,
        version,
        _library: library,
    })
}

fn open(name: &OsStr) -> Result<Library, libloading::Error> {
    // SAFETY: the initialisers that Embree runs when it is loaded require nothing of the caller.
    unsafe { Library::new(name) }
}

/// Version of the library, such as "3.13.5".
pub(super) fn version() -> Result<String, &'static str> {
    let version = embree()?.version;
    Ok(format!(
        "{}.{}.{}",
        version / 10_000,
        version / 100 % 100,
        version % 100
    ))
}

/// A committed scene.
pub(super) struct Scene {
    embree: &'static Embree,
    device: Handle,
    scene: Handle,
    /// Vertex buffers that Embree reads while the scene exists: three numbers per vertex, and one
    /// more at the end of each mesh, because Embree loads four.
    vertices: Vec<Vec<f32>>,
    /// Owner of the index buffers.
    _geometry: Arc<Geometry>,
    /// Bytes that Embree reports as allocated.
    bytes: Box<AtomicIsize>,
}

// SAFETY: a device and a committed scene may be used, and released, by any thread (Embree's manual,
// "Thread safety").
unsafe impl Send for Scene {}
// SAFETY: queries of a committed scene may run at the same time, and nothing else is done with it.
unsafe impl Sync for Scene {}

unsafe extern "C" fn count(bytes: *mut c_void, change: isize, _: bool) -> bool {
    // SAFETY: the pointer is that of `Scene::bytes`, which outlives the device.
    let bytes = unsafe { &*bytes.cast::<AtomicIsize>() };
    bytes.fetch_add(change, Ordering::Relaxed);
    true
}

impl Scene {
    pub(super) fn new(geometry: &Arc<Geometry>, quality: Quality, robust: bool) -> Result<Self, String> {
        let embree = embree()?;
        let f = &embree.functions;
        let threads = CString::new(format!("threads={}", rayon::current_num_threads()));
        let threads = threads.map_err(|error| error.to_string())?;
        let bytes = Box::new(AtomicIsize::new(0));
        // SAFETY: the text ends with a zero and lives during the call.
        let device = unsafe { (f.new_device)(threads.as_ptr()) };
        if device.is_null() {
            return Err("Embree cannot create a device".to_owned());
        }
        let monitor: *const AtomicIsize = &*bytes;
        // SAFETY: the device is valid; the counter behind the pointer outlives it, see `drop`.
        let scene = unsafe {
            (f.set_monitor)(device, Some(count), monitor.cast_mut().cast());
            (f.new_scene)(device)
        };
        // From here on, dropping `built` releases both.
        let mut built = Self {
            embree,
            device,
            scene,
            vertices: Vec::new(),
            _geometry: geometry.clone(),
            bytes,
        };
        // SAFETY: the scene is valid; the values are those of the header.
        unsafe {
            (f.set_flags)(scene, if robust { FLAG_ROBUST } else { 0 });
            (f.set_scene_quality)(scene, quality as c_int);
        }
        for (number, mesh) in meshes(geometry, f64::INFINITY).unwrap_or_default() {
            built.add(number, mesh, quality);
        }
        // SAFETY: as above.
        let error = unsafe {
            (f.commit_scene)(scene);
            (f.device_error)(device)
        };
        match error {
            0 => Ok(built),
            4 => Err("Embree has run out of memory".to_owned()),
            code => Err(format!("Embree reports the error code {code}")),
        }
    }

    /// `mesh` must be one of `self._geometry`.
    fn add(&mut self, number: u32, mesh: &TriangleMesh, quality: Quality) {
        let f = &self.embree.functions;
        let single = |p: &DVec3| p.as_vec3().to_array();
        let mut vertices: Vec<f32> = mesh.positions.iter().flat_map(single).collect();
        vertices.push(0.0);
        let triangles = &mesh.triangles;
        // SAFETY: device and scene are valid. The buffers hold the stated numbers of elements, and
        // the vertices one number more, so that the last one can be loaded as four. They are
        // neither moved on the heap nor changed, and are dropped after the scene. All indices are
        // below the number of vertices, as meshes promise.
        unsafe {
            let geometry = (f.new_geometry)(self.device, TYPE_TRIANGLE);
            (f.set_geometry_quality)(geometry, quality as c_int);
            let (data, count) = (vertices.as_ptr().cast(), mesh.positions.len());
            (f.set_buffer)(geometry, BUFFER_VERTEX, 0, FORMAT_FLOAT3, data, 0, 12, count);
            let (data, count) = (triangles.as_ptr().cast(), triangles.len());
            (f.set_buffer)(geometry, BUFFER_INDEX, 0, FORMAT_UINT3, data, 0, 12, count);
            (f.commit_geometry)(geometry);
            (f.attach_geometry)(self.scene, geometry, number);
            (f.release_geometry)(geometry);
        }
        self.vertices.push(vertices);
    }

    /// Size in bytes of Embree's memory and of the vertex copies made for it.
    pub(super) fn bytes(&self) -> usize {
        let copies: usize = self
            .vertices
            .iter()
            .map(|vertices| size_of_val(&**vertices))
            .sum();
        self.bytes.load(Ordering::Relaxed).max(0) as usize + copies
    }

    #[inline]
    pub(super) fn intersect(&self, ray: &SingleRay) -> Option<SingleHit> {
        let mut query = RayHit {
            ray: RawRay::new(ray),
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            primitive: INVALID,
            geometry: INVALID,
            instance: [INVALID; 17],
        };
        match self.embree.queries {
            // SAFETY: the scene is committed; ray and context are laid out as the header of version
            // 3 says.
            Queries::Three { intersect, .. } => unsafe {
                intersect(self.scene, &mut Context::new(), &mut query);
            },
            // SAFETY: as above for version 4, whose header allows that there are no further
            // arguments.
            Queries::Four { intersect, .. } => unsafe {
                intersect(self.scene, &mut query, ptr::null());
            },
        }
        (query.geometry != INVALID).then_some(SingleHit {
            id: (query.geometry, query.primitive),
            t: query.ray.far,
            uv: [query.u, query.v],
        })
    }

    #[inline]
    pub(super) fn occluded(&self, ray: &SingleRay) -> bool {
        let mut ray = RawRay::new(ray);
        match self.embree.queries {
            // SAFETY: as in `intersect`.
            Queries::Three { occluded, .. } => unsafe {
                occluded(self.scene, &mut Context::new(), &mut ray);
            },
            // SAFETY: as in `intersect`.
            Queries::Four { occluded, .. } => unsafe {
                occluded(self.scene, &mut ray, ptr::null());
            },
        }
        // Embree sets `far` to minus infinity if the ray is occluded.
        ray.far < 0.0
    }
}

impl RawRay {
    #[inline]
    fn new(ray: &SingleRay) -> Self {
        Self {
            origin: ray.origin,
            near: ray.min,
            direction: ray.direction,
            time: 0.0,
            far: ray.max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }
}

impl Context {
    #[inline]
    fn new() -> Self {
        Self {
            flags: 0,
            filter: ptr::null(),
            instance: [INVALID; 16],
        }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        let f = &self.embree.functions;
        // SAFETY: both are valid and released once; vertices, geometry and counter are dropped
        // after this.
        unsafe {
            (f.release_scene)(self.scene);
            (f.set_monitor)(self.device, None, ptr::null_mut());
            (f.release_device)(self.device);
        }
    }
}
