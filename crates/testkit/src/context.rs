//! Building a plugin without a scene.

use std::any::Any;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use whitstone_core::config::{
    FilePath, GroupRef, MaterialRef, PluginRef, SolidRef, TextureRef, TextureValue,
};
use whitstone_core::{
    ColorSource, DVec3, Diagnostics, Family, Group, LoweredShape, Material, Materials, Plugin, Registry,
    Resources, SceneError, SceneErrors, Shape, Shapes, Storage, Texture, Transform, TriangleMesh,
};

/// Builds an operand inside a shape with the given transform.
type Operand = Rc<dyn Fn(&Transform) -> Result<LoweredShape, SceneErrors>>;

/// A [`whitstone_core::Context`] for tests: constants as textures, files of one folder, and groups,
/// materials, textures and operands by id. Collects warnings.
#[derive(Clone, Default)]
pub struct TestContext {
    /// The folder that files are relative to; by default the working directory of the tests.
    pub folder: PathBuf,
    /// Bytes of memory that plugins have reserved.
    pub reserved: u64,
    /// The bytes that they may reserve; by default any number.
    pub limit: Option<u64>,
    /// Data that plugins share.
    shared: BTreeMap<String, Arc<dyn Any + Send + Sync>>,
    /// Groups by id.
    pub groups: BTreeMap<String, Arc<Group>>,
    /// Materials by id.
    materials: BTreeMap<String, Arc<dyn Material>>,
    /// Textures by id.
    textures: BTreeMap<String, Arc<dyn Texture>>,
    /// Pictures by file name.
    pictures: BTreeMap<String, Arc<dyn Texture>>,
    /// Meshes by file name, in object space.
    meshes: BTreeMap<String, TriangleMesh>,
    /// Operands by id.
    operands: BTreeMap<String, Operand>,
    /// Cached results of plugins, by their cache keys.
    pub kept: BTreeMap<Vec<Vec<u8>>, Vec<u8>>,
    /// The warnings of plugins.
    pub warnings: Vec<SceneError>,
}

impl TestContext {
    /// A context whose files are relative to `folder`.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
            ..Self::default()
        }
    }

    /// Adds a material that other materials can refer to.
    ///
    /// # Panics
    ///
    /// If it cannot be built.
    #[must_use]
    pub fn with_material<P: Plugin<Materials>>(mut self, id: &str, text: &str) -> Self {
        let material = build_in::<Materials, P>(text, (), &mut self);
        self.materials.insert(
            id.to_owned(),
            material.expect("the material of the test is valid"),
        );
        self
    }

    /// Adds a texture that plugins can refer to.
    #[must_use]
    pub fn with_texture(mut self, id: &str, texture: impl Texture + 'static) -> Self {
        self.textures.insert(id.to_owned(), Arc::new(texture));
        self
    }

    /// Adds a texture that represents the image in the file `name`.
    #[must_use]
    pub fn with_picture(mut self, name: &str, texture: impl Texture + 'static) -> Self {
        self.pictures.insert(name.to_owned(), Arc::new(texture));
        self
    }

    /// Adds the triangles of the mesh file `name`, in object space and without normals.
    #[must_use]
    pub fn with_mesh(mut self, name: &str, positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        let mesh = TriangleMesh {
            positions,
            normals: Vec::new(),
            uvs: Vec::new(),
            triangles,
            orientation: 1.0,
            attributes: None,
        };
        self.meshes.insert(name.to_owned(), mesh);
        self
    }

    /// Adds a shape that plugins can refer to as an operand; `id` stands for the inline table of a
    /// scene.
    ///
    /// # Panics
    ///
    /// When it is built, if its transform is singular combined with that of the enclosing shape.
    #[must_use]
    pub fn with_operand<P: Plugin<Shapes> + 'static>(mut self, id: &str, text: &str, own: Transform) -> Self {
        let text = text.to_owned();
        // Operands inside operands are those added to this context so far.
        let inside = self.clone();
        let build = move |around: &Transform| {
            let placed = around.after(&own).expect("the combined transform is invertible");
            build_in::<Shapes, P>(&text, placed, &mut inside.clone())
        };
        self.operands.insert(id.to_owned(), Rc::new(build));
        self
    }
}

fn owned(parts: &[&[u8]]) -> Vec<Vec<u8>> {
    parts.iter().map(|part| part.to_vec()).collect()
}

