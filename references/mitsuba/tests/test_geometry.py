"""Cameras, shapes, their normals, uv and numbers (model §4, §9, §11)."""

import math
import os
import tempfile
import unittest
from itertools import product

import numpy as np

from support import DOWN, FLOOR, Case, film
from whitstone_mitsuba import (
    displacement,
    document,
    mappings,
    meshes,
    subdivision,
    textures,
)
from whitstone_mitsuba.fields import Fields
from whitstone_mitsuba.runtime import mi

AOVS = ("depth", "normal", "uv", "shape_id", "primitive_id")


def looking(origin, target=(0, 0, 0), up=(0, 1, 0), more=""):
    """A camera whose single pixel looks from `origin` to `target`."""
    origin, target, up = ([float(number) for number in vector] for vector in (origin, target, up))
    look = f"look_at = {{ origin = {origin}, target = {target}, up = {up} }}\n"
    return film() + '[camera]\ntype = "perspective"\n' + look + more


class Cameras(Case):
    def directions(self, camera, width=8, height=4):
        """Directions of the rays through all pixels, from their hits on a huge sphere around the
        camera.
        """
        ball = '[[shape]]\ntype = "sphere"\nradius = 100\ncenter = [1, 2, 3]\n'
        channels, answer = self.render(film(width, height, ["normal", "depth"]) + camera + ball)
        return np.stack([channels[f"normal.{axis}"] for axis in "XYZ"], axis=2), channels["depth.Z"], answer

    def test_perspective(self):
        look = 'type = "perspective"\nlook_at = { origin = [1, 2, 3], target = [1, 2, 0] }\n'
        x = (np.arange(8) + 0.5) / 4 - 1
        y = 1 - (np.arange(4) + 0.5) / 2
        cases = {
            "fov = 90\n": (1, 0.5),
            'fov = 90\nfov_axis = "y"\n': (2, 1),
            'fov = 90\nfov_axis = "smaller"\n': (2, 1),
            'fov = 90\nfov_axis = "larger"\n': (1, 0.5),
            "": (math.tan(math.radians(22.5)), math.tan(math.radians(22.5)) / 2),
        }
        for text, (half_x, half_y) in cases.items():
            found, depth, answer = self.directions("[camera]\n" + look + text)
            expected = np.stack(np.broadcast_arrays(x[None, :] * half_x, y[:, None] * half_y, -1.0), axis=2)
            self.near(found, expected / np.linalg.norm(expected, axis=2, keepdims=True), atol=1e-6)
            self.near(depth, np.full((4, 8), 100.0))
            self.assertEqual(answer["twin"], "native")

    def test_perspective_windows(self):
        look = 'type = "perspective"\nlook_at = { origin = [1, 2, 3], target = [1, 2, 0] }\n'
        for window, twin in (((-1, 3, 0.5, 2.5, 2), "native"), ((-1, 1, -2, 1, 1), "formula")):
            left, right, bottom, top, distance = window
            text = f"window = {{ l = {left}, r = {right}, b = {bottom}, t = {top}, d = {distance} }}\n"
            found, _, answer = self.directions("[camera]\n" + look + text)
            a = left + (right - left) * (np.arange(8) + 0.5) / 8
            c = top - (top - bottom) * (np.arange(4) + 0.5) / 4
            expected = np.stack(np.broadcast_arrays(a[None, :], c[:, None], -float(distance)), axis=2)
            self.near(found, expected / np.linalg.norm(expected, axis=2, keepdims=True), atol=1e-6)
            self.assertEqual(answer["twin"], twin)

    def test_orthographic(self):
        wall = '[[shape]]\ntype = "plane"\n'
        look = '[camera]\ntype = "orthographic"\nlook_at = { origin = [1, 2, 3], target = [1, 2, 0] }\n'
        for text, (left, right, bottom, top) in (
            ("", (-1, 1, -0.5, 0.5)),
            ("width = 8\n", (-4, 4, -2, 2)),
            ("window = { l = 1, r = 2, b = -3, t = 4 }\n", (1, 2, -3, 4)),
        ):
            channels, answer = self.render(film(8, 4, ["uv", "depth"]) + look + text + wall)
            a = 1 + left + (right - left) * (np.arange(8) + 0.5) / 8
            c = 2 + top - (top - bottom) * (np.arange(4) + 0.5) / 4
            self.near(channels["uv.U"], np.broadcast_to(a, (4, 8)))
            self.near(channels["uv.V"], np.broadcast_to(c[:, None], (4, 8)))
            self.near(channels["depth.Z"], np.full((4, 8), 3.0))
            self.assertEqual(answer["twin"], "native")

    def test_near_limits(self):
        walls = "".join(f'[[shape]]\ntype = "plane"\ntransform = {{ translate = [0, 0, {z}] }}\n' for z in (2.5, 0))
        look = 'look_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n'
        x = (np.arange(8) + 0.5) / 4 - 1
        y = 0.5 - (np.arange(4) + 0.5) / 4
        # Length of the camera ray through a pixel per metre along the view direction.
        longer = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
        for text, far, metres in (
            ('type = "perspective"\nfov = 90\nnear = 2.49\n', longer > 9, longer),
            ('type = "perspective"\nfov = 90\nnear = 2.51\n', longer > 0, longer),
            ('type = "perspective"\nfov = 90\nnear = 3\nnear_kind = "spherical"\n', 2.5 * longer < 3, longer),
            ('type = "perspective"\nwindow = { l = -1, r = 1, b = -0.5, t = 0.5 }\nnear = 2.49\n', longer > 9, longer),
            ('type = "orthographic"\nnear = 2.49\n', longer > 9, 1),
            ('type = "orthographic"\nnear = 2.51\n', longer > 0, 1),
            ('type = "orthographic"\nnear = -9\n', longer > 9, 1),
        ):
            channels, answer = self.render(film(8, 4, ["shape_id", "depth"]) + "[camera]\n" + look + text + walls)
            np.testing.assert_array_equal(channels["shape_id.I"], far)
            self.near(channels["depth.Z"], np.where(far, 5, 2.5) * metres)
            self.assertEqual(answer["twin"], "formula")

    def test_thin_lens(self):
        look = 'look_at = { origin = [0, 0, 5], target = [0, 0, 0] }\naperture = 0.5\nfocus_distance = 2.5\n'
        half = math.sqrt(0.5)
        # By hand, for 3 x 3 points: at 2/3 of the aperture, except for the one in the middle.
        ring = {0: (-half, -half), 1: (0, -1), 2: (half, -half), 3: (-1, 0), 5: (1, 0), 6: (-half, half), 7: (0, 1), 8: (half, half)}
        for window, twin in (("fov = 90", "native"), ("window = { l = -1, r = 1, b = -2, t = 2 }", "formula")):
            scene = film() + f'[camera]\ntype = "thin_lens"\n{look}{window}\nlens_samples = 3\n[[shape]]\ntype = "plane"\n'
            for sample in range(9):
                x, y = ring.get(sample, (0, 0))
                # The focal plane is halfway, so the ray hits the plane on the other side.
                node = self.nodes(scene, sample=sample)[0]
                self.near(node["p"], [-x / 3, -y / 3, 0], atol=1e-6)
                self.near(node["t"], 2 * math.hypot(2.5, math.hypot(x, y) / 3))
            channels, answer = self.render(scene.replace("aovs = []", 'aovs = ["depth"]'))
            self.near(channels["depth.Z"], [[5.0]])
            self.assertEqual((answer["twin"], answer["samples"]), (twin, 9))

    def test_environment(self):
        look = 'type = "environment"\nlook_at = { origin = [1, 2, 3], target = [1, 2, 0] }\n'
        found, depth, answer = self.directions("[camera]\n" + look)
        phi = (np.arange(8)[None, :] + 0.5) / 8 * 2 * math.pi - math.pi
        theta = math.pi / 2 - (np.arange(4)[:, None] + 0.5) / 4 * math.pi
        level = np.cos(theta)
        expected = np.stack(np.broadcast_arrays(level * np.sin(phi), np.sin(theta), -level * np.cos(phi)), axis=2)
        self.near(found, expected, atol=1e-6)
        self.near(depth, np.full((4, 8), 100.0))
        self.assertEqual(answer["twin"], "formula")

    def test_nothing_is_too_near(self):
        near = '[[shape]]\ntype = "plane"\ntransform = { translate = [0, 0, 2.999] }\n'
        node = self.nodes(looking([0, 0, 3]) + near)[0]
        self.assertEqual(node["shape"], 0)
        self.near(node["t"], 0.001, rel=1e-3)

    def test_grid(self):
        """A checker edge through the middle of a pixel: half of the positions see each side."""
        floor = FLOOR + 'material = { type = "matte", reflectance = { type = "checker", a = 1, b = 0 } }\n'
        scene = film() + '[sampler]\ntype = "grid"\nsamples_per_axis = 4\n' + DOWN.replace("fov = 90", "fov = 1")
        self.near(self.value(scene + '[[light]]\ntype = "ambient"\nradiance = 1\n' + floor), [0.5] * 3)


