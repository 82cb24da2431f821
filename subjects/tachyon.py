"""Renders a scene document with Tachyon: tachyon.py SCENE OUTPUT.pfm

Needs the program `tachyon` 0.99 and NumPy. Its images have 16-bit codes. Samples are at the top
right corner of each pixel, which the offset of the subject states. It drops a directional light
where the cosine is below 1/512.

Tachyon cannot express other materials than Lambert's without its own ambient and specular terms,
nor spots by the rules of the model. This adapter supports spheres and the flat shapes of
document.py, the material matte without textures, and point and directional lights.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import document

SEGMENTS = 512
LAST = 65535
# Divided out of the light again.
ATTENUATION = 0.0001


def triple(values):
    # Tachyon's space is left-handed: z points away from the viewer.
    x, y, z = (float(value) for value in values)
    return f"{x!r} {y!r} {-z!r}"


def text_of(scene, scale):
    """The scene, with all lights multiplied by `scale`."""
    view = scene.camera
    if abs(view.left + view.right) > 1e-9 or abs(view.bottom + view.top) > 1e-9:
        document.skip("a window that is not centred")
    if abs((view.right - view.left) * scene.height - (view.top - view.bottom) * scene.width) > 1e-9 * scene.width:
        document.skip("pixels that are not square")
    lines = ["BEGIN_SCENE", f"RESOLUTION {scene.width} {scene.height}", "SHADER_MODE FULL", "END_SHADER_MODE", "CAMERA"]
    lines += ["PROJECTION PERSPECTIVE", f"ZOOM {view.distance / (view.top - view.bottom)!r}", "ASPECTRATIO 1.0", "ANTIALIASING 0", "RAYDEPTH 1"]
    lines += [f"CENTER {triple(view.origin)}", f"VIEWDIR {triple(-view.w)}", f"UPDIR {triple(view.v)}", "END_CAMERA"]
    lines.append("BACKGROUND " + " ".join(repr(float(value * scale)) for value in scene.background))
    for table in scene.lights:
        kind = table["type"]
        if kind == "directional":
            keys = document.only(table, kind, direction=None, irradiance=1)
            value = document.color(keys["irradiance"], kind) * scale
            lines.append(f"DIRECTIONAL_LIGHT DIRECTION {triple(keys['direction'])} COLOR " + " ".join(map(repr, map(float, value))))
        elif kind == "point":
            keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
            # Tachyon drops the light of a point whose cosine times attenuation is below 1/512.
            value = document.color(keys["intensity"], kind) * scale * ATTENUATION
            names = ("QUADRATIC", "CONSTANT") if keys["falloff"] == "inverse_square" else ("CONSTANT", "QUADRATIC")
            fall = {names[0]: ATTENUATION, names[1]: 0.0}
            lines.append(f"LIGHT CENTER {triple(keys['position'])} RAD 0.0")
            lines.append(f"ATTENUATION CONSTANT {fall['CONSTANT']} LINEAR 0.0 QUADRATIC {fall['QUADRATIC']}")
            lines.append("COLOR " + " ".join(map(repr, map(float, value))))
        else:
            document.skip(f"a light of type {kind}")
    for index, one in enumerate(scene.shapes):
        kind = one.material["type"]
        if kind != "matte":
            document.skip(f"a material of type {kind}")
        color = document.color(document.only(one.material, kind, reflectance=0.5)["reflectance"], kind)
        # Tachyon has no factor of 1/pi.
        surface = f"surface{index}"
        lines += [f"TEXDEF {surface}", "AMBIENT 0.0 DIFFUSE 1.0 SPECULAR 0.0 OPACITY 1.0"]
        lines.append("COLOR " + " ".join(map(repr, map(float, color / np.pi))) + " TEXFUNC 0")
        if one.kind == "sphere":
            keys = document.only(one.keys, one.kind, center=[0, 0, 0], radius=1)
            center = (one.matrix @ [*keys["center"], 1])[:3]
            radius = keys["radius"] * np.linalg.norm(one.matrix[:3, 0])
            lines.append(f"SPHERE CENTER {triple(center)} RAD {float(radius)!r} {surface}")
            continue
        for part in document.tessellate(one, SEGMENTS):
            vertices = part.vertices @ one.matrix[:3, :3].T + one.matrix[:3, 3]
            for face in part.faces:
                corners = " ".join(f"V{k} {triple(vertices[index])}" for k, index in enumerate(face))
                lines.append(f"TRI {corners} {surface}")
    return "\n".join([*lines, "END_SCENE", ""])


def rendered(scene, scale):
    """The codes of the image, with all lights multiplied by `scale`."""
    with tempfile.TemporaryDirectory() as folder:
        model, image = Path(folder, "scene.dat"), Path(folder, "image.ppm")
        model.write_text(text_of(scene, scale), encoding="ascii")
        command = ["tachyon", str(model), "-o", str(image), "-format", "PPM48", "-numthreads", "1"]
        subprocess.run(command, check=True, cwd=folder)
        header, rest = image.read_bytes().split(b"65535\n", 1)
    if not header.startswith(b"P6"):
        raise ValueError("tachyon wrote no PPM of 16 bits")
    return np.frombuffer(rest, ">u2").reshape(scene.height, scene.width, 3)


def main(source, output):
    scene = document.read(source)
    if scene.ambient.any():
        document.skip("ambient light")
    # Codes end at 1: the lights are dimmed until no code is the last one, and the image is
    # multiplied again. The second scale uses all codes.
    scale = 1.0
    while (codes := rendered(scene, scale)).max() == LAST:
        scale /= 16
    scale *= 0.9 * LAST / max(int(codes.max()), 1)
    document.write_pfm(output, rendered(scene, scale) / LAST / scale)


main(*sys.argv[1:])
