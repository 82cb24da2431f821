//! What a plugin may use of the scene and of the program while it is built.

use crate::config::{FilePath, GroupRef, MaterialRef, SolidRef, TextureRef};
use crate::{ColorSource, Group, Material, SceneError, SceneErrors, Shape, Texture, Transform, TriangleMesh};
use std::any::Any;
use std::path::PathBuf;
use std::sync::Arc;

/// What a plugin may use while it is built. Plugins call the methods of all three parts on it.
pub trait Context: Resources + Storage + Diagnostics {}

impl<T: Resources + Storage + Diagnostics> Context for T {}

/// The parts of the scene, and the files, that a plugin refers to, and how much it will be used.
pub trait Resources {
    /// The texture or constant that a parameter refers to. A shared texture is built once.
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors>;

    /// The material that a parameter refers to. A shared material is built once; a material that
    /// contains itself is an error.
    fn material(&mut self, reference: &MaterialRef) -> Result<Arc<dyn Material>, SceneErrors> {
        Err(SceneError::at(reference.span.clone(), "materials are not available here").into())
    }

    /// The path of a file that a parameter names. The file exists and is a regular file.
    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError>;

    /// The image in a file, as the registry's default texture type reads it with `wrap = "clamp"`.
    /// Errors are reported at the file.
    fn image(&mut self, file: &FilePath) -> Result<Arc<dyn Texture>, SceneErrors> {
        Err(SceneError::at(file.span.clone(), "images are not available here").into())
    }

    /// The triangles of a mesh file in world space, as the registry's default shape reads them.
    /// Errors are reported at the file.
    fn triangles(&mut self, file: &FilePath, transform: &Transform) -> Result<TriangleMesh, SceneErrors> {
        let _ = transform;
        Err(SceneError::at(file.span.clone(), "meshes are not available here").into())
    }

    /// The group of shapes that a parameter names. It is built once, however many instances it has.
    fn group(&self, group: &GroupRef) -> Result<Arc<Group>, SceneErrors> {
        Err(group.no_groups().into())
    }

    /// The solid that is an operand of a shape with transform `around`. The operand's own transform
    /// is applied first. An operand that bounds no volume is an error, reported at the operand.
    fn solid(&mut self, operand: &SolidRef, around: &Transform) -> Result<Box<dyn Shape>, SceneErrors> {
        let _ = around;
        Err(SceneError::at(operand.span.clone(), "operands are not available here").into())
    }

    /// About how many rays will be traced, if that is known and small enough to matter: an
    /// accelerator may then build faster. No answer may depend on it.
    fn expected_rays(&self) -> Option<u64> {
        None
    }
}

/// Memory limits, and results that are kept between runs.
pub trait Storage {
    /// Announces an allocation of `bytes` bytes; fails if it exceeds the memory limit. Call
    /// it for sizes that depend on a number in the scene or on a file; small allocations need no
    /// call.
    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        let _ = bytes;
        Ok(())
    }

    /// The bytes that can be reserved before the memory limit is reached.
    fn reservable(&self) -> u64 {
        u64::MAX
    }

    /// Data that an earlier plugin of the same scene shared under this key with [`Self::share`],
    /// such as the texels of a file. The key names the type of the data, and everything that the
    /// data depends on.
    fn shared(&self, key: &str) -> Option<Arc<dyn Any + Send + Sync>> {
        let _ = key;
        None
    }

    /// Shares data with the plugins that are built later. It is kept until the scene is built.
    fn share(&mut self, key: String, data: Arc<dyn Any + Send + Sync>) {
        let _ = (key, data);
    }

    /// Looks up a cached result of `length` bytes; `None` if there is none. The parts of the key
    /// are all the input of the result, and a name with a version.
    fn cached(&self, key: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        let _ = (key, length);
        None
    }

    /// Caches a result under a key for later runs, if caching is enabled. For results that take
    /// longer to compute than to read.
    fn cache(&mut self, key: &[&[u8]], result: &[u8]) {
        let _ = (key, result);
    }
}

/// Messages that do not stop the build.
pub trait Diagnostics {
    /// Reports a warning to the user.
    fn warn(&mut self, warning: SceneError);
}
