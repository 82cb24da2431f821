"""Renders a scene document with Blender's Cycles: blender.py SCENE OUTPUT.pfm [SAMPLES]

Needs Python 3.11 with `bpy` 4.5. The image has direct light and mirrors, without light between
diffuse surfaces. With one sample, that of every pixel is in the middle: a box filter of a hundredth
of a pixel. More samples are spread over the pixel.
Cycles picks one light at random for each sample, so each light is rendered alone and the images are
added.

Cycles cannot express lights without falloff and spots with a linear edge. This adapter supports the
shapes of document.py, as meshes with 1,024 segments around, the materials matte, mirror and
emissive without textures, point and directional lights, and pinhole cameras.
"""

import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

import document

SEGMENTS = 1024
# The nodes of surfaces that emit light.
EMISSIONS = []


def material(table, name):
    result = bpy.data.materials.new(name)
    result.use_nodes = True
    nodes = result.node_tree.nodes
    nodes.clear()
    kind = table["type"]
    if kind == "matte":
        keys = document.only(table, kind, reflectance=0.5)
        node = nodes.new("ShaderNodeBsdfDiffuse")
        node.inputs["Color"].default_value = (*document.color(keys["reflectance"], kind), 1)
    elif kind == "mirror":
        keys = document.only(table, kind, reflectance=1)
        node = nodes.new("ShaderNodeBsdfGlossy")
        node.inputs["Color"].default_value = (*document.color(keys["reflectance"], kind), 1)
        node.inputs["Roughness"].default_value = 0
    elif kind == "emissive":
        keys = document.only(table, kind, radiance=1)
        node = nodes.new("ShaderNodeEmission")
        node.inputs["Color"].default_value = (*document.color(keys["radiance"], kind), 1)
        EMISSIONS.append(node)
    else:
        document.skip(f"a material of type {kind}")
    output = nodes.new("ShaderNodeOutputMaterial")
    result.node_tree.links.new(node.outputs[0], output.inputs["Surface"])
    if kind == "emissive":
        # It lights nothing.
        result.cycles.emission_sampling = "NONE"
    return result


def add(name, data, matrix):
    thing = bpy.data.objects.new(name, data)
    thing.matrix_world = Matrix(matrix)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_shape(shape):
    for part in document.tessellate(shape, SEGMENTS):
        mesh = bpy.data.meshes.new(shape.name)
        vertices = part.vertices @ shape.matrix[:3, :3].T + shape.matrix[:3, 3]
        mesh.from_pydata(vertices.tolist(), [], part.faces.tolist())
        mesh.materials.append(material(shape.material, shape.name))
        if part.normals is not None:
            mesh.polygons.foreach_set("use_smooth", np.ones(len(part.faces), bool))
            normals = part.normals @ np.linalg.inv(shape.matrix[:3, :3])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            mesh.normals_split_custom_set_from_vertices(normals.tolist())
        add(shape.name, mesh, np.eye(4))


def set_power(light, factor, color):
    """Sets a light's energy and its colour, whose components are at most 1."""
    light.energy = factor * color.max()
    light.color = color / max(color.max(), 1e-30)


def add_light(table):
    kind = table["type"]
    matrix = np.eye(4)
    if kind == "point":
        keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
        if keys["falloff"] != "inverse_square":
            document.skip("a light without falloff")
        light = bpy.data.lights.new(kind, "POINT")
        # The radiant intensity of a point is its power over 4 pi.
        set_power(light, 4 * math.pi, document.color(keys["intensity"], kind))
        light.shadow_soft_size = 0
        matrix[:3, 3] = keys["position"]
    elif kind == "directional":
        keys = document.only(table, kind, direction=None, irradiance=1)
        light = bpy.data.lights.new(kind, "SUN")
        set_power(light, 1, document.color(keys["irradiance"], kind))
        light.angle = 0
        backwards = -document.unit(np.array(keys["direction"], float))
        helper = [0, 1, 0] if abs(backwards[1]) < 0.9 else [1, 0, 0]
        right = document.unit(np.cross(helper, backwards))
        matrix[:3, :3] = np.stack([right, np.cross(backwards, right), backwards], 1)
    else:
        document.skip(f"a light of type {kind}")
    return add(kind, light, matrix)


def add_camera(scene, settings):
    view = scene.camera
    camera = bpy.data.cameras.new("camera")
    width, height = view.right - view.left, view.top - view.bottom
    camera.sensor_fit = "HORIZONTAL"
    camera.angle_x = 2 * math.atan(width / (2 * view.distance))
    # The shifts are in units of the width of the window.
    camera.shift_x = (view.left + view.right) / (2 * width)
    camera.shift_y = (view.bottom + view.top) / (2 * width)
    camera.clip_start = max(view.near, 1e-6)
    camera.clip_end = 1e9
    settings.camera = add("camera", camera, view.matrix)
    settings.render.pixel_aspect_x = width / scene.width
    settings.render.pixel_aspect_y = height / scene.height


def rendered(settings, scene):
    """Renders the scene as it is, as an array of rows from the top."""
    with tempfile.TemporaryDirectory() as folder:
        settings.render.filepath = str(Path(folder, "image.exr"))
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(settings.render.filepath)
        pixels = np.empty(4 * scene.width * scene.height, np.float32)
        image.pixels.foreach_get(pixels)
    return pixels.reshape(scene.height, scene.width, 4)[::-1, :, :3].astype(float)


def main(source, output, samples):
    scene = document.read(source)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    settings = bpy.context.scene
    # First, because it adds the properties of Cycles.
    settings.render.engine = "CYCLES"
    if scene.ambient.any():
        document.skip("ambient light")
    for shape in scene.shapes:
        add_shape(shape)
    lights = [add_light(light) for light in scene.lights]
    add_camera(scene, settings)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*scene.background, 1)
    # The background is seen, and lights no surface.
    world.cycles.sampling_method = "NONE"
    world.cycles_visibility.diffuse = False
    settings.world = world
    render, cycles = settings.render, settings.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.glossy_bounces = cycles.transmission_bounces = scene.max_depth
    cycles.diffuse_bounces = 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01 if samples == 1 else 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    render.resolution_x, render.resolution_y = scene.width, scene.height
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGB"
    render.film_transparent = False
    render.use_persistent_data = True
    settings.view_settings.view_transform = "Raw"
    for light in lights:
        light.hide_render = True
    total = rendered(settings, scene)
    for node in [world.node_tree.nodes["Background"], *EMISSIONS]:
        node.inputs["Strength"].default_value = 0
    for light in lights:
        light.hide_render = False
        total += rendered(settings, scene)
        light.hide_render = True
    document.write_pfm(output, total)


main(*sys.argv[1:3], samples=int(*sys.argv[3:] or ["1"]))