impl Resources for TestContext {
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors> {
        match &reference.value {
            TextureValue::Constant(value) => Ok(ColorSource::Constant(*value)),
            TextureValue::Plugin(PluginRef::Shared(id)) if self.textures.contains_key(id) => {
                Ok(ColorSource::Texture(self.textures[id].clone()))
            }
            TextureValue::Plugin(_) => {
                Err(SceneError::anywhere("this test context has no inline textures").into())
            }
        }
    }

    fn material(&mut self, reference: &MaterialRef) -> Result<Arc<dyn Material>, SceneErrors> {
        let found = match &reference.material {
            PluginRef::Shared(id) => self.materials.get(id).cloned(),
            PluginRef::Inline(_) => None,
        };
        found.ok_or_else(|| {
            SceneError::at(reference.span.clone(), "the test context has no such material").into()
        })
    }

    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError> {
        let path = self.folder.join(&file.path);
        if path.is_file() {
            return Ok(path);
        }
        let message = format!("expected a regular file, found none at \"{}\"", file.path);
        Err(SceneError::at(file.span.clone(), message))
    }

    fn image(&mut self, file: &FilePath) -> Result<Arc<dyn Texture>, SceneErrors> {
        let found = self.pictures.get(&file.path).cloned();
        found.ok_or_else(|| SceneError::at(file.span.clone(), "the test context has no such image").into())
    }

    fn triangles(&mut self, file: &FilePath, transform: &Transform) -> Result<TriangleMesh, SceneErrors> {
        let found = self.meshes.get(&file.path).cloned();
        let mut mesh =
            found.ok_or_else(|| SceneError::at(file.span.clone(), "the test context has no such mesh"))?;
        for position in &mut mesh.positions {
            *position = transform.point_to_world(*position);
        }
        mesh.orientation = transform.world_from_object().matrix3.determinant().signum();
        Ok(mesh)
    }

    fn group(&self, group: &GroupRef) -> Result<Arc<Group>, SceneErrors> {
        let found = self.groups.get(&group.id).cloned();
        found.ok_or_else(|| group.no_groups().into())
    }

    fn solid(&mut self, operand: &SolidRef, around: &Transform) -> Result<Box<dyn Shape>, SceneErrors> {
        let build = match &operand.shape {
            PluginRef::Shared(id) => self.operands.get(id),
            PluginRef::Inline(_) => None,
        };
        let Some(build) = build else {
            return Err(SceneError::at(operand.span.clone(), "the test context has no such operand").into());
        };
        let error = |_| SceneError::at(operand.span.clone(), "the operand is not a solid").into();
        build(around)?.into_solid().map_err(error)
    }
}

impl Storage for TestContext {
    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        if let Some(limit) = self.limit
            && bytes > self.reservable()
        {
            let message = format!("{bytes} bytes do not fit into what is left of {limit} bytes");
            return Err(SceneError::anywhere(message).into());
        }
        self.reserved += bytes;
        Ok(())
    }

    fn reservable(&self) -> u64 {
        self.limit
            .map_or(u64::MAX, |limit| limit.saturating_sub(self.reserved))
    }

    fn shared(&self, key: &str) -> Option<Arc<dyn Any + Send + Sync>> {
        self.shared.get(key).cloned()
    }

    fn share(&mut self, key: String, data: Arc<dyn Any + Send + Sync>) {
        self.shared.insert(key, data);
    }

    fn cached(&self, parts: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        let found = self.kept.get(&owned(parts)).cloned();
        found.filter(|made| made.len() == length)
    }

    fn cache(&mut self, parts: &[&[u8]], made: &[u8]) {
        self.kept.insert(owned(parts), made.to_vec());
    }
}

impl Diagnostics for TestContext {
    fn warn(&mut self, warning: SceneError) {
        self.warnings.push(warning);
    }
}

/// Builds a plugin from the text of its table.
pub fn build<F: Family, P: Plugin<F>>(text: &str, input: F::Input<'_>) -> Result<F::Product, SceneErrors> {
    build_in::<F, P>(text, input, &mut TestContext::default())
}

/// Builds a plugin from the text of its table, in a context that the test can inspect afterwards.
pub fn build_in<F: Family, P: Plugin<F>>(
    text: &str,
    input: F::Input<'_>,
    context: &mut TestContext,
) -> Result<F::Product, SceneErrors> {
    let mut registry = Registry::default();
    registry
        .add::<F, P>("testkit")
        .map_err(|error| SceneError::anywhere(error.to_string()))?;
    let table = toml::de::DeTable::parse(text).map_err(|error| SceneError::anywhere(error.to_string()))?;
    registry.build::<F>(P::TYPE, &table, input, context)
}
