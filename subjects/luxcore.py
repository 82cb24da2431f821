"""Renders a scene document with LuxCore: luxcore.py SCENE OUTPUT.pfm

Needs `pyluxcore` 2.11 and NumPy. The image has direct light and mirrors, without light between
diffuse surfaces. Every pixel has its sample in the middle: a box filter of 1e-7 pixels. LuxCore
picks one light at random for each sample, so each light is rendered alone and the images are added.
Ambient light is that of the channel ALBEDO.

LuxCore's images are one row lower than the model's, which the offset of the subject states. Some of
its rays pass between two triangles of a mesh: such a pixel is wrong.

LuxCore cannot express lights without falloff, spots with a linear edge, and Phong's highlights;
glass picks one branch at random. This adapter supports the shapes of document.py, as meshes with
720 segments around, the materials matte (also with checkers), mirror and emissive, point and
directional lights, and pinhole cameras.
"""

import contextlib
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import document

# After NumPy: LuxCore replaces the allocator, and NumPy ends the process then. It prints the
# libraries that it loads.
with contextlib.redirect_stdout(None):
    import pyluxcore

SEGMENTS = 720
# Of all meshes, because of the memory and time that they take.
TRIANGLES = 10_000_000
# One sample may be rounded into the next pixel.
SAMPLES = 2
CHANNELS = ("RGB", "ALBEDO", "SAMPLECOUNT")


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def cut(mesh, light):
    """The mesh with edges where the light of a homogeneous point ends by the smooth normals.

    LuxCore gives light only to triangles that face it. Without these edges, the triangles on which
    the light ends would be dark as a whole, or lit.
    """
    if mesh.normals is None:
        return mesh
    facing = np.sum(mesh.normals * (light[:3] - mesh.vertices * light[3]), axis=1)
    lit = (facing > 0)[mesh.faces]
    count = lit.sum(axis=1)
    cut_here = (count == 1) | (count == 2)
    faces, lit = mesh.faces[cut_here], lit[cut_here]
    # The corner that is alone on its side comes first.
    first = np.argmax(lit == (count[cut_here] == 1)[:, None], axis=1)
    rows = np.arange(len(faces))
    a, b, c = (faces[rows, (first + k) % 3] for k in range(3))
    # In one order, so that neighbours have the same points.
    i, j = (function(np.concatenate([a, a]), np.concatenate([b, c])) for function in (np.minimum, np.maximum))
    t = (facing[i] / (facing[i] - facing[j]))[:, None]
    vertices = (1 - t) * mesh.vertices[i] + t * mesh.vertices[j]
    # From the chord to the arc between two tangents.
    below = [np.sum((vertices - mesh.vertices[k]) * mesh.normals[k], axis=1, keepdims=True) * mesh.normals[k] for k in (i, j)]
    vertices = vertices - ((1 - t) * below[0] + t * below[1]) / 2
    normals = (1 - t) * mesh.normals[i] + t * mesh.normals[j]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    p = len(mesh.vertices) + rows
    q = p + len(rows)
    pieces = [mesh.faces[~cut_here], np.stack([a, p, q], 1), np.stack([p, b, c], 1), np.stack([p, c, q], 1)]
    uvs = None if mesh.uvs is None else np.vstack([mesh.uvs, (1 - t) * mesh.uvs[i] + t * mesh.uvs[j]])
    return document.Mesh(np.vstack([mesh.vertices, vertices]), np.vstack(pieces), np.vstack([mesh.normals, normals]), uvs)


def write_ply(path, mesh):
    columns, names = [mesh.vertices], ["x", "y", "z"]
    if mesh.normals is not None:
        columns.append(mesh.normals)
        names += ["nx", "ny", "nz"]
    if mesh.uvs is not None:
        columns.append(mesh.uvs)
        names += ["s", "t"]
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + np.hstack(columns).astype("<f4").tobytes() + faces.tobytes())


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
    lines = ["renderengine.type = PATHCPU", "sampler.type = SOBOL", f"batch.haltspp = {SAMPLES}", "native.threads.count = 1"]
    lines += ["film.filter.type = BOX", "film.filter.width = 1e-7", f"film.width = {scene.width}", f"film.height = {scene.height}"]
    # The last of two diffuse surfaces has no direct light.
    lines += [f"path.pathdepth.total = {bounces + 2}", f"path.pathdepth.specular = {bounces + 1}", "path.pathdepth.diffuse = 2"]
    # By this distance LuxCore moves points off their surface: a few roundings.
    lines += [f"scene.epsilon.min = {numbers([7e-7 * (np.linalg.norm(scene.camera.origin) or 1)])}"]
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


def rendered(scene, meshes, folder, lines, light, bounces):
    """The radiance and the albedo with one light, as arrays of rows from the top.

    `meshes` are meshes, their materials, and whether they stand for curved shapes. Diffuse surfaces
    are black where `light` is None.
    """
    world = pyluxcore.Scene()
    lines = camera(scene.camera) + lines
    for index, (mesh, table, curved) in enumerate(meshes):
        name = f"part{index}"
        path = Path(folder, f"{name}.ply")
        write_ply(path, mesh if light is None or not curved else cut(mesh, light))
        lines += material(name, table, light is not None)
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


def main(source, output):
    scene = document.read(source)
    lights = [light(table) for table in scene.lights]
    meshes = []
    for shape in scene.shapes:
        material("material", shape.material, True)
        value = paint_of(shape.material)
        for part in document.tessellate(shape, SEGMENTS):
            part.uvs = value.coordinates(part, shape.matrix) if isinstance(value, document.Checker) else None
            meshes.append((part.placed(shape.matrix), shape.material, shape.kind != "mesh"))
            if sum(len(mesh.faces) for mesh, *_ in meshes) > TRIANGLES:
                document.skip(f"more than {TRIANGLES} triangles")
    background = ["scene.lights.light.type = constantinfinite", f"scene.lights.light.color = {numbers(scene.background)}"]
    pyluxcore.Init()
    with tempfile.TemporaryDirectory() as folder:
        # One more reflection shows what is beyond the limit.
        total, _ = rendered(scene, meshes, folder, background, None, scene.max_depth + int(scene.beyond.any()))
        if scene.ambient.any():
            total += scene.ambient * rendered(scene, meshes, folder, background, np.array([0, 0, 1, 0]), scene.max_depth)[1]
        for point, lines in lights:
            total += rendered(scene, meshes, folder, lines, point, scene.max_depth)[0]
    document.write_pfm(output, total)


main(*sys.argv[1:])
