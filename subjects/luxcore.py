"""Renders a scene document with LuxCore: luxcore.py SCENE OUTPUT.pfm

Needs `pyluxcore` 2.11 and NumPy. The image has direct light and mirrors, without light between
diffuse surfaces. Every pixel has its sample in the middle: a box filter of 1e-5 pixels. LuxCore picks one light at random for each sample, so each light is rendered alone and the
images are added. Ambient light is that of the channel ALBEDO.

LuxCore's images are one row lower than the model's, which the offset of the subject states.

LuxCore cannot express lights without falloff, spots with a linear edge, and Phong's highlights.
Glass picks one branch at random. This adapter supports the shapes of document.py, as meshes with
512 segments around, the materials matte, mirror and emissive without textures, point and
directional lights, and pinhole cameras.
"""

import math
import sys
import tempfile
import time
from pathlib import Path

# NumPy comes first: after LuxCore, whose library replaces the allocator, the process ends.
import numpy as np  # isort: skip
import pyluxcore

import document

SEGMENTS = 512
CHANNELS = ("RGB", "ALBEDO", "SAMPLECOUNT")


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def write_ply(path, mesh, matrix, uvs):
    """Writes a mesh in world space. `uvs` are texture coordinates or None."""
    vertices = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    names = ["x", "y", "z"]
    if mesh.normals is not None:
        normals = mesh.normals @ np.linalg.inv(matrix[:3, :3])
        vertices = np.hstack([vertices, normals / np.linalg.norm(normals, axis=1, keepdims=True)])
        names += ["nx", "ny", "nz"]
    if uvs is not None:
        vertices = np.hstack([vertices, uvs])
        names += ["s", "t"]
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def paint_of(table):
    """The colour or texture of a shape's material, None where it cannot have a texture."""
    if table["type"] != "matte":
        return None
    return document.paint(document.only(table, "matte", reflectance=0.5)["reflectance"], "matte")


def material(name, table, lit):
    """The lines of a material. Without `lit`, diffuse surfaces are black; with it, none emits."""
    kind = table["type"]
    prefix = f"scene.materials.{name}."
    if kind == "matte":
        value = paint_of(table)
        if not isinstance(value, document.Checker):
            return [f"{prefix}type = matte", f"{prefix}kd = {numbers(value * lit)}"]
        texture = f"scene.textures.{name}."
        # LuxCore's cells are two units of (u, v).
        lines = [f"{texture}type = checkerboard2d", f"{texture}texture1 = {numbers(value.a * lit)}", f"{texture}texture2 = {numbers(value.b * lit)}"]
        return [*lines, f"{texture}mapping.type = uvmapping2d", f"{prefix}type = matte", f"{prefix}kd = {name}"]
    if kind == "mirror":
        color = document.color(document.only(table, kind, reflectance=1)["reflectance"], kind)
        return [f"{prefix}type = mirror", f"{prefix}kr = {numbers(color)}"]
    if kind == "emissive":
        color = document.color(document.only(table, kind, radiance=1)["radiance"], kind)
        lines = [f"{prefix}type = matte", f"{prefix}kd = 0 0 0"]
        return lines if lit else [*lines, f"{prefix}emission = {numbers(color)}"]
    return document.skip(f"a material of type {kind}")


def light(table):
    """The place of a light in homogeneous coordinates, and its lines."""
    kind = table["type"]
    if kind == "point":
        keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
        if keys["falloff"] != "inverse_square":
            document.skip("a light without falloff")
        point = [*keys["position"], 1]
        # The radiant intensity of a point is its power over 4 pi.
        gain = 4 * math.pi * document.color(keys["intensity"], kind)
        lines = ["type = point", f"position = {numbers(keys['position'])}", f"gain = {numbers(gain)}"]
    elif kind == "directional":
        keys = document.only(table, kind, direction=None, irradiance=1)
        point = [*(-np.array(keys["direction"], float)), 0]
        gain = document.color(keys["irradiance"], kind)
        lines = ["type = sharpdistant", f"direction = {numbers(keys['direction'])}", f"gain = {numbers(gain)}"]
    else:
        return document.skip(f"a light of type {kind}")
    return np.array(point, float), [f"scene.lights.light.{line}" for line in [*lines, "color = 1 1 1"]]


def camera(view):
    lines = ["type = perspective", f"lookat.orig = {numbers(view.origin)}", f"lookat.target = {numbers(view.origin - view.w)}"]
    # The window is in units of the tangent of half the angle.
    window = np.array([view.left, view.right, view.bottom, view.top]) / view.distance
    lines += [f"up = {numbers(view.v)}", "fieldofview = 90", f"screenwindow = {numbers(window)}", "autofocus.enable = 0"]
    lines += [f"cliphither = {max(view.near, 1e-4)!r}", "clipyon = 1e9"]
    return [f"scene.camera.{line}" for line in lines]


def properties(lines):
    result = pyluxcore.Properties()
    result.SetFromString("\n".join([*lines, ""]))
    return result


