"""Renders a scene document with Mitsuba 3: mitsuba_stock.py SCENE OUTPUT.pfm [SAMPLES SEED]

Needs `mitsuba` 3.9. Mitsuba's own C++ integrators follow rays through the middle of each pixel:
`direct` in scenes without mirrors and glass, `path` in scenes of nothing else. `direct` picks one
light at random for each sample, so each light is rendered alone and the images are added. Ambient
light is that of the channel `albedo`.

Of glass, `path` picks one branch at random: such scenes need SAMPLES and a SEED, and the subject
needs `runs`. All others need one sample and have no noise.

Mitsuba cannot express, in its own plugins, lights without falloff, Phong's highlights, surfaces
that emit on both sides, mirrors that show diffuse surfaces without light between those, and a
background that lights no surface; the background of scenes with diffuse surfaces is what camera
rays see that hit nothing. This adapter supports the shapes of document.py, the materials matte
(also with checkers), mirror, conductor and dielectric, point, spot and directional lights, and
pinhole and orthographic cameras.
"""

import sys

import mitsuba as mi
import numpy as np

import document

mi.set_variant("scalar_rgb")
SEGMENTS = 720
SPECULAR = ("mirror", "conductor", "dielectric")
# Longer than any path, so that none ends at random.
NO_ROULETTE = 1_000_000
IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
# Mitsuba's own shapes, and what takes their texture coordinates to those of the document. Boxes have
# others on each face.
OWN_SHAPES = {
    "sphere": ("sphere", [[1, 0, 0], [0, -1, 1], [0, 0, 1]]),
    "rectangle": ("rectangle", IDENTITY),
    "disk": ("disk", IDENTITY),
    "box": ("cube", IDENTITY),
}


def rgb(value):
    return {"type": "rgb", "value": [float(part) for part in np.broadcast_to(value, 3)]}


def two_sided(nested):
    return {"type": "twosided", "nested": nested}


def checker_of(table):
    """The Checker of a material, or None."""
    value = table.get("reflectance")
    return document.paint(value, "matte") if isinstance(value, dict) and value.get("type") == "checker" else None


def in_cells(value, uv):
    """What takes Mitsuba's texture coordinates to those of a checkerboard: 0 to 1 is two by two cells.

    `uv` takes them to the coordinates of the document.
    """
    matrix = np.eye(3)
    matrix[:2] = value.matrix[:2, [0, 1, 3]] @ uv / 2
    return mi.ScalarTransform3f(matrix)


def material(table, uv=None):
    """The plugin of a material. Without `uv`, a mesh has the coordinates of the checkerboard."""
    kind = table["type"]
    if kind == "matte":
        value = document.paint(document.only(table, kind, reflectance=0.5)["reflectance"], kind)
        if isinstance(value, document.Checker):
            reflectance = {"type": "checkerboard", "color0": rgb(value.a), "color1": rgb(value.b)}
            if uv is not None:
                reflectance["to_uv"] = in_cells(value, uv)
        else:
            reflectance = rgb(value)
        return two_sided({"type": "diffuse", "reflectance": reflectance})
    if kind == "mirror":
        color = document.color(document.only(table, kind, reflectance=1)["reflectance"], kind)
        return two_sided({"type": "conductor", "material": "none", "specular_reflectance": rgb(color)})
    if kind == "conductor":
        keys = document.only(table, kind, eta=None, k=None, metal=None, tint=1)
        eta, k = document.index_of(keys)
        tint = rgb(document.color(keys["tint"], kind))
        return two_sided({"type": "conductor", "eta": rgb(eta), "k": rgb(k), "specular_reflectance": tint})
    if kind == "dielectric":
        keys = document.only(table, kind, interior_ior=1.5, exterior_ior=1)
        return {"type": "dielectric", "int_ior": float(keys["interior_ior"]), "ext_ior": float(keys["exterior_ior"])}
    return document.skip(f"a material of type {kind}")


def shape(one):
    """The plugins of a shape: Mitsuba's own where it has one, otherwise meshes."""
    transform = mi.ScalarTransform4f(one.matrix)
    checker = checker_of(one.material)
    if one.kind in OWN_SHAPES and not (checker and (checker.solid or one.kind == "box")):
        keys = document.only(one.keys, one.kind, **({"center": [0, 0, 0], "radius": 1} if one.kind == "sphere" else {}))
        plugin, uv = OWN_SHAPES[one.kind]
        return [{"type": plugin, "to_world": transform, "bsdf": material(one.material, np.array(uv)), **keys}]
    return [mesh(part, one, {"bsdf": material(one.material)}, checker) for part in document.tessellate(one, SEGMENTS)]


