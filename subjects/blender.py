"""Renders a scene document with Blender's Cycles: blender.py SCENE OUTPUT.pfm [SAMPLES]

Needs Python 3.11 with `bpy` 4.5. The image has direct light and mirrors, without light between
diffuse surfaces. With one sample, that of every pixel is in the middle: Cycles' narrowest filter is
a hundredth of a pixel wide, so the image is drawn with five by five times the pixels, of which the
middle ones count. More samples are spread over the pixel.
Cycles picks one light at random for each sample, so each light is rendered alone and the images are
added. Ambient light is light that diffuse surfaces emit.

Spots and lights without falloff are points of light whose nodes state the edge and the falloff.
Cycles cannot express Phong's highlights. Its metals have an approximation of Fresnel's equations,
with errors of 4e-4 at 24 degrees; of glass and of partly transparent surfaces it picks one branch
at random. This adapter supports the shapes of document.py, as meshes with 1,024 segments around, the
materials matte (also with checkers), mirror and emissive, point, spot and directional lights, and
pinhole and orthographic cameras.
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
# Columns and rows of the drawn image for each of the image with one sample; odd, for a middle.
FACTOR = 5
# The nodes of surfaces that emit light.
EMISSIONS = []


class Graph:
    """The nodes of a material or a light."""

    def __init__(self, tree):
        self.tree = tree
        tree.nodes.clear()

    def add(self, kind, inputs, **settings):
        """Adds a node. Its inputs are values or outputs of other nodes."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in inputs.items():
            # By its identifier, because a node may have inputs of the same name.
            socket = next(one for one in node.inputs if name in (one.identifier, one.name))
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def math(self, operation, *values):
        node = self.tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    def paint(self, value, factor=1.0):
        """A colour or a Checker, times a factor."""
        if not isinstance(value, document.Checker):
            return (*(value * factor), 1)
        cells = self.add("SeparateXYZ", {"Vector": self.add("UVMap", {}, uv_map="cells").outputs[0]})
        total = self.math("ADD", *(self.math("FLOOR", cells.outputs[axis]) for axis in (0, 1)))
        # 0 in even cells, 1 in odd ones.
        odd = self.math("MULTIPLY", self.math("FRACT", self.math("MULTIPLY", total, 0.5)), 2.0)
        a, b = ((*(color * factor), 1) for color in (value.a, value.b))
        mix = self.add("Mix", {"Factor_Float": odd, "A_Color": a, "B_Color": b}, data_type="RGBA", clamp_factor=False)
        return next(output for output in mix.outputs if output.identifier == "Result_Color")


def checker_of(table):
    """The Checker of a material, or None."""
    value = table.get("reflectance")
    return document.paint(value, "matte") if isinstance(value, dict) and value.get("type") == "checker" else None


def surface(graph, table, ambient):
    """The output of the nodes of a material."""
    kind = table["type"]
    if kind == "matte":
        value = document.paint(document.only(table, kind, reflectance=0.5)["reflectance"], kind)
        diffuse = graph.add("BsdfDiffuse", {"Color": graph.paint(value)}).outputs[0]
        if not ambient.any():
            return diffuse
        glow = graph.add("Emission", {"Color": graph.paint(value, ambient)})
        EMISSIONS.append(glow)
        return graph.add("AddShader", {"Shader": diffuse, "Shader_001": glow.outputs[0]}).outputs[0]
    if kind == "mirror":
        color = document.color(document.only(table, kind, reflectance=1)["reflectance"], kind)
        return graph.add("BsdfGlossy", {"Color": (*color, 1), "Roughness": 0}).outputs[0]
    if kind == "conductor":
        document.skip("metals: it has an approximation of Fresnel's equations")
    if kind == "emissive":
        keys = document.only(table, kind, radiance=1)
        node = graph.add("Emission", {"Color": (*document.color(keys["radiance"], kind), 1)})
        EMISSIONS.append(node)
        return node.outputs[0]
    return document.skip(f"a material of type {kind}")


def material(shape, ambient):
    result = bpy.data.materials.new(shape.name)
    result.use_nodes = True
    graph = Graph(result.node_tree)
    graph.add("OutputMaterial", {"Surface": surface(graph, shape.material, ambient)})
    result.cycles.emission_sampling = "NONE"
    return result


