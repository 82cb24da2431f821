"""Vertex colours, second texture coordinates, mesh tangents, and textures made of others (model §8
to §10), in rendered images.
"""

import json
import os
import tempfile
import unittest

import numpy as np

from support import Case, film, write_exr
from test_gltf import SQUARE, Builder
from whitstone_mitsuba import compounds, operations, textures
from whitstone_mitsuba.runtime import mi

LOOK = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n'
AMBIENT = '[[light]]\ntype = "ambient"\nradiance = 1\n'
# The square [0, 2] x [0, 4] at 4 x 8 pixels.
WINDOW = "window = { l = 0, r = 2, b = 0, t = 4 }\n"
ROW, COLUMN = np.mgrid[0:8, 0:4]
X, Y = (COLUMN + 0.5) / 2, (7.5 - ROW) / 2
# 1 at the vertices (0, 0), (2, 0), (2, 4) and (0, 4) in turn: weights of the lower triangle, then
# of the upper one.
LOWER = Y < 2 * X
WEIGHTS = np.where(
    LOWER,
    [1 - X / 2, X / 2 - Y / 4, Y / 4, 0 * X],
    [1 - Y / 4, 0 * X, X / 2, Y / 4 - X / 2],
)
COLORS = np.array([[0.1, 0.8, 0.3, 1], [0.9, 0.2, 0.3, 0.5], [0.4, 0.6, 0.7, 0.25], [0.2, 0.3, 0.9, 0]])


def square(**more):
    """A file with all attributes."""
    builder = Builder()
    builder.attribute("POSITION", SQUARE)
    builder.attribute("COLOR_0", COLORS.tolist())
    builder.attribute("TEXCOORD_0", [[x / 2, 1 - y / 4] for x, y, _ in SQUARE])
    # The second set has u and v exchanged and three times as large.
    builder.attribute("TEXCOORD_1", [[3 * y / 4, 1 - 3 * x / 2] for x, y, _ in SQUARE])
    if "TANGENT" in more:
        # Without normals it has no effect.
        builder.attribute("NORMAL", [[0, 0, 1]] * 4)
    for name, rows in more.items():
        builder.attribute(name, rows)
    builder.primitive["indices"] = builder.accessor([0, 1, 2, 0, 2, 3], "B")
    return builder


def mesh(texture, more="vertex_colors = true, uv_sets = [0, 1]", kind="emissive", key="radiance"):
    lines = more.replace(", ", "\n").replace("[0\n1]", "[0, 1]")
    return f'[[shape]]\ntype = "mesh"\nfile = "s.gltf"\n{lines}\nmaterial = {{ type = "{kind}", {key} = {texture} }}\n'


