"""Renders a scene document with Mitsuba 3: mitsuba_stock.py SCENE OUTPUT.pfm SAMPLES SEED

Needs `mitsuba` 3.9. Mitsuba's own C++ integrators follow rays through the middle of each pixel:
`direct` in scenes without mirrors and glass, `path` in scenes of nothing else. They pick one light
at random for each sample, so the images have noise: the subject needs `runs`.

Mitsuba cannot express, in its own plugins, lights without falloff, ambient light, and a background
that lights no surface; here the background is what camera rays see that hit nothing. This adapter
supports the shapes of document.py, the materials matte, mirror and dielectric without textures,
point and directional lights, and pinhole cameras.
"""

import sys

import mitsuba as mi
import numpy as np

import document

mi.set_variant("scalar_rgb")
SEGMENTS = 1024
SPECULAR = ("mirror", "dielectric")


def rgb(value):
    return {"type": "rgb", "value": [float(part) for part in np.broadcast_to(value, 3)]}


def material(table):
    kind = table["type"]
    if kind == "matte":
        keys = document.only(table, kind, reflectance=0.5)
        return {"type": "twosided", "nested": {"type": "diffuse", "reflectance": rgb(document.color(keys["reflectance"], kind))}}
    if kind == "mirror":
        keys = document.only(table, kind, reflectance=1)
        nested = {"type": "conductor", "material": "none", "specular_reflectance": rgb(document.color(keys["reflectance"], kind))}
        return {"type": "twosided", "nested": nested}
    if kind == "dielectric":
        keys = document.only(table, kind, interior_ior=1.5, exterior_ior=1)
        return {"type": "dielectric", "int_ior": float(keys["interior_ior"]), "ext_ior": float(keys["exterior_ior"])}
    return document.skip(f"a material of type {kind}")


def shape(one):
    """The plugins of a shape: Mitsuba's own where it has one, otherwise meshes."""
    transform = mi.ScalarTransform4f(one.matrix)
    common = {"bsdf": material(one.material)}
    if one.kind == "sphere":
        keys = document.only(one.keys, one.kind, center=[0, 0, 0], radius=1)
        return [{"type": "sphere", "center": keys["center"], "radius": float(keys["radius"]), "to_world": transform, **common}]
    if one.kind in ("rectangle", "disk"):
        document.only(one.keys, one.kind)
        return [{"type": one.kind, "to_world": transform, **common}]
    if one.kind == "box":
        document.only(one.keys, one.kind)
        return [{"type": "cube", "to_world": transform, **common}]
    return [mesh(part, one, common) for part in document.tessellate(one, SEGMENTS)]


def mesh(part, one, common):
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(common["bsdf"])
    result = mi.Mesh(one.name, len(part.vertices), len(part.faces), props=props, has_vertex_normals=part.normals is not None)
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = (part.vertices @ one.matrix[:3, :3].T + one.matrix[:3, 3]).ravel()
    parameters["faces"] = part.faces.ravel()
    if part.normals is not None:
        normals = part.normals @ np.linalg.inv(one.matrix[:3, :3])
        parameters["vertex_normals"] = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).ravel()
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
    return document.skip(f"a light of type {kind}")


def main(source, output, samples, seed):
    scene = document.read(source)
    if scene.ambient.any():
        document.skip("ambient light")
    kinds = {one.material["type"] for one in scene.shapes}
    specular = kinds & set(SPECULAR)
    if specular and (kinds - set(SPECULAR) or scene.background.any()):
        document.skip("mirrors or glass together with diffuse surfaces or a background")
    plugins = {"type": "scene"}
    for index, table in enumerate(scene.lights):
        plugins[f"light{index}"] = light(table)
    for index, one in enumerate(scene.shapes):
        for part, plugin in enumerate(shape(one)):
            plugins[f"shape{index}-{part}"] = plugin
    world = mi.load_dict(plugins)
    name = {"type": "path", "max_depth": scene.max_depth + 1} if specular else {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    integrator = mi.load_dict(name)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(int(seed))
    view = scene.camera
    pixels = np.zeros((scene.height, scene.width, 3))
    for y in range(scene.height):
        for x in range(scene.width):
            a = view.left + (view.right - view.left) * (x + 0.5) / scene.width
            c = view.top - (view.top - view.bottom) * (y + 0.5) / scene.height
            toward = document.unit(a * view.u + c * view.v - view.distance * view.w)
            ray = mi.RayDifferential3f(mi.Point3f(view.origin + view.near * toward / -(toward @ view.w)), mi.Vector3f(toward))
            for _ in range(int(samples)):
                value, hit, _ = integrator.sample(world, sampler, ray)
                pixels[y, x] += np.array(value).ravel() if hit else scene.background
    document.write_pfm(output, pixels / int(samples))


main(*sys.argv[1:])