def mesh(part, one, common, checker=None):
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(common["bsdf"])
    placed = part.placed(one.matrix)
    extent = {"vertex_count": len(placed.vertices), "face_count": len(placed.faces)}
    result = mi.Mesh(one.name, **extent, props=props, has_vertex_normals=placed.normals is not None, has_vertex_texcoords=bool(checker))
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = placed.vertices.ravel()
    parameters["faces"] = placed.faces.ravel()
    if placed.normals is not None:
        parameters["vertex_normals"] = placed.normals.ravel()
    if checker:
        # A checkerboard has two by two cells from 0 to 1.
        parameters["vertex_texcoords"] = (checker.coordinates(part, one.matrix) / 2).ravel()
    parameters.update()
    return result


def light(table):
    kind = table["type"]
    if kind == "point":
        keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
        if keys["falloff"] != "inverse_square":
            document.skip("a light without falloff")
        return {"type": "point", "position": keys["position"], "intensity": rgb(document.color(keys["intensity"], kind))}
    if kind == "directional":
        keys = document.only(table, kind, direction=None, irradiance=1)
        return {"type": "directional", "direction": keys["direction"], "irradiance": rgb(document.color(keys["irradiance"], kind))}
    if kind == "spot":
        known = {"position": None, "target": None, "intensity": 1, "cutoff_angle": 20, "beam_width": None, "falloff": "inverse_square"}
        keys = document.only(table, kind, **known)
        if keys["falloff"] != "inverse_square":
            document.skip("a light without falloff")
        cutoff = float(keys["cutoff_angle"])
        beam = 0.75 * cutoff if keys["beam_width"] is None else float(keys["beam_width"])
        axis = document.unit(np.array(keys["target"], float) - np.array(keys["position"], float))
        up = [0, 1, 0] if abs(axis[1]) < 0.9 else [1, 0, 0]
        place = mi.ScalarTransform4f().look_at(origin=keys["position"], target=(np.array(keys["position"], float) + axis).tolist(), up=up)
        color = rgb(document.color(keys["intensity"], kind))
        return {"type": "spot", "to_world": place, "intensity": color, "cutoff_angle": cutoff, "beam_width": beam}
    return document.skip(f"a light of type {kind}")


def rays(scene):
    """The camera rays through the middles of the pixels, row by row from the top."""
    view = scene.camera
    for y in range(scene.height):
        for x in range(scene.width):
            a = view.left + (view.right - view.left) * (x + 0.5) / scene.width
            c = view.top - (view.top - view.bottom) * (y + 0.5) / scene.height
            if view.parallel:
                origin, toward = view.origin + a * view.u + c * view.v - view.near * view.w, -view.w
            else:
                toward = document.unit(a * view.u + c * view.v - view.distance * view.w)
                origin = view.origin + view.near * toward / -(toward @ view.w)
            yield mi.RayDifferential3f(mi.Point3f(origin), mi.Vector3f(toward))


def traced(scene, plugins, integrator, sampler, samples=1):
    """What an integrator gives for each ray: rows of the value, whether it hit, and other channels."""
    world = mi.load_dict({"type": "scene", **plugins})
    integrator = mi.load_dict(integrator)
    rows = []
    for ray in rays(scene):
        total = 0
        for _ in range(samples):
            value, hit, channels = integrator.sample(world, sampler, ray)
            total = total + np.array([*np.array(value).ravel(), hit, *channels])
        rows.append(total / samples)
    return np.array(rows)


def main(source, output, samples="0", seed="0"):
    scene = document.read(source, cameras=("perspective", "orthographic"))
    kinds = {one.material["type"] for one in scene.shapes}
    specular = kinds & set(SPECULAR)
    if specular and kinds - set(SPECULAR):
        document.skip("mirrors or glass together with diffuse surfaces")
    noisy = "dielectric" in kinds
    if noisy != (samples != "0"):
        document.skip("glass, of which it picks one branch at random" if noisy else "a scene without noise")
    shapes = {f"shape{index}-{part}": plugin for index, one in enumerate(scene.shapes) for part, plugin in enumerate(shape(one))}
    lights = [light(table) for table in scene.lights]
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(int(seed))
    if specular:
        # Lights and ambient light are not seen. Beyond the limit, the background is.
        depth = scene.max_depth + 1 + int(scene.beyond.any())
        path = {"type": "path", "max_depth": depth, "rr_depth": NO_ROULETTE}
        plugins = {**shapes, "background": {"type": "constant", "radiance": rgb(scene.background)}}
        pixels = traced(scene, plugins, path, sampler, max(int(samples), 1))[:, :3]
    else:
        direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
        rows = traced(scene, shapes, {"type": "aov", "aovs": "albedo:albedo", "image": direct}, sampler)
        hit = rows[:, 3:4] > 0
        pixels = np.where(hit, rows[:, -3:] * scene.ambient, scene.background)
        for one in lights:
            rows = traced(scene, {**shapes, "light": one}, direct, sampler)
            pixels = pixels + rows[:, :3]
    document.write_pfm(output, pixels.reshape(scene.height, scene.width, 3))


main(*sys.argv[1:])