def settings(scene, bounces):
    """The engine, for paths with this number of mirror reflections at most."""
    lines = ["renderengine.type = PATHCPU", "sampler.type = SOBOL", "batch.haltspp = 1", "native.threads.count = 1"]
    lines += ["film.filter.type = BOX", "film.filter.width = 0.00001", f"film.width = {scene.width}", f"film.height = {scene.height}"]
    # The last of two diffuse surfaces has no direct light.
    lines += [f"path.pathdepth.total = {bounces + 2}", f"path.pathdepth.specular = {bounces + 1}", "path.pathdepth.diffuse = 2"]
    lines += ["path.russianroulette.depth = 100000", "path.clamping.variance.maxvalue = 0", "lightstrategy.type = UNIFORM"]
    lines += ["film.imagepipelines.0.0.type = NOP", "film.noiseestimation.warmup = 1000000"]
    for index, kind in enumerate(CHANNELS):
        lines += [f"film.outputs.{index}.type = {kind}", f"film.outputs.{index}.filename = {kind}.exr"]
    return properties(lines)


def channel(film, scene, kind, size, dtype):
    values = np.zeros(scene.width * scene.height * size, dtype)
    read = film.GetOutputFloat if dtype is np.float32 else film.GetOutputUInt
    read(getattr(pyluxcore.FilmOutputType, kind), values, 0)
    return values.reshape(scene.height, scene.width, size)[::-1].astype(float)


def rendered(scene, shapes, folder, lines, point, bounces):
    """The radiance and the albedo with one light, as arrays of rows from the top.

    `point` is the place of a light that makes diffuse surfaces visible, or None: they are black.
    """
    world = pyluxcore.Scene()
    lines = camera(scene.camera) + lines
    for index, shape in enumerate(shapes):
        value = paint_of(shape.material)
        for number, part in enumerate(parts_of(shape, point)):
            name = f"part{index}-{number}"
            path = Path(folder, f"{name}.ply")
            uvs = value.coordinates(part, shape.matrix) if isinstance(value, document.Checker) else None
            write_ply(path, part, shape.matrix, uvs)
            lines += material(name, shape.material, point is not None)
            lines += [f"scene.shapes.{name}.type = mesh", f"scene.shapes.{name}.ply = {path}"]
            lines += [f"scene.objects.{name}.shape = {name}", f"scene.objects.{name}.material = {name}"]
    world.Parse(properties(lines))
    session = pyluxcore.RenderSession(pyluxcore.RenderConfig(settings(scene, bounces), world))
    session.Start()
    while not session.HasDone():
        session.UpdateStats()
        time.sleep(0.005)
    session.Stop()
    film = session.GetFilm()
    if not channel(film, scene, "SAMPLECOUNT", 1, np.uint32).all():
        raise RuntimeError("LuxCore left pixels without a sample")
    return channel(film, scene, "RGB", 3, np.float32), channel(film, scene, "ALBEDO", 3, np.float32)


def parts_of(shape, point):
    """The meshes of a shape. Those of a sphere have an edge where the light of a point ends.

    LuxCore gives light to a triangle that faces it only. Without this edge, triangles at the end of
    the light would be dark.
    """
    if shape.kind != "sphere" or point is None or isinstance(paint_of(shape.material), document.Checker):
        return document.tessellate(shape, SEGMENTS)
    keys = document.only(shape.keys, shape.kind, center=[0, 0, 0], radius=1)
    center = np.array(keys["center"], float)
    toward = np.linalg.solve(shape.matrix, point)
    toward = toward[:3] - center * toward[3]
    distance = np.linalg.norm(toward)
    axis = toward / distance
    edge = math.acos(min(keys["radius"] / distance, 1)) if point[3] else math.pi / 2
    angles = np.sort(np.append(np.pi * np.arange(SEGMENTS // 2 + 1) / (SEGMENTS // 2), edge))[::-1]
    circle = np.stack([np.sin(angles), np.cos(angles)], 1)
    circle[[0, -1], 0] = 0
    mesh = document.revolved(circle, circle, angles, SEGMENTS)
    right = document.unit(np.cross([0, 1, 0] if abs(axis[1]) < 0.9 else [1, 0, 0], axis))
    turn = np.stack([right, np.cross(axis, right), axis])
    return [document.Mesh(mesh.vertices @ turn * keys["radius"] + center, mesh.faces, mesh.normals @ turn)]


def main(source, output):
    scene = document.read(source)
    lights = [light(table) for table in scene.lights]
    for shape in scene.shapes:
        material("material", shape.material, True)
        document.tessellate(shape, 8)
    background = ["scene.lights.light.type = constantinfinite", f"scene.lights.light.color = {numbers(scene.background)}"]
    pyluxcore.Init()
    with tempfile.TemporaryDirectory() as folder:
        # Mirrors show the background at the limit, too.
        total, _ = rendered(scene, scene.shapes, folder, background, None, scene.max_depth + 1)
        if scene.ambient.any():
            total += scene.ambient * rendered(scene, scene.shapes, folder, background, np.array([0, 0, 1, 0]), scene.max_depth)[1]
        for point, lines in lights:
            total += rendered(scene, scene.shapes, folder, lines, point, scene.max_depth)[0]
    document.write_pfm(output, total)


main(*sys.argv[1:])