class Shapes(Case):
    def test_sphere(self):
        theta, phi = 1.1, 4.0
        direction = np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
        shape = '[[shape]]\ntype = "sphere"\ncenter = [1, 2, 3]\nradius = 2\n'
        node = self.nodes(looking(np.array([1, 2, 3]) + 5 * direction, (1, 2, 3)) + shape)[0]
        self.near(node["uv"], [phi / (2 * math.pi), (math.pi - theta) / math.pi])
        self.near(node["n_g"], direction)
        self.near(node["t"], 3, rel=1e-5)
        # From inside, the geometric normal still points outwards.
        node = self.nodes(looking([1, 2, 3], np.array([1, 2, 3]) + direction) + shape)[0]
        self.near(node["n_g"], direction)
        self.near(node["t"], 2)

    def test_sphere_transforms(self):
        shape = '[[shape]]\ntype = "sphere"\nradius = 2\ntransform = [{ scale = [1, 1, -1] }, { scale = 0.5 }]\n'
        node = self.nodes(looking([0, 3, 4]) + shape)[0]
        self.near(node["n_g"], [0, 0.6, 0.8], atol=1e-6)
        self.near(node["t"], 4, rel=1e-5)
        self.near(node["uv"], [0.25, (math.pi - math.acos(-0.8)) / math.pi])
        turned = '[[shape]]\ntype = "sphere"\ntransform = { rotate = { axis = [0, 0, 1], degrees = 90 } }\n'
        # Object x now points along world y.
        self.near(self.nodes(looking([-3, 4, 0], up=[0, 0, 1]) + turned)[0]["uv"][0], math.atan2(3, 4) / (2 * math.pi))
        self.refuse(looking([0, 3, 4]) + shape.replace("scale = 0.5", "scale = [1, 2, 1]"), "scene", "similarity")

    def test_plane(self):
        shape = '[[shape]]\ntype = "plane"\ntransform = [{ scale = 2 }, { translate = [10, 0, 1] }]\n'
        node = self.nodes(looking([3, 4, 5], (1, 6, 1)) + shape)[0]
        self.near(node["uv"], [(1 - 10) / 2, 3.0])
        self.assertEqual(node["n_g"], [0, 0, 1])

    def test_rectangle_and_disk(self):
        for mirror, sign in (("[1, 1, 1]", 1), ("[-1, 1, 1]", 1), ("[1, 1, -1]", -1), ("[-1, -1, -1]", -1)):
            steps = f"transform = {{ scale = {mirror} }}\n"
            x, y = eval(mirror)[0] * 0.3, eval(mirror)[1] * 0.4
            for origin in ([0.3, 0.4, 5], [0.3, 0.4, -5]):
                node = self.nodes(looking(origin, (0.3, 0.4, 0)) + '[[shape]]\ntype = "rectangle"\n' + steps)[0]
                self.near(node["uv"], [(x + 1) / 2, (y + 1) / 2])
                self.assertEqual(node["n_g"], [0, 0, sign])
                self.assertEqual((node["n_s"], node["primitive"]), (node["n_g"], 0))
                node = self.nodes(looking(origin, (0.3, 0.4, 0)) + '[[shape]]\ntype = "disk"\n' + steps)[0]
                self.near(node["uv"], [0.5, math.atan2(y, x) / (2 * math.pi) % 1])
                self.assertEqual(node["n_g"], [0, 0, sign])
        self.refuse(looking([0, 0, 5]) + '[[shape]]\ntype = "disk"\ntransform = { scale = [1, 2, 1] }\n', "scene", "x and y")

    def test_tolerance_of_similarities(self):
        """Lengths (not their squares) and cosines are compared to a relative 1e-9."""
        for kind in ("disk", "sphere"):
            shape = looking([0, 0, 5]) + f'[[shape]]\ntype = "{kind}"\ntransform = [{{ scale = 7 }}, {{}}]\n'
            for off, good in ((0.9e-9, True), (1.1e-9, False), (-0.9e-9, True), (-1.1e-9, False)):
                for step in (
                    f"{{ scale = [1, {1 + off!r}, 1] }}",
                    f"{{ matrix = [[1, {off!r}, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]] }}",
                ):
                    with self.subTest(kind=kind, step=step):
                        scene = shape.replace("{}", step)
                        if good:
                            self.nodes(scene)
                        else:
                            self.refuse(scene, "scene", "transform")

    def test_tolerance_of_invertibility(self):
        shape = looking([0, 0, 5]) + '[[shape]]\ntype = "box"\ntransform = { matrix = [[1, 1, 0, 0], [0, SIZE, 0, 0], [0, 0, 1, 0]] }\n'
        self.nodes(shape.replace("SIZE", "1.1e-15"))
        self.refuse(shape.replace("SIZE", "0.9e-15"), "scene", "invertible")

    def test_box(self):
        for mirror in ("[1, 1, 1]", "[-1, 1, 1]", "[1, -2, 1]"):
            scale = np.array(eval(mirror))
            for face in range(6):
                axis, sign = face // 2, 2 * (face % 2) - 1
                b, c = (axis + 1) % 3, (axis + 2) % 3
                point = np.zeros(3)
                point[axis], point[b], point[c] = sign, 0.2, -0.6
                normal = np.zeros(3)
                normal[axis] = sign * np.sign(scale[axis])
                up = np.eye(3)[b]
                shape = f'[[shape]]\ntype = "box"\ntransform = {{ scale = {mirror} }}\n'
                node = self.nodes(looking(point * scale + 4 * normal, point * scale, up) + shape)[0]
                self.assertEqual(node["primitive"], face)
                self.near(node["uv"], [0.6, 0.2])
                self.near(node["n_g"], normal)

    def test_triangle(self):
        shape = '[[shape]]\ntype = "triangle"\nvertices = [[0, 0, 0], [4, 0, 0], [0, 2, 0]]\n'
        camera = looking([1, 0.5, 3], (1, 0.5, 0))
        node = self.nodes(camera + shape)[0]
        self.near(node["uv"], [0.25, 0.25])
        self.assertEqual((node["n_g"], node["n_s"]), ([0, 0, 1], [0, 0, 1]))
        mirrored = shape + "transform = { scale = [1, 1, -1] }\n"
        node = self.nodes(camera + mirrored)[0]
        self.assertEqual(node["n_g"], [0, 0, -1])
        self.near(node["uv"], [0.25, 0.25])
        normals = shape + "normals = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]\nuvs = [[0, 0], [0, 8], [4, 0]]\n"
        node = self.nodes(camera + normals)[0]
        n = np.array([0.25, 0.25, 0.5])
        self.near(node["n_s"], n / np.linalg.norm(n))
        self.near(node["uv"], [1, 2])
        # Rule S: from behind, the shading normal flips to the viewer's side of n_g.
        behind = looking([1.6, 0.5, -0.1], (1, 0.5, 0)) + normals
        node = self.nodes(behind)[0]
        self.near(node["n_s"], -n / np.linalg.norm(n))
        self.assertEqual(node["n_g"], [0, 0, 1])

    def test_instances(self):
        """A tilted triangle with normals in a group in a group: rotated by 90 degrees, stretched,
        mirrored, moved.
        """
        scene = """
[[group.b.shape]]
type = "triangle"
vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
normals = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
transform = { scale = [2, 2, 2] }
[[group.a.shape]]
type = "sphere"
center = [50, 0, 0]
[[group.a.shape]]
type = "instance"
group = "b"
transform = { scale = [3, 1, 2] }
[[shape]]
type = "sphere"
center = [0, 0, 90]
[[shape]]
type = "instance"
group = "a"
transform = [{ scale = [1, 1, -1] }, { translate = [10, 0, 0] }]
"""
        node = self.nodes(looking([11.5, 0.5, 5], (11.5, 0.5, 0)) + scene)[0]
        # Shapes 0 and 1 belong to the document, 2 and 3 to group a, 4 to group b.
        self.assertEqual((node["shape"], node["primitive"], node["n_g"]), (4, 0, [0, 0, -1]))
        self.near(node["uv"], [0.25, 0.25])
        # Interpolated and normalised in the group; the inverse transpose of (3, 1, -2); turned to
        # the viewer (rule S).
        n = np.array([0.25 / 3, 0.25, -0.5 / 2])
        self.near(node["n_s"], n / np.linalg.norm(n))
        node = self.nodes(looking([60, 0, 5], (60, 0, 0)) + scene.replace("scale = [1, 1, -1]", "scale = 1"))[0]
        self.assertEqual(node["shape"], 2)
        self.refuse(looking([0, 0, 5]) + scene.replace('group = "b"', 'group = "a"'), "scene", "contains itself")
        self.refuse(looking([0, 0, 5]) + scene.replace('group = "b"', 'group = "c"'), "scene", "no group is called")
        stretched = scene.replace("scale = [1, 1, -1]", "scale = [1, 2, 1]")
        node = self.nodes(looking([60, 1, 5], (60, 1, 0)) + stretched)[0]
        self.assertEqual(node["shape"], 2)
        z = math.sqrt(0.75)
        self.near(node["t"], 5 - z)
        self.near(node["n_g"], np.array([0, 0.25, z]) / math.hypot(0.25, z))

    def test_numbers_and_misses(self):
        ball = '[[shape]]\ntype = "sphere"\nradius = 0.1\ncenter = [{}, 0, 0]\n'
        camera = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\nwidth = 3\n'
        channels, _ = self.render(film(3, 1, AOVS) + camera + ball.format(-1) + ball.format(1))
        self.assertEqual(channels["shape_id.I"].tolist(), [[0, -1, 1]])
        self.assertEqual(channels["primitive_id.I"].tolist(), [[0, -1, 0]])
        self.near(channels["depth.Z"], [[4.9, 0, 4.9]])
        self.near(channels["normal.Z"], [[1, 0, 1]])
        self.assertEqual(channels["uv.U"][0, 1], 0)

    def test_no_shapes(self):
        self.assertEqual(list(self.value(film() + DOWN)), [0, 0, 0])


