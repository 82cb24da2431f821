//! What plugins may ask for while they are built.

use crate::builder::{Builder, Key};
use crate::operands;
use std::any::Any;
use std::path::PathBuf;
use std::sync::Arc;
use whitstone_core::config::{
    FilePath, GroupRef, MaterialRef, PluginRef, SolidRef, TextureRef, TextureValue,
};
use whitstone_core::{
    ClosedMesh, ColorSource, Diagnostics, FamilyName, Group, LoweredShape, Material, Resources, SceneError,
    SceneErrors, Shape, Shapes, Storage, Texture, Textures, Transform, TriangleMesh,
};
use whitstone_scene::PluginTable;

impl Resources for Builder<'_, '_, '_> {
    fn texture(&mut self, reference: &TextureRef) -> Result<ColorSource, SceneErrors> {
        let span = reference.span.clone().unwrap_or(0..0);
        let key = match &reference.value {
            TextureValue::Constant(color) => return Ok(ColorSource::Constant(*color)),
            TextureValue::Plugin(reference) => Key::from(reference),
        };
        let texture = self.shared_texture(key, &span)?;
        Ok(match texture.constant() {
            Some(color) => ColorSource::Constant(color),
            None => ColorSource::Texture(texture),
        })
    }

    fn material(&mut self, reference: &MaterialRef) -> Result<Arc<dyn Material>, SceneErrors> {
        let material = self.shared_material(&reference.material, &reference.span)?;
        if material.prioritized().is_some() {
            let message = "a material with a priority must belong to a shape, not to another material";
            return Err(SceneError::at(reference.span.clone(), message).into());
        }
        Ok(material)
    }

    fn file(&self, file: &FilePath) -> Result<PathBuf, SceneError> {
        let path = self.description.sources.path_of(file);
        let fail = |why: String| {
            let error = SceneError::at(file.span.clone(), format!("cannot read \"{}\": {why}", file.path));
            Err(error.with_help(format!("looked for {}", path.display())))
        };
        match std::fs::metadata(&path) {
            Err(error) => fail(error.to_string()),
            Ok(metadata) if !metadata.is_file() => fail("not a regular file".to_owned()),
            Ok(_) => Ok(path),
        }
    }

    fn image(&mut self, file: &FilePath) -> Result<Arc<dyn Texture>, SceneErrors> {
        let kind = self.registry.default_type(FamilyName::Texture)?;
        let table = PluginTable::of_file(kind, file, &[("wrap", "clamp")]);
        let built = self.plugin::<Textures>(&table, ())?;
        self.looked_up.add(None, &table.name, &built);
        Ok(built)
    }

    fn triangles(&mut self, file: &FilePath, transform: &Transform) -> Result<TriangleMesh, SceneErrors> {
        let kind = self.registry.default_type(FamilyName::Shape)?;
        match self.plugin::<Shapes>(&PluginTable::of_file(kind, file, &[]), *transform)? {
            LoweredShape::Triangles(mesh) => Ok(mesh),
            _ => Err(SceneError::at(file.span.clone(), "expected a triangle mesh").into()),
        }
    }

    fn group(&self, group: &GroupRef) -> Result<Arc<Group>, SceneErrors> {
        // The planning or build step has already reported why one is missing.
        let found = self.groups.get(group.id.as_str());
        found
            .map(|built| built.group.clone())
            .ok_or_else(SceneErrors::default)
    }

    fn solid(&mut self, operand: &SolidRef, around: &Transform) -> Result<Box<dyn Shape>, SceneErrors> {
        let description = self.description;
        let table = match &operand.shape {
            PluginRef::Inline(index) => (index, description.inline.get(*index)),
            PluginRef::Shared(_) => return Err(operands::no_id(operand).into()),
        };
        // Tables that could not be read have already been reported.
        let (index, Some(table)) = table else {
            return Err(SceneErrors::default());
        };
        if self.faulty_operands.contains(index) {
            return Err(SceneErrors::default());
        }
        let (plugin, transform) = self.operands.enter(table, operand, around)?;
        let built = self.plugin::<Shapes>(&plugin, transform);
        self.operands.leave();
        let shape = built.inspect_err(|_| {
            self.faulty_operands.insert(*index);
        })?;
        if let LoweredShape::Triangles(mesh) = &shape {
            self.memory.take(ClosedMesh::bytes(mesh))?;
        }
        operands::solid(shape, &plugin)
    }

    fn expected_rays(&self) -> Option<u64> {
        self.expected_rays
    }
}

impl Storage for Builder<'_, '_, '_> {
    fn reserve(&mut self, bytes: u64) -> Result<(), SceneErrors> {
        Ok(self.memory.take(bytes)?)
    }

    fn reservable(&self) -> u64 {
        self.memory.left().unwrap_or(u64::MAX)
    }

    fn shared(&self, key: &str) -> Option<Arc<dyn Any + Send + Sync>> {
        match self.options.shared {
            Some(shared) => shared.get(key),
            None => self.shared.get(key),
        }
    }

    fn share(&mut self, key: String, data: Arc<dyn Any + Send + Sync>) {
        match self.options.shared {
            Some(shared) => shared.insert(key, data),
            None => self.shared.insert(key, data),
        }
    }

    fn cached(&self, parts: &[&[u8]], length: usize) -> Option<Vec<u8>> {
        self.options.cache?.cached(parts, length)
    }

    fn cache(&mut self, parts: &[&[u8]], made: &[u8]) {
        if let Some(cache) = self.options.cache {
            cache.cache(parts, made);
        }
    }
}

impl Diagnostics for Builder<'_, '_, '_> {
    fn warn(&mut self, warning: SceneError) {
        self.warnings.push(warning);
    }
}
