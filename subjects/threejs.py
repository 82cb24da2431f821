"""Renders a scene document with three.js in a headless Chromium: threejs.py SCENE OUTPUT.pfm

Needs Chromium, NumPy, and the package `three` 0.187 of npm in `target/tools/three`, or in the
folder that the variable WHITSTONE_THREE names:

    npm install --prefix target/tools/three three@0.187.0

The page threejs.html draws into a buffer of floats, with SwiftShader in place of a GPU. SwiftShader
moves vertices to a grid of 1/16 pixel, so the image is drawn larger, with up to 40 million pixels,
and the middle one of the samples of each pixel counts.

three.js has no exact shadows and no reflections: the table of the subject sets `shadows = "none"`
and `max_depth = 0` on both sides, so that mirrors show the background, times their colour. It
cannot express spots with a linear edge, and its highlights are multiplied by the cosine, unlike
Phong's. This adapter supports the shapes of document.py, as meshes with 719 segments around, the
materials matte (also with checkers), mirror and emissive, point lights of both falloffs,
directional and ambient lights, and pinhole cameras.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

import document

HERE = Path(__file__).resolve().parent
THREE = Path(os.environ.get("WHITSTONE_THREE", HERE.parent / "target/tools/three"), "node_modules/three")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# A prime, so that edges do not lie in planes of symmetry, as rays do.
SEGMENTS = 719
# Of all meshes, because of the memory and time that they take.
TRIANGLES = 10_000_000
# Of the buffer, the same in both directions.
SAMPLES = 40_000_000
TIME_LIMIT = 200
TYPES = {".html": "text/html", ".js": "text/javascript", ".json": "application/json"}


def light_of(table, origin):
    kind = table["type"]
    if kind == "point":
        keys = document.only(table, kind, position=None, intensity=1, falloff="inverse_square")
        decay = 2 if keys["falloff"] == "inverse_square" else 0
        place = (np.array(keys["position"], float) - origin).tolist()
        return {"kind": kind, "position": place, "color": document.color(keys["intensity"], kind).tolist(), "decay": decay}
    if kind == "directional":
        keys = document.only(table, kind, direction=None, irradiance=1)
        toward = (-document.unit(np.array(keys["direction"], float))).tolist()
        return {"kind": kind, "toward": toward, "color": document.color(keys["irradiance"], kind).tolist()}
    return document.skip(f"a light of type {kind}")


def material_of(table, scene):
    """The entries of a mesh for its material, and its texture or None."""
    kind = table["type"]
    if kind == "matte":
        value = document.paint(document.only(table, kind, reflectance=0.5)["reflectance"], kind)
        if isinstance(value, document.Checker):
            return {"checker": [value.a.tolist(), value.b.tolist()]}, value
        return {"color": value.tolist()}, None
    if kind == "emissive":
        return {"color": document.color(document.only(table, kind, radiance=1)["radiance"], kind).tolist(), "emits": True}, None
    if kind == "mirror":
        color = document.color(document.only(table, kind, reflectance=1)["reflectance"], kind)
        return {"color": (color * scene.beyond).tolist(), "emits": True}, None
    return document.skip(f"a material of type {kind}")


def with_corners(mesh):
    """A mesh without normals as one with those of its triangles, which then share no vertices."""
    if mesh.normals is not None:
        return mesh
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    faces = np.arange(mesh.faces.size).reshape(-1, 3)
    uvs = None if mesh.uvs is None else mesh.uvs[mesh.faces].reshape(-1, 2)
    return document.Mesh(corners.reshape(-1, 3), faces, normals.repeat(3, axis=0), uvs)


def described(scene):
    """The scene as the page reads it: a table, and the bytes of all meshes.

    Positions are relative to the camera, so that single precision is enough far from the origin.
    """
    view = scene.camera
    pieces, size, triangles, meshes = [], 0, 0, []

    def store(values, kind):
        nonlocal size
        data = np.ascontiguousarray(values, kind).tobytes()
        pieces.append(data)
        size += len(data)
        return size - len(data), len(data) // 4

    for shape in scene.shapes:
        material, texture = material_of(shape.material, scene)
        for part in document.tessellate(shape, SEGMENTS):
            triangles += len(part.faces)
            if triangles > TRIANGLES:
                document.skip(f"more than {TRIANGLES} triangles")
            part.uvs = texture.coordinates(part, shape.matrix) if texture else None
            mesh = with_corners(part.placed(shape.matrix))
            attributes = {"position": (*store(mesh.vertices - view.origin, "<f4"), 3), "normal": (*store(mesh.normals, "<f4"), 3)}
            if mesh.uvs is not None:
                attributes["uv"] = (*store(mesh.uvs, "<f4"), 2)
            meshes.append({**material, "attributes": attributes, "index": store(mesh.faces, "<u4")})
    # Odd, so that a pixel has a sample in its middle; a texture has 8192 rows at most.
    factor = min(math.isqrt(SAMPLES // (scene.width * scene.height)), 8191 // max(scene.width, scene.height))
    factor = max(factor - 1 + factor % 2, 1)
    near = max(view.near, 0.005 * view.reach)
    sides = {side: getattr(view, side) * near / view.distance for side in ("left", "right", "top", "bottom")}
    turn = np.eye(4)
    turn[:3, :3] = view.matrix[:3, :3]
    table = {
        "width": scene.width,
        "height": scene.height,
        "factor": factor,
        "background": scene.background.tolist(),
        "ambient": scene.ambient.tolist(),
        "lights": [light_of(light, view.origin) for light in scene.lights],
        "meshes": meshes,
        "camera": turn.ravel().tolist(),
        "window": {**sides, "near": near, "far": 5e7 * near},
    }
    return json.dumps(table).encode(), b"".join(pieces)


class Exchange:
    """What the page asks for, and its answer."""

    def __init__(self, table, data):
        self.files = {"/scene.json": table, "/scene.bin": data, "/threejs.html": (HERE / "threejs.html").read_bytes()}
        self.done = threading.Event()
        self.image, self.failure = b"", ""

    def file(self, path):
        if path.startswith("/three/") and ".." not in path:
            return (THREE / path.removeprefix("/three/")).read_bytes()
        return self.files[path]

    def handler(self):
        exchange = self

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *_):
                pass

            def answer(self, status, data=b""):
                self.send_response(status)
                self.send_header("Content-Type", TYPES.get(Path(self.path).suffix, "application/octet-stream"))
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def do_GET(self):
                try:
                    self.answer(200, exchange.file(self.path))
                except (KeyError, OSError):
                    self.answer(404)

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                if self.path == "/image":
                    exchange.image = body
                else:
                    exchange.failure = body.decode()
                self.answer(200)
                exchange.done.set()

        return Handler


def drawn(exchange, browser):
    """Lets the browser show the page until it has sent an image or an error."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), exchange.handler())
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [browser, "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        command += ["--ignore-gpu-blocklist", "--disable-background-networking", "--disable-component-update", "--no-first-run"]
        command += [f"--user-data-dir={profile}", f"http://127.0.0.1:{server.server_port}/threejs.html"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            if not exchange.done.wait(TIME_LIMIT):
                raise RuntimeError(f"the page sent no image in {TIME_LIMIT} s")
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
    if exchange.failure:
        raise RuntimeError(exchange.failure)
    return exchange.image


def main(source, output):
    scene = document.read(source, shadows="none")
    if scene.max_depth:
        document.skip("reflections")
    exchange = Exchange(*described(scene))
    folders = [Path(folder) for folder in os.get_exec_path()]
    browser = next((str(folder / name) for name in BROWSERS for folder in folders if (folder / name).exists()), None)
    if browser is None:
        raise RuntimeError("there is no Chromium")
    if not THREE.exists():
        raise RuntimeError(f"there is no three.js in {THREE}: npm install --prefix target/tools/three three@0.187.0")
    pixels = np.frombuffer(drawn(exchange, browser), "<f4")
    document.write_pfm(output, pixels.reshape(scene.height, scene.width, 3))


main(*sys.argv[1:])