class Rendered(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name
        self.put(square())

    def put(self, builder, name="s.gltf"):
        with open(os.path.join(self.base, name), "wb") as file:
            file.write(builder.embedded())

    def seen(self, shapes, head=""):
        channels, answer = self.render(film(4, 8) + LOOK + WINDOW + head + shapes, self.base)
        self.answer = answer
        return np.stack([channels[letter] for letter in "RGB"], axis=2)


VERTEX = '{ type = "vertex_color" }'


class Attributes(Rendered):
    def test_colors(self):
        expected = np.einsum("kji,kc->jic", WEIGHTS, COLORS)
        self.near(self.seen(mesh(VERTEX)), expected[:, :, :3], rel=1e-5)
        self.assertIn("vertex_color", [entry["type"] for entry in self.answer["hosted"]])
        alpha = self.seen(mesh('{ type = "vertex_color", channel = "alpha" }'))
        self.near(alpha, np.repeat(expected[:, :, 3:], 3, axis=2), rel=1e-5, atol=1e-6)
        # As a reflectance, through Mitsuba's own BSDF.
        limited = '{ type = "product", factors = [0.5, { type = "vertex_color" }] }'
        found = self.seen(mesh(limited, kind="matte", key="reflectance"), AMBIENT)
        self.near(found, expected[:, :, :3] / 2, rel=1e-5)
        lamp = '[[light]]\ntype = "directional"\ndirection = [0, 0, -1]\nirradiance = 3\n'
        found = self.seen(mesh(limited, kind="matte", key="reflectance"), lamp)
        self.near(found, expected[:, :, :3] * 1.5 / np.pi, rel=1e-5)

    def test_without(self):
        self.near(self.seen(mesh(VERTEX, "vertex_colors = false")), np.ones((8, 4, 3)))
        wall = f'[[shape]]\ntype = "plane"\nmaterial = {{ type = "emissive", radiance = {VERTEX} }}\n'
        self.near(self.seen(wall), np.ones((8, 4, 3)))
        # A shape without attributes next to one that has them.
        behind = wall + 'transform = { translate = [0, 0, -1] }\n'
        half = mesh(VERTEX) + 'transform = { translate = [1, 0, 0] }\n'
        found = self.seen(behind + half)
        self.near(found[:, :2], np.ones((8, 2, 3)))
        self.near(found[:, 2:], np.einsum("kji,kc->jic", WEIGHTS, COLORS)[:, :2, :3], rel=1e-5)

    def test_instances_and_mirrors(self):
        """Rotated by half a turn about the middle, once with a group; then mirrored."""
        turned = np.einsum("kji,kc->jic", WEIGHTS, COLORS)[::-1, ::-1, :3]
        steps = "transform = [{ translate = [-1, -2, 0] }, { rotate = { axis = [0, 0, 1], degrees = 180 } }, { translate = [1, 2, 0] }]\n"
        self.near(self.seen(mesh(VERTEX) + steps), turned, rel=1e-5)
        group = "[group.g]\n" + mesh(VERTEX).replace("[[shape]]", "[[group.g.shape]]")
        self.near(self.seen(group + '[[shape]]\ntype = "instance"\ngroup = "g"\n' + steps), turned, rel=1e-5)
        mirror = "transform = [{ scale = [-1, 1, 1] }, { translate = [2, 0, 0] }]\n"
        found = self.seen(mesh(VERTEX) + mirror)
        self.near(found, np.einsum("kji,kc->jic", WEIGHTS, COLORS)[:, ::-1, :3], rel=1e-5)

    def test_second_texture_coordinates(self):
        ramps = "a = 0, b = 1, mapping = {{ projection = 'uv', {} }}"
        for axis, expected in (("", 3 * Y / 4), ("transform = { rotate = { axis = [0, 0, 1], degrees = -90 } }, ", 3 * X / 2)):
            text = '{ type = "gradient", ' + ramps.format(axis + "uv_set = 1") + " }"
            self.near(self.seen(mesh(text))[:, :, 1], expected % 1, rel=1e-5, atol=2e-6)
        # (0, 0) without a second set, and on other shapes.
        text = '{ type = "gradient", a = 0.25, b = 1, mapping = { projection = "uv", uv_set = 1 } }'
        self.near(self.seen(mesh(text, "uv_sets = [0]")), np.full((8, 4, 3), 0.25))
        self.near(self.seen(f'[[shape]]\ntype = "plane"\nmaterial = {{ type = "emissive", radiance = {text} }}\n'), np.full((8, 4, 3), 0.25))
        self.refuse(film() + LOOK + mesh(text.replace('"uv"', '"solid"')), "scene", "uv_set", base=self.base)

    def test_images_by_the_second_set(self):
        texels = np.random.default_rng(4).random((3, 3)).astype(np.float32)
        write_exr(os.path.join(self.base, "t.exr"), {"Y": texels})
        for filtering in ("nearest", "ewa"):
            text = f'{{ type = "image", file = "t.exr", filter = "{filtering}", mapping = {{ uv_set = 1 }} }}'
            found = self.seen(mesh(text))[:, :, 0]
            u, v = 3 * (3 * Y / 4), 3 * (1 - 3 * X / 2)
            if filtering == "nearest":
                expected = texels[np.floor(v).astype(int) % 3, np.floor(u).astype(int) % 3]
            else:
                # Without a footprint: bilinear.
                i, j = np.floor(u - 0.5).astype(int), np.floor(v - 0.5).astype(int)
                s, t = u - 0.5 - i, v - 0.5 - j
                corner = [[texels[(j + b) % 3, (i + a) % 3] for a in (0, 1)] for b in (0, 1)]
                expected = (1 - t) * ((1 - s) * corner[0][0] + s * corner[0][1]) + t * ((1 - s) * corner[1][0] + s * corner[1][1])
            self.near(found, expected, rel=1e-4, atol=1e-4)

    def test_csg(self):
        """A pyramid without its top: the base shows the colours of its vertices."""
        builder = Builder()
        builder.attribute("POSITION", [*SQUARE, [1, 2, -3]])
        builder.attribute("COLOR_0", [*COLORS.tolist(), [1, 1, 1, 1]])
        builder.primitive["indices"] = builder.accessor([0, 1, 2, 0, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4], "B")
        self.put(builder)
        operand = '{ type = "mesh", file = "s.gltf", vertex_colors = true }'
        box = '{ type = "box", transform = [{ scale = 9 }, { translate = [0, 0, -10] }] }'
        material = f'material = {{ type = "emissive", radiance = {VERTEX} }}\n'
        text = f'[[shape]]\ntype = "csg"\noperation = "difference"\noperands = [{operand}, {box}]\n{material}'
        self.near(self.seen(text), np.einsum("kji,kc->jic", WEIGHTS, COLORS)[:, :, :3], rel=1e-5)
        # The box comes first, and shows no colours.
        front = box.replace("-10", "-6")
        union = text.replace("difference", "union").replace(f"[{operand}, {box}]", f"[{front}, {operand}]")
        self.near(self.seen(union), np.ones((8, 4, 3)))

    def test_gouraud(self):
        """Values of vertices are interpolated: here the product of two linear functions."""
        product = f'{{ type = "product", factors = [{VERTEX}, {VERTEX}] }}'
        head = '[integrator]\ntype = "rasterizer"\ninterpolation = "gouraud"\nshadows = "none"\n'
        look = LOOK.replace("orthographic", "perspective").replace("5]", "1]").replace("[0, 0", "[1, 2")
        view = "window = { l = -1, r = 1, b = -2, t = 2 }\n"
        channels, _ = self.render(film(4, 8) + look + view + head + mesh(product), self.base)
        expected = np.einsum("kji,kc->jic", WEIGHTS, COLORS[:, :3] ** 2)
        self.near(np.stack([channels[letter] for letter in "RGB"], axis=2), expected, rel=1e-5)

    def test_holes(self):
        """A mask with the alpha of vertices lets light through."""
        hole = '{ type = "threshold", input = { type = "vertex_color", channel = "alpha" }, at = 0.4 }'
        shape = mesh(hole, kind="mask", key="opacity").replace(" }\n", ', material = { type = "emissive", radiance = 2 } }\n')
        alpha = np.einsum("kji,k->ji", WEIGHTS, COLORS[:, 3])
        # The middle of this pixel has an alpha of 0.4 up to rounding.
        self.assertGreater(np.abs(alpha - 0.4).min(), 1e-3)
        self.near(self.seen(shape)[:, :, 0], np.where(alpha >= 0.4, 2, 0))
        # And shadow rays.
        floor = '[[shape]]\ntype = "plane"\ntransform = { translate = [0, 0, -1] }\nmaterial = { type = "matte", reflectance = 1 }\n'
        lamp = '[[light]]\ntype = "directional"\ndirection = [0, 0, -1]\nirradiance = 1\n'
        found = self.seen(shape + floor, lamp)[:, :, 0]
        self.near(found, np.where(alpha >= 0.4, 2, 1 / np.pi))

    def test_mitsuba_cannot_call_them(self):
        lamp = '[[light]]\ntype = "directional"\ndirection = [0, 0, -1]\nirradiance = 3\n'
        second = '{ type = "checker", mapping = { uv_set = 1 } }'
        for texture in (VERTEX, second, '{ type = "product", factors = [0.5] }'):
            scene = film(4, 8) + LOOK + WINDOW + lamp + mesh(texture, kind="matte", key="reflectance")
            answer = self.ask("check", scene, self.base)
            self.assertIn("Python", answer["why"]["direct"])
            refused = operations.answer({"op": "stock", "scene": scene, "base": self.base, "out": "none.exr"})
            self.assertEqual(refused["kind"], "unsupported")

    def test_refused(self):
        head = film() + LOOK
        for more, *words in (
            ("vertex_colors = 1", "vertex_colors", "true or false"),
            ("uv_sets = [0, 0]", "uv_sets", "different"),
            ("uv_sets = [0, 1, 2]", "uv_sets", "two"),
            ("uv_sets = 0", "uv_sets"),
            ("skin = 0", "file", "/skins"),
            ("mesh = -1", "mesh"),
            ("weights = ['a']", "weights"),
            ("tangents = true, subdivision = { scheme = 'loop'\nlevels = 1 }".replace("\n", ", "), "tangents", "subdivision"),
        ):
            shape = f'[[shape]]\ntype = "mesh"\nfile = "s.gltf"\n{more.replace(", subdivision", chr(10) + "subdivision")}\n'
            with self.subTest(more):
                self.refuse(head + shape, "scene", *words, base=self.base)
        with open(os.path.join(self.base, "a.obj"), "w", encoding="utf-8") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        shape = '[[shape]]\ntype = "mesh"\nfile = "a.obj"\n'
        self.refuse(head + shape + "mesh = 0\n", "scene", "shape[0].mesh", ".glb", base=self.base)
        self.refuse(head + shape + "uv_sets = [1]\n", "scene", "only glTF", base=self.base)
        self.value(head + shape + "uv_sets = []\nvertex_colors = false\nsubdivision = { scheme = 'loop', levels = 1 }\n", base=self.base)

    def test_singular_skins_have_no_normals(self):
        """Where the interpolated normal is zero, it is that of the triangle."""
        builder = square(NORMAL=[[0, 0.6, 0.8]] * 4, WEIGHTS_0=[[1, 0, 0, 0]] * 4)
        builder.attribute("JOINTS_0", [[0, 0, 0, 0]] * 4, "B")
        builder.document = {"nodes": [{"scale": [1, 1, 0]}], "skins": [{"joints": [0]}]}
        self.put(builder)
        shape = mesh("0.5", "skin = 0", "matte", "reflectance")
        lamp = '[[light]]\ntype = "directional"\ndirection = [0, 0, -1]\nirradiance = 2\n'
        self.near(self.seen(shape, lamp), np.full((8, 4, 3), 1 / np.pi))

    def test_mesh_lights(self):
        """The points of a light of glTF are those of the same OBJ."""
        with open(os.path.join(self.base, "a.obj"), "w", encoding="utf-8") as file:
            file.write("v 0 0 0\nv 2 0 0\nv 2 4 0\nv 0 4 0\nf 1 2 3 4\n")
        light = '[[light]]\ntype = "area"\nshape = "mesh"\nfile = "{}"\nradiance = 1\n'
        floor = '[[shape]]\ntype = "plane"\ntransform = {{ translate = [0, 0, {}] }}\n'
        # It is not visible, and lights what is in front of it.
        found = [self.seen(floor.format(2), light.format(name)) for name in ("s.gltf", "a.obj")]
        self.assertEqual(found[0].tolist(), found[1].tolist())
        back = [self.seen(floor.format(-2), light.format(name)) for name in ("s.gltf", "a.obj")]
        self.assertEqual(back[0].max(), 0)
        self.assertEqual(back[1].max(), 0)

    def test_subdivided(self):
        shape = '[[shape]]\ntype = "mesh"\nfile = "s.gltf"\nsubdivision = { scheme = "loop", levels = 2 }\n'
        heights = "displacement = {{ height = {}, scale = 2, offset = 0.5 }}\n"
        mixed = '{ type = "mix", a = { type = "product", factors = [2, 0.25] }, b = { type = "vertex_color" }, weight = 0.75 }'
        nodes = self.nodes(film() + LOOK + "width = 0.1\n" + shape + heights.format(mixed) + "transform = { translate = [-1, -2, 0] }\n", base=self.base)
        # 0.25 * 0.5 + 0.75 * 1, minus 0.5, twice.
        self.near(nodes[0]["p"], [0, 0, 0.75], rel=1e-6, atol=1e-6)
        by_uv = heights.format('{ type = "product", factors = [{ type = "checker" }] }')
        self.refuse(film() + LOOK + shape + "uv_sets = []\n" + by_uv, "scene", "no texture coordinates", base=self.base)


class Tangents(Rendered):
    def mirrored(self, shape, x=0.7, y=0.9):
        """The direction of the reflection of a ray from straight above."""
        view = f'window = {{ l = {x - 0.01}, r = {x + 0.01}, b = {y - 0.01}, t = {y + 0.01} }}\n'
        ball = '[[shape]]\ntype = "sphere"\nradius = 50\nmaterial = { type = "emissive" }\n'
        nodes = self.nodes(film() + LOOK + view + shape + ball, base=self.base)
        self.assertEqual([node["path"] for node in nodes], ["", "R"])
        d = np.array(nodes[1]["p"]) - nodes[0]["p"]
        return d / np.linalg.norm(d)

    def shape(self, color, more="", keys="tangents = true"):
        text = f'{{ type = "normal_map", map = {color}, tangent = "mesh", {more} material = {{ type = "mirror" }} }}'
        return f'[[shape]]\ntype = "mesh"\nfile = "s.gltf"\n{keys}\nmaterial = {text}\n'

    def direction(self, n):
        """A ray along -z, reflected at this normal."""
        n = np.array(n) / np.linalg.norm(n)
        return 2 * n[2] * n - np.array([0, 0, 1])

    def test_stored(self):
        tangents = [[0, 1, 0, -1]] * 4
        self.put(square(TANGENT=tangents))
        # t = y; the second axis is -(z x y) = x.
        for color, n in (("[0.5, 0.8, 0.9]", [0.6, 0, 0.8]), ("[0.8, 0.5, 0.9]", [0, 0.6, 0.8]), ("[0.7, 0.6, 0.75]", [0.2, 0.4, 0.5])):
            self.near(self.mirrored(self.shape(color)), self.direction(n), rel=1e-5, atol=1e-5)
        # A positive fourth number of the first vertex only.
        self.put(square(TANGENT=[[0, 1, 0, 0], *tangents[1:]]))
        self.near(self.mirrored(self.shape("[0.5, 0.8, 0.9]")), self.direction([-0.6, 0, 0.8]), rel=1e-5, atol=1e-5)

    def test_strength(self):
        self.put(square(TANGENT=[[1, 0, 0, 1]] * 4))
        found = self.mirrored(self.shape("[0.7, 0.6, 0.75]", "strength = 0.5,"))
        self.near(found, self.direction([0.2, 0.1, 0.5]), rel=1e-5, atol=1e-5)
        found = self.mirrored(self.shape("[0.7, 0.6, 0.75]", "strength = -1,"))
        self.near(found, self.direction([-0.4, -0.2, 0.5]), rel=1e-5, atol=1e-5)
        plain = self.shape("[0.7, 0.6, 0.75]", "strength = 0,").replace('tangent = "mesh", ', "")
        self.near(self.mirrored(plain), [0, 0, 1], rel=1e-5, atol=1e-5)

    def test_computed_and_interpolated(self):
        # By the first set, T is x; by the second one, u grows along y, so T is y and D < 0.
        self.near(self.mirrored(self.shape("[0.7, 0.6, 0.75]")), self.direction([0.4, 0.2, 0.5]), rel=1e-5, atol=1e-5)
        other = self.shape("[0.7, 0.6, 0.75]", keys="tangents = true\nuv_sets = [1]")
        self.near(self.mirrored(other), self.direction([0.2, 0.4, 0.5]), rel=1e-5, atol=1e-5)
        # The tangent is interpolated, then normalised.
        self.put(square(TANGENT=[[1, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1], [0, 1, 0, 1]]))
        x, y = 0.7, 0.9
        t = np.array([1 - y / 4, y / 4, 0])
        t = t / np.linalg.norm(t)
        expected = 0.4 * t + 0.2 * np.array([-t[1], t[0], 0]) + [0, 0, 0.5]
        self.near(self.mirrored(self.shape("[0.7, 0.6, 0.75]"), x, y), self.direction(expected), rel=1e-5, atol=1e-5)

    def test_transforms(self):
        """A stretched and a mirrored mesh: X is a difference of points, h changes its sign."""
        self.put(square(TANGENT=[[1, 1, 0, 1]] * 4))
        t = np.array([3, 1, 0]) / 10**0.5
        across = np.array([-t[1], t[0], 0])
        found = self.mirrored(self.shape("[0.7, 0.6, 0.75]") + "transform = { scale = [3, 1, 1] }\n")
        self.near(found, self.direction(0.4 * t + 0.2 * across + [0, 0, 0.5]), rel=1e-5, atol=1e-5)
        group = "[group.g]\n" + self.shape("[0.7, 0.6, 0.75]").replace("[[shape]]", "[[group.g.shape]]")
        placed = '[[shape]]\ntype = "instance"\ngroup = "g"\ntransform = [{ scale = [-3, 1, 1] }, { translate = [3, 0, 0] }]\n'
        t = np.array([-3, 1, 0]) / 10**0.5
        across = -np.array([-t[1], t[0], 0])
        self.near(self.mirrored(group + placed), self.direction(0.4 * t + 0.2 * across + [0, 0, 0.5]), rel=1e-5, atol=1e-5)

    def test_without(self):
        self.put(square(TANGENT=[[1, 0, 0, 1]] * 4))
        self.near(self.mirrored(self.shape("[0.7, 0.6, 0.75]", keys="")), [0, 0, 1], atol=1e-6)
        wall = '[[shape]]\ntype = "plane"\n' + self.shape("[0.7, 0.6, 0.75]").splitlines()[-1] + "\n"
        self.near(self.mirrored(wall), [0, 0, 1], atol=1e-6)
        self.put(square(TANGENT=[[0, 0, 1, 1]] * 4))
        self.near(self.mirrored(self.shape("[0.7, 0.6, 0.75]")), [0, 0, 1], atol=1e-6)
        text = self.shape("0.5", "axis = [0, 1, 0],")
        self.refuse(film() + LOOK + text, "scene", "axis", "tangent", base=self.base)
        self.refuse(film() + LOOK + self.shape("0.5").replace('"mesh", ', '"sphere", '), "scene", "tangent", base=self.base)


def user(texture):
    """A shape with this shared texture."""
    return f'[[shape]]\ntype = "sphere"\nmaterial = {{ type = "matte", reflectance = "{texture}" }}\n'


class Compounds(Rendered):
    def test_values(self):
        ramp = '{ type = "gradient", a = 0, b = 1, scale = 0.5 }'
        turned = '{ type = "gradient", a = [0, 0.5, 1], b = 1, scale = 0.25, mapping = { transform = { rotate = { axis = [0, 0, 1], degrees = -90 } } } }'
        x, y = np.repeat((X / 2)[:, :, None], 3, axis=2), np.stack([Y / 4, 0.5 + Y / 8, np.ones_like(Y)], axis=2)
        for text, expected in (
            (f'{{ type = "product", factors = [{ramp}, {turned}, [1, 2, 3]] }}', x * y * [1, 2, 3]),
            (f'{{ type = "mix", a = {ramp}, b = {turned} }}', (x + y) / 2),
            (f'{{ type = "mix", a = 2, b = {ramp}, weight = {turned} }}', 2 * (1 - y) + x * y),
            (f'{{ type = "threshold", input = {turned}, at = 0.6 }}', np.where(y >= 0.6, 1, 0)),
            (f'{{ type = "threshold", input = {ramp} }}', np.where(x >= 0.5, 1, 0)),
            ('{ type = "threshold", input = [0.7, 0.69, 0.71], at = 0.7 }', np.broadcast_to([1.0, 0, 1], (8, 4, 3))),
            ('{ type = "product", factors = [0.5] }', np.full((8, 4, 3), 0.5)),
            (f'{{ type = "mix", a = {{ type = "checker", scale = [2, 1] }}, b = {VERTEX}, weight = 0 }}', np.where(x >= 0.5, 0.2, 0.8)),
        ):
            with self.subTest(text):
                self.near(self.seen(mesh(text)), expected, rel=1e-5, atol=1e-6)
                self.assertIn("compound", [entry["type"] for entry in self.answer["hosted"]])

    def test_shared(self):
        """In any order, and several times."""
        shared = (
            '[texture.c]\ntype = "product"\nfactors = ["b", "a", "b"]\n'
            '[texture.a]\ntype = "mix"\na = "b"\nb = 1\n'
            '[texture.b]\ntype = "constant"\nvalue = 0.5\n'
        )
        self.near(self.seen(mesh('"c"'), shared), np.full((8, 4, 3), 0.1875))
        head = film() + LOOK
        for text, *words in (
            ('[texture.a]\ntype = "product"\nfactors = ["a"]\n', "contains itself"),
            ('[texture.a]\ntype = "product"\nfactors = ["b"]\n[texture.b]\ntype = "threshold"\ninput = "a"\n', "contains itself"),
            ('[texture.a]\ntype = "product"\nfactors = ["x"]\n', "texture.a.factors[0]", "'x'"),
            ('[texture.a]\ntype = "product"\nfactors = []\n', "factors", "1 to 16"),
            ('[texture.a]\ntype = "product"\nfactors = [' + "1, " * 17 + "]\n", "factors", "1 to 16"),
            ('[texture.a]\ntype = "product"\n', "factors", "required"),
            ('[texture.a]\ntype = "mix"\na = 1\n', "texture.a.b", "required"),
            ('[texture.a]\ntype = "mix"\na = 1\nb = 0\nweight = 1.5\n', "weight", "from 0 to 1"),
            ('[texture.a]\ntype = "threshold"\ninput = 1\nat = "x"\n', "texture.a.at"),
            ('[texture.a]\ntype = "product"\nfactors = [1]\nmapping = {}\n', "mapping", "unknown key"),
            ('[texture.a]\ntype = "vertex_color"\nchannel = "red"\n', "channel"),
        ):
            with self.subTest(text):
                self.refuse(head + text + user("a"), "scene", *words)

    def nested(self, depth):
        return "".join(f'[texture.t{k}]\ntype = "product"\nfactors = ["t{k + 1}", "t{k + 1}"]\n' for k in range(depth)) + f'[texture.t{depth}]\ntype = "constant"\nvalue = 1\n'

    def test_nesting(self):
        chain = self.nested(16).replace(", ", "]#")
        self.near(self.seen(mesh('"t0"'), chain), np.ones((8, 4, 3)))
        head = film() + LOOK + user("t0")
        self.refuse(head + self.nested(17).replace(", ", "]#"), "scene", "more than 16 deep")
        self.refuse(head + self.nested(900).replace(", ", "]#"), "scene", "more than 16 deep")
        self.refuse(head + self.nested(16), "unsupported", "more than 4096")

    def test_ranges(self):
        image = textures.Constant((-1.0, 2.0, 0.5))
        other = textures.Constant((3.0, 4.0, 3.0))
        color = compounds.VertexColor()
        endless = float("inf")
        for texture, expected in (
            (compounds.Product.of([image, other]), (-4, 8)),
            (compounds.Product.of([image, image]), (-2, 4)),
            (compounds.Product.of([other, color]), (0, endless)),
            (compounds.Product.of([textures.Constant((0.0,) * 3), color]), (0, 0)),
            (compounds.Mix.of([image, other, textures.Constant((0.5, 0.5, 0.5))]), (1, 3)),
            (compounds.Mix.of([image, other, textures.Constant((0.0, 1.0, 0.0))]), (-1, 4)),
            (compounds.Mix.of([image, other, color]), (-1, 4)),
            (compounds.Threshold.of([image], 0.5), (0, 1)),
            (compounds.Threshold.of([other], 0.5), (1, 1)),
            (compounds.Threshold.of([other], 5.0), (0, 0)),
        ):
            self.assertEqual(texture.range(), expected)
        # Only values below 0 are refused where they would be a reflectance.
        self.refuse(film() + LOOK + mesh('{ type = "product", factors = [-1, 1] }', kind="matte", key="reflectance"), "scene", ">= 0", base=self.base)

    def test_bumps(self):
        """The slope of a product with a constant is that of the other factor, times the constant.
        """
        head = '[integrator]\ntype = "whitted"\nmax_depth = 1\n[[light]]\ntype = "background"\nradiance = 1\n'
        block = '{ type = "gradient", a = 0, b = 1, wrap = "clamp", scale = 0.1 }'
        text = '[[shape]]\ntype = "plane"\nmaterial = {{ type = "bump", height = {}, {} material = {{ type = "mirror" }} }}\n'
        view = film() + LOOK + "window = { l = 0.99, r = 1.01, b = 0, t = 0.02 }\n" + head
        product = text.format(f'{{ type = "product", factors = [{block}, 0.5, {VERTEX}] }}', "")
        plain = text.format(block, "scale = 0.5,")
        ball = '[[shape]]\ntype = "sphere"\nradius = 50\nmaterial = { type = "emissive" }\n'
        found = [self.nodes(view + shape + ball)[1]["p"] for shape in (product, plain)]
        self.near(found[0], found[1], rel=1e-4, atol=1e-3)
        self.assertGreater(abs(found[0][0] - 1), 1)
        second = '{ type = "product", factors = [{ type = "checker", mapping = { uv_set = 1 } }] }'
        self.refuse(view + text.format(second, ""), "scene", "height")

    def test_environments_and_projectors(self):
        texels = np.random.default_rng(8).random((4, 8)).astype(np.float32)
        write_exr(os.path.join(self.base, "sky.exr"), {"Y": texels})
        image = '{ type = "image", file = "sky.exr", filter = "nearest" }'
        doubled = f'{{ type = "product", factors = [{image}, 2, {VERTEX}] }}'
        sky = '[[light]]\ntype = "environment"\nradiance = {}\nsamples = {}\n'
        for samples in (0, 3):
            scene = '[[shape]]\ntype = "rectangle"\n' if samples else ""
            found = [self.seen(scene, sky.format(text, samples)) for text in (image, doubled)]
            self.near(found[1], 2 * found[0], rel=1e-5)
            self.assertGreater(found[0].min(), 0)
        lamp = '[[light]]\ntype = "projector"\nposition = [1, 2, 3]\ntarget = [1, 2, 0]\nfov = 90\nimage = {}\nintensity = 1\n'
        found = [self.seen('[[shape]]\ntype = "plane"\n', lamp.format(text)) for text in (image, doubled)]
        self.near(found[1], 2 * found[0], rel=1e-5)
        self.assertGreater(found[0].max(), 0)

    def test_footprints(self):
        """A filtered image inside a product is the product of the filtered image."""
        texels = np.random.default_rng(9).random((64, 64)).astype(np.float32)
        write_exr(os.path.join(self.base, "t.exr"), {"Y": texels})
        image = '{ type = "image", file = "t.exr", filter = "trilinear" }'
        found = [self.seen(mesh(text)) for text in (image, f'{{ type = "product", factors = [{image}, 0.5] }}')]
        self.near(found[1], found[0] / 2, rel=1e-5)
        self.assertIn("trilinear", [entry["type"] for entry in self.answer["hosted"]])
        self.assertLess(found[0].std(), 0.1)

    def test_image_of_a_gltf_file(self):
        texels = np.random.default_rng(3).integers(0, 256, (8, 4, 4), dtype=np.uint8)
        mi.Bitmap(texels, mi.Bitmap.PixelFormat.RGBA).write(os.path.join(self.base, "t.png"))
        with open(os.path.join(self.base, "i.gltf"), "w", encoding="utf-8") as file:
            json.dump({"asset": {"version": "2.0"}, "images": [{}, {"uri": "t.png"}]}, file)
        text = '{{ type = "image", file = "i.gltf", image = {}, filter = "nearest"{} }}'
        found = self.seen(mesh(text.format(1, ', color_space = "linear", channel = "green"')))
        self.near(found, np.repeat(texels[:, :, 1:2] / 255, 3, axis=2))
        found = self.seen(mesh(text.format(1, ', channel = "alpha"')))
        self.near(found, np.repeat(texels[:, :, 3:] / 255, 3, axis=2))
        self.refuse(film() + LOOK + mesh(text.format(0, "")), "scene", "/images/0", base=self.base)
        self.refuse(film() + LOOK + mesh(text.format(2, "")), "scene", "/images", base=self.base)
        png = '{ type = "image", file = "t.png", image = 0 }'
        self.refuse(film() + LOOK + mesh(png), "scene", "image", ".glb", base=self.base)
        with open(os.path.join(self.base, "t.webp"), "wb") as file:
            file.write(b"RIFF\x20\0\0\0WEBPVP8L")
        webp = '{ type = "image", file = "t.webp" }'
        self.refuse(film() + LOOK + mesh(webp), "unsupported", "WebP", base=self.base)


if __name__ == "__main__":
    unittest.main()