def add(name, data, matrix):
    thing = bpy.data.objects.new(name, data)
    thing.matrix_world = Matrix(matrix)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_shape(shape, ambient):
    look = material(shape, ambient)
    checker = checker_of(shape.material)
    for part in document.tessellate(shape, SEGMENTS):
        mesh = bpy.data.meshes.new(shape.name)
        placed = part.placed(shape.matrix)
        corners = placed.faces.ravel()
        mesh.vertices.add(len(placed.vertices))
        mesh.vertices.foreach_set("co", placed.vertices.astype(np.float32).ravel())
        mesh.loops.add(len(corners))
        mesh.polygons.add(len(placed.faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
        mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
        mesh.update(calc_edges=True)
        mesh.materials.append(look)
        if placed.normals is None:
            mesh.shade_flat()
        else:
            normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
            normals.data.foreach_set("vector", placed.normals.astype(np.float32).ravel())
        if checker:
            cells = checker.coordinates(part, shape.matrix)[placed.faces].astype(np.float32)
            mesh.uv_layers.new(name="cells").uv.foreach_set("vector", cells.ravel())
        # What it emits lights no surface: neither by samples of it nor by rays that hit it.
        add(shape.name, mesh, np.eye(4)).visible_diffuse = False


def set_power(light, factor, color):
    """Sets a light's energy and its colour, whose components are at most 1."""
    light.energy = factor * color.max()
    light.color = color / max(color.max(), 1e-30)


def add_point(table, kind, keys):
    """A point of light, whose nodes state the falloff and the edge of a spot."""
    light = bpy.data.lights.new(kind, "POINT")
    # The radiant intensity of a point is its power over 4 pi.
    set_power(light, 4 * math.pi, document.color(keys["intensity"], kind))
    light.shadow_soft_size = 0
    matrix = np.eye(4)
    matrix[:3, 3] = keys["position"]
    if kind == "point" and keys["falloff"] == "inverse_square":
        return light, matrix
    light.use_nodes = True
    graph = Graph(light.node_tree)
    strength = 1.0
    if keys["falloff"] != "inverse_square":
        strength = graph.add("LightFalloff", {"Strength": 1.0}).outputs["Constant"]
    if kind == "spot":
        forward = document.unit(np.array(keys["target"], float) - np.array(keys["position"], float))
        cutoff = math.radians(keys["cutoff_angle"])
        beam = 0.75 * cutoff if keys["beam_width"] is None else math.radians(keys["beam_width"])
        matrix[:3, :3] = facing(-forward)
        # The direction from the light, in its own space; its axis is -z.
        away = graph.add("SeparateXYZ", {"Vector": graph.add("TexCoord", {}).outputs["Normal"]})
        # Not by the cosine, which hardly changes near the axis.
        across = graph.math("SQRT", graph.math("ADD", *(graph.math("POWER", away.outputs[axis], 2.0) for axis in (0, 1))))
        angle = graph.math("ARCTAN2", across, graph.math("MULTIPLY", away.outputs[2], -1.0))
        edge = graph.math("DIVIDE", graph.math("SUBTRACT", cutoff, angle), cutoff - beam)
        edge = graph.math("MINIMUM", graph.math("MAXIMUM", edge, 0.0), 1.0)
        strength = graph.math("MULTIPLY", edge, strength)
    graph.add("OutputLight", {"Surface": graph.add("Emission", {"Strength": strength}).outputs[0]})
    return light, matrix


def facing(backwards):
    """A rotation that takes z to this direction."""
    helper = [0, 1, 0] if abs(backwards[1]) < 0.9 else [1, 0, 0]
    right = document.unit(np.cross(helper, backwards))
    return np.stack([right, np.cross(backwards, right), backwards], 1)


def add_light(table):
    kind = table["type"]
    if kind == "point":
        keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
        return add(kind, *add_point(table, kind, keys))
    if kind == "spot":
        known = {"position": None, "target": None, "intensity": 1, "cutoff_angle": 20, "beam_width": None, "falloff": "inverse_square"}
        return add(kind, *add_point(table, kind, document.only(table, kind, **known)))
    if kind == "directional":
        keys = document.only(table, kind, direction=None, irradiance=1)
        light = bpy.data.lights.new(kind, "SUN")
        set_power(light, 1, document.color(keys["irradiance"], kind))
        light.angle = 0
        matrix = np.eye(4)
        matrix[:3, :3] = facing(-document.unit(np.array(keys["direction"], float)))
        return add(kind, light, matrix)
    return document.skip(f"a light of type {kind}")


def add_camera(scene, settings):
    view = scene.camera
    camera = bpy.data.cameras.new("camera")
    width, height = view.right - view.left, view.top - view.bottom
    camera.sensor_fit = "HORIZONTAL"
    matrix, near = view.matrix, view.near
    if view.parallel:
        camera.type, camera.ortho_scale = "ORTHO", width
        # A near limit may be behind the camera.
        matrix[:3, 3] -= near * view.w
        near = 0
    else:
        camera.angle_x = 2 * math.atan(width / (2 * view.distance))
    # The shifts are in units of the width of the window.
    camera.shift_x = (view.left + view.right) / (2 * width)
    camera.shift_y = (view.bottom + view.top) / (2 * width)
    camera.clip_start = max(near, 1e-6)
    camera.clip_end = 1e9
    settings.camera = add("camera", camera, matrix)
    settings.render.pixel_aspect_x = width / scene.width
    settings.render.pixel_aspect_y = height / scene.height


def rendered(settings, scene, factor):
    """Renders the scene as it is, as an array of rows from the top."""
    width, height = scene.width * factor, scene.height * factor
    with tempfile.TemporaryDirectory() as folder:
        settings.render.filepath = str(Path(folder, "image.exr"))
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(settings.render.filepath)
        pixels = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(pixels)
    middle = factor // 2
    return pixels.reshape(height, width, 4)[middle::factor, middle::factor, :3][::-1].astype(float)


def main(source, output, samples):
    scene = document.read(source, cameras=("perspective", "orthographic"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    settings = bpy.context.scene
    # First, because it adds the properties of Cycles.
    settings.render.engine = "CYCLES"
    for shape in scene.shapes:
        add_shape(shape, scene.ambient)
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
    # No path ends at random before.
    cycles.min_light_bounces = scene.max_depth
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01 if samples == 1 else 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    factor = FACTOR if samples == 1 else 1
    render.resolution_x, render.resolution_y = scene.width * factor, scene.height * factor
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGB"
    render.film_transparent = False
    render.use_persistent_data = True
    settings.view_settings.view_transform = "Raw"
    for light in lights:
        light.hide_render = True
    total = rendered(settings, scene, factor)
    for node in [world.node_tree.nodes["Background"], *EMISSIONS]:
        node.inputs["Strength"].default_value = 0
    for light in lights:
        light.hide_render = False
        total += rendered(settings, scene, factor)
        light.hide_render = True
    document.write_pfm(output, total)


main(*sys.argv[1:3], samples=int(*sys.argv[3:] or ["1"]))