OBJ = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 3 0 0
v 4 0 0
v 4 1 1
vt 0 0
vt 1 0
vt 1 0.5
f 1 2 3 4
g other
usemtl nothing
f 5/1 6/2 -1/-1
f 1 1 1
"""


OCTAHEDRON = """
v 1 0 0
v 0 1 0
v 0 0 1
v -1 0 0
v 0 -1 0
v 0 0 -1
f 1 2 3
f 2 4 3
f 4 5 3
f 5 1 3
f 2 1 6
f 4 2 6
f 5 4 6
f 1 5 6
"""


class Meshes(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name

    def write(self, name, text):
        with open(os.path.join(self.base, name), "wb") as file:
            file.write(text.encode() if isinstance(text, str) else text)
        return os.path.join(self.base, name)

    def test_subdivision(self):
        closed = subdivision.loop(meshes.load(self.write("c.obj", OCTAHEDRON)), 1)
        self.assertEqual((closed.positions.shape, closed.faces.shape), ((18, 3), (32, 3)))
        # By hand: 1 - 4 beta = 33/64, and 3/8 of both ends (opposite vertices cancel).
        corners = closed.positions[closed.faces]
        self.near(corners[0], [[33 / 64, 0, 0], [3 / 8, 3 / 8, 0], [3 / 8, 0, 3 / 8]])
        self.near(corners[3], [[3 / 8, 3 / 8, 0], [0, 3 / 8, 3 / 8], [3 / 8, 0, 3 / 8]])
        # A single triangle has boundary edges only: its limit is a spline.
        open_ = subdivision.loop(meshes.Triangles(np.array([[0, 0, 0], [8, 0, 0], [0, 8, 0.0]]), np.array([[0, 1, 2], [0, 0, 1]])), 1)
        self.near(open_.positions[open_.faces][0], [[1, 1, 0], [4, 0, 0], [0, 4, 0]])
        self.assertEqual(len(open_.faces), 4)
        shape = f'[[shape]]\ntype = "mesh"\nfile = "c.obj"\n{"subdivision = {{ scheme = {}, levels = {} }}"}\n'
        found = self.nodes(looking([0, 0, 5], (0.01, 0.02, 0)) + shape.format('"loop"', 5), base=self.base)[0]
        # In the limit a point v goes to (w v + sum of its k neighbours)/(w + k) with w = 3/(8
        # beta): 24/55 of this one.
        self.assertLess(abs(5 - found["t"] - 24 / 55), 3e-3)
        self.near(found["n_s"], [0, 0, 1], atol=0.1)
        self.refuse(looking([0, 0, 5]) + shape.format('"butterfly"', 1), "scene", "scheme", base=self.base)
        self.refuse(looking([0, 0, 5]) + shape.format('"loop"', 9), "scene", "levels", base=self.base)

    def test_displacement(self):
        """By hand, with a height that rises along z in object space: z + 1/2, from 0 to 1."""
        self.write("c.obj", OCTAHEDRON)
        height = '{ type = "solid", size = [1, 1, 2], values = [0, 1], wrap = "clamp", mapping = { transform = [{ translate = [0, 0, 1] }, { scale = 0.5 }] } }'
        shape = '[[shape]]\ntype = "mesh"\nfile = "c.obj"\ntransform = { scale = 2 }\n'
        shape += f"displacement = {{ height = {height}, scale = 0.5, offset = 0.25 }}\n"
        # Tips at 1.375 and -0.875, the others at 1.125, all twice that in the world.
        for origin, depth in (([0, 0, 5], 5 - 2.75), ([0, 0, -5], 5 - 1.75), ([5, 0, 0], 5 - 2.25)):
            node = self.nodes(looking(origin, up=[0, 1, 0.1]) + shape, base=self.base)[0]
            self.near(node["t"], depth, rel=1e-4)
        # The normal at the tip of +x: its four triangles after they have moved.
        up, down = np.array([1.375, 0, 1.125]), np.array([0.875, 0, -1.125])
        n = (up + down) / np.linalg.norm(up + down)
        node = self.nodes(looking([5, 0, 0]) + shape, base=self.base)[0]
        self.near(node["n_s"], n, atol=1e-3)
        flat = self.nodes(looking([5, 0.1, 0.1], (0, 0.1, 0.1)) + shape + 'shading = "flat"\n', base=self.base)[0]
        self.assertEqual(flat["n_s"], flat["n_g"])

        def refuse(text, *words):
            self.refuse(looking([0, 0, 5]) + shape.replace(height, text), "scene", *words, base=self.base)

        refuse('{ type = "checker" }', "no texture coordinates")
        refuse("-1", "height")
        refuse("1, depth = 2", "depth")
        refuse("1, scale = nan, offset = 0 } #", "scale")

    def test_displacement_by_vectors(self):
        """The vector (0.5, -0.25, 1), twice, by hand along the axes of the object and of tangents.
        """
        self.write("c.obj", OCTAHEDRON)
        vector = "displacement = {{ vector_map = [0.75, 0.375, 1], scale = 2{} }}\n"
        shape = '[[shape]]\ntype = "mesh"\nfile = "c.obj"\n' + vector

        def tip(more, normal):
            """How far the tip along this axis has moved."""
            errors = []
            fields = Fields(document.tomllib.loads(vector.format(more)), "shape", errors)
            moves = displacement.read(fields, textures.Textures({}, None, errors, []), False)
            self.assertEqual(errors, [])
            n = np.array([normal], dtype=np.float64)
            return moves(n, n, np.zeros((1, 2)))[0]

        x, y, z = np.eye(3)
        self.near(tip("", x), [1, -0.5, 2])
        tangent = ', space = "tangent"'
        # At +y the tangent is x, the bitangent -z; at +x it has no direction.
        self.near(tip(tangent, y), [1, 2, 0.5])
        self.near(tip(tangent, x), [0, 0, 0])
        # At +x the tangent around y is -z, the bitangent y; at +y there is none.
        self.near(tip(tangent + ", axis = [0, 2, 0]", x), [2, -0.5, -1])
        self.near(tip(tangent + ", axis = [0, 2, 0]", y), [0, 0, 0])
        # Neither where rounding gives it one.
        self.near(tip(tangent + ", axis = [0, 2, 0]", np.array([1e-16, 1, 0])), [0, 0, 0])
        self.near(tip(tangent + ", tangent = [0, 3, 4]", z), [0.5, 1, 2])
        node = self.nodes(looking([1, -0.5, 8], (1, -0.5, 0)) + shape.format(""), base=self.base)[0]
        self.near(node["t"], 8 - 3, rel=1e-5)
        for more, word in ((", offset = 0", "offset"), (", height = 1", "height"), (", axis = [0, 1, 0]", "axis"), (', space = "world"', "space")):
            self.refuse(looking([0, 0, 5]) + shape.format(more), "scene", word, base=self.base)
        heights = shape.replace("vector_map = [0.75, 0.375, 1]", "height = 1")
        self.refuse(looking([0, 0, 5]) + heights.format(tangent), "scene", "space", base=self.base)

    def test_heightfield_of_a_texture(self):
        """A grid of 2 x 1 quads, whose heights are voxels at the vertices."""
        values = "[0.0, 0.5, 0.25, 1.0, 0.75, 0.125]"
        # The voxels along x and y have their middles at (i + 0.5)/3 and (j + 0.5)/2.
        by_uv = f'{{ type = "solid", size = [3, 2, 1], values = {values}, filter = "nearest", wrap = "clamp", mapping = {{ projection = "uv" }} }}'
        by_place = by_uv.replace('projection = "uv"', "transform = [{ translate = [1, 1, 0] }, { scale = 0.5 }]")
        for height in (by_uv, by_place):
            shape = f'[[shape]]\ntype = "heightfield"\ncolumns = 2\nrows = 1\nheight = {height}\nscale = 2\noffset = 0.25\n'
            z = [[2 * (h - 0.25) for h in row] for row in ([0.0, 0.5, 0.25], [1.0, 0.75, 0.125])]
            # On the edges and diagonals of the triangles, halfway between two vertices.
            for x, y, expected in (
                (-0.5, -0.999999, (z[0][0] + z[0][1]) / 2),
                (0.5, 0.999999, (z[1][1] + z[1][2]) / 2),
                (-0.5, 0, (z[0][0] + z[1][1]) / 2),
                (0.5, 0, (z[0][1] + z[1][2]) / 2),
            ):
                node = self.nodes(looking([x + 1e-6, y, 5], (x + 1e-6, y, 0)) + shape)[0]
                self.near(5 - node["t"], expected, atol=2e-5)
            node = self.nodes(looking([0.5, -0.5, 5], (0.5, -0.5, 0)) + shape)[0]
            n = np.array([z[0][1] - z[0][2], (z[0][2] - z[1][2]) / 2, 1])
            self.near(node["n_g"], n / np.linalg.norm(n), rel=1e-5)

        def refuse(text, *words):
            self.refuse(looking([0, 0, 5]) + '[[shape]]\ntype = "heightfield"\n' + text, "scene", *words)

        refuse("height = 0.5\nseed = 1", "seed", "together")
        refuse("height = 0.5\namplitude = 1", "amplitude", "together")
        refuse("scale = 2", "scale", "requires `height`")
        refuse("offset = 2", "offset", "requires `height`")
        refuse("height = -1", ">= 0")
        refuse("height = 1e30\nscale = 1e30", "height", "single precision")

    def test_displacement_at_seams(self):
        """A point of two triangles with different texture coordinates: the mean over its corners.
        """
        square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 3 0\nf 1/1 2/2 3/1\nf 1/3 3/1 4/1\n"
        mesh = meshes.load(self.write("square.obj", square))
        rise = lambda points, normals, uvs: uvs[:, :1] * normals  # noqa: E731
        moved = subdivision.loop(mesh, 0, rise)
        corners = moved.positions[moved.faces]
        self.near(corners[:, :, 2], [[1.5, 1, 0], [1.5, 0, 0]])
        self.near(corners[:, :, :2], mesh.positions[mesh.faces][:, :, :2])

    def test_heights_are_those_of_textures(self):
        """Heights in float64 agree with Mitsuba's own textures in float32."""
        generator = np.random.default_rng(5)
        texels = generator.random((4, 5, 3)).astype(np.float32)
        uvs = generator.random((500, 2)) * 5 - 2
        mapping = mappings.Mapping("uv")
        for kind in ("bilinear", "nearest"):
            for wrap in product(textures.WRAPS, textures.WRAPS):
                image = textures.Image(texels, kind, wrap, (1.5, 2.0), (0.25, 0.5), mapping)
                self.same_heights(image, uvs)
        checker = textures.Checker((0.8,) * 3, (0.2,) * 3, (2.0, 3.0), (0.1, 0.3), mapping)
        self.same_heights(checker, uvs)

    def same_heights(self, texture, uvs):
        found = displacement.heights(texture, np.zeros((len(uvs), 3)), np.zeros((len(uvs), 3)), uvs)
        si = mi.SurfaceInteraction3f()
        si.uv = mi.Point2f(np.ascontiguousarray(uvs.T.astype(np.float32)))
        expected = np.array(texture.build().eval(si))[0]
        # A coordinate next to an edge may be on its other side in float32.
        self.assertGreater(np.mean(np.abs(found - expected) < 1e-5), 0.995)

    def test_obj(self):
        triangles = meshes.load(self.write("a.obj", OBJ))
        corners = triangles.positions[triangles.faces].tolist()
        self.assertEqual(len(corners), 4)
        self.assertEqual(corners[1], [[0, 0, 0], [1, 1, 0], [0, 1, 0]])
        self.assertEqual(corners[2], [[3, 0, 0], [4, 0, 0], [4, 1, 1]])
        self.assertEqual(triangles.uvs[triangles.faces][2].tolist(), [[0, 0], [1, 0], [1, 0.5]])
        self.assertEqual(triangles.uvs[triangles.faces][0].tolist(), [[0, 0]] * 3)
        self.assertIsNone(triangles.normals)
        shape = '[[shape]]\ntype = "mesh"\nfile = "a.obj"\n'
        node = self.nodes(looking([0.2, 0.7, 3], (0.2, 0.7, 0)) + shape, base=self.base)[0]
        self.assertEqual((node["primitive"], node["n_s"]), (1, [0, 0, 1]))
        node = self.nodes(looking([3.8, 0.4, 3], (3.8, 0.4, 0)) + shape, base=self.base)[0]
        self.assertEqual(node["primitive"], 2)
        self.near(node["uv"], [0.8, 0.2])

    def test_ply_forms(self):
        header = "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        header += "property float nx\nproperty float ny\nproperty float nz\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n"
        points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
        rows = np.hstack([points, np.tile([0, 0.6, 0.8], (4, 1))])
        lines = "".join(" ".join(map(str, row)) + "\n" for row in rows)
        ascii_ = meshes.load(self.write("a.ply", header.format("ascii", 1) + lines + "4 0 1 2 3\n"))
        little = header.format("binary_little_endian", 2).encode() + rows.astype("<f4").tobytes()
        face = [np.array([3], dtype="u1").tobytes() + np.array(corners, dtype="<i4").tobytes() for corners in ((0, 1, 2), (0, 2, 3))]
        binary = meshes.load(self.write("b.ply", little + b"".join(face)))
        big = header.format("binary_big_endian", 1).encode() + rows.astype(">f4").tobytes()
        fan = meshes.load(self.write("c.ply", big + np.array([4], dtype="u1").tobytes() + np.arange(4, dtype=">i4").tobytes()))
        for triangles in (ascii_, binary, fan):
            self.assertEqual(triangles.faces.tolist(), [[0, 1, 2], [0, 2, 3]])
            np.testing.assert_allclose(triangles.positions, points)
            np.testing.assert_allclose(triangles.normals, np.tile([0, 0.6, 0.8], (4, 1)), rtol=1e-6)
        shape = '[[shape]]\ntype = "mesh"\nfile = "b.ply"\n'
        camera = looking([0.2, 0.7, 3], (0.2, 0.7, 0))
        self.near(self.nodes(camera + shape, base=self.base)[0]["n_s"], [0, 0.6, 0.8])
        self.near(self.nodes(camera + shape + 'shading = "flat"\n', base=self.base)[0]["n_s"], [0, 0, 1])

    def test_same_order_as_mitsuba(self):
        """Compared with Mitsuba's own loader, on a file where both must agree: triangles in file
        order, none merged.
        """
        generator = np.random.default_rng(3)
        points = generator.normal(size=(40, 3))
        text = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points)
        faces = np.array([generator.choice(40, 3, replace=False) for _ in range(60)])
        text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
        ours = meshes.load(self.write("m.obj", text))
        theirs = mi.traverse(mi.load_dict({"type": "obj", "filename": os.path.join(self.base, "m.obj"), "face_normals": True}))
        positions = np.array(theirs["vertex_positions"]).reshape(-1, 3)[np.array(theirs["faces"]).reshape(-1, 3)]
        np.testing.assert_allclose(ours.positions[ours.faces], positions, atol=1e-6)

    def test_broken_files(self):
        head = looking([0, 0, 3]) + '[[shape]]\ntype = "mesh"\nfile = "x.EXT"\n'
        self.refuse(head.replace("EXT", "obj"), "scene", "cannot be read", base=self.base)
        self.write("x.obj", "v 0 0 0\nf 1 2 3\n")
        self.refuse(head.replace("EXT", "obj"), "scene", "out of range", base=self.base)
        self.write("x.ply", "ply\nformat ascii 1.0\nelement vertex 1\n")
        self.refuse(head.replace("EXT", "ply"), "scene", "malformed", base=self.base)
        self.refuse(head.replace("EXT", "fbx"), "scene", ".obj, .ply", base=self.base)

    def test_ply_lists_of_vertices_are_skipped(self):
        header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty list uchar int extra\n"
        header += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        found = meshes.load(self.write("l.ply", header + "0 1 2 4 5 6\n2 3 1 7 8\n4 5 0 9\n3 0 1 2\n"))
        np.testing.assert_array_equal(found.positions, [[0, 1, 6], [2, 3, 8], [4, 5, 9]])
        np.testing.assert_array_equal(found.faces, [[0, 1, 2]])

    def test_ply_headers(self):
        head = looking([0, 0, 3]) + '[[shape]]\ntype = "mesh"\nfile = "x.ply"\n'
        good = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
        good += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        self.write("x.ply", good)
        self.nodes(head, base=self.base)
        for old, new, word in (
            ("float y\n", "float y\nproperty float y\n", "property y of vertex twice"),
            ("element face", "element vertex 0\nelement face", "element vertex twice"),
        ):
            self.write("x.ply", good.replace(old, new))
            self.refuse(head, "scene", word, base=self.base)
        # Names of texture coordinates in the model, and one pair that it does not know.
        for names, found in (("u v", True), ("s t", True), ("texture_u texture_v", True), ("texture_s texture_t", False)):
            lines = "".join(f"property float {name}\n" for name in names.split())
            text = good.replace("float z\n", "float z\n" + lines)
            for point in ("0 0 0", "1 0 0", "0 1 0"):
                text = text.replace(f"\n{point}\n", f"\n{point} 5 6\n")
            uvs = meshes.load(self.write("x.ply", text)).uvs
            self.assertEqual(None if uvs is None else uvs.tolist(), [[5, 6]] * 3 if found else None, names)

    def test_a_changed_file_is_read_again(self):
        scene = looking([0.2, 0.2, 3], (0.2, 0.2, 0)) + '[[shape]]\ntype = "mesh"\nfile = "a.obj"\n'
        self.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        self.near(self.nodes(scene, base=self.base)[0]["t"], 3)
        self.write("a.obj", "v 0 0 -1.5\nv 1 0 -1.5\nv 0 1 -1.5\nf 1 2 3\n")
        self.near(self.nodes(scene, base=self.base)[0]["t"], 4.5)


if __name__ == "__main__":
    unittest.main()
