"""Textures (model §10), seen on a unit rectangle in ambient light."""

import itertools
import json
import math
import os
import tempfile
import unittest
import unittest.mock

import numpy as np

from support import Case, film, write_exr
from whitstone_mitsuba import quilting
from whitstone_mitsuba.images import srgb_to_linear
from whitstone_mitsuba.runtime import mi

# An orthographic view of the rectangle z = 0, so that raster and uv match: u = x / width, v = 1 - y
# / height.
LOOK = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n'
AMBIENT = '[[light]]\ntype = "ambient"\nradiance = 1\n'


def scene(width, height, texture, window=(-1, 1, -1, 1)):
    view = "window = {{ l = {}, r = {}, b = {}, t = {} }}\n".format(*window)
    plane = f'[[shape]]\ntype = "rectangle"\nmaterial = {{ type = "matte", reflectance = {texture} }}\n'
    return film(width, height) + LOOK + view + AMBIENT + plane


class Textures(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name
        self.texels = np.random.default_rng(5).integers(0, 256, (3, 4, 3), dtype=np.uint8)
        mi.Bitmap(self.texels).write(os.path.join(self.base, "t.png"))
        self.linear = srgb_to_linear(self.texels / 255.0)

    def seen(self, width, height, texture):
        channels, _ = self.render(scene(width, height, texture), self.base)
        return np.stack([channels[letter] for letter in "RGB"], axis=2)

    def test_checker(self):
        found = self.seen(8, 4, '{ type = "checker", a = [1, 0.5, 0], b = 0.25, scale = [8, 4], offset = [3, 0] }')[:, :, 0]
        j, i = np.mgrid[0:4, 0:8]
        even = (i + 3 + (3 - j)) % 2 == 0
        self.near(found, np.where(even, 1, 0.25))

    def test_mappings(self):
        """Cells of a checker by world-space position, on the square from -1 to 1 at z = 0."""
        j, i = np.mgrid[0:8, 0:8]
        x, y = (i + 0.5) / 4 - 1, 1 - (j + 0.5) / 4
        turn = np.arctan2(y, x) / (2 * np.pi) % 1
        for mapping, u, v in (
            ('projection = "planar"', x, y),
            ('projection = "solid", transform = [{ translate = [5, 0, 0] }, { scale = 2 }]', 2 * (x + 5), 2 * y),
            ('projection = "uv", transform = { scale = 3 }', 3 * (x + 1) / 2, 3 * (y + 1) / 2),
            ('projection = "spherical", transform = { translate = [0, 0, 0.7] }', turn, 1 - np.arctan2(np.hypot(x, y), 0.7) / np.pi),
            ('projection = "cylindrical", transform = { translate = [0, 0, 0.7] }', turn, np.full_like(x, 0.7)),
            ('projection = "cube", transform = { translate = [0, 0, 5] }', (x / 5 + 1) / 2, (y / 5 + 1) / 2),
        ):
            found = self.seen(8, 8, f'{{ type = "checker", a = 1, b = 0.25, scale = 3, offset = [0.05, 0.05], mapping = {{ {mapping} }} }}')
            even = (np.floor(3 * u + 0.05) + np.floor(3 * v + 0.05)) % 2 == 0
            self.near(found[:, :, 0], np.where(even, 1, 0.25))
        self.refuse(scene(1, 1, '{ type = "checker", mapping = { projection = "round" } }'), "scene", "mapping.projection")

    def test_triplanar(self):
        """Lines that are visible only in the projection along x, on a plane that is rotated in
        texture space.
        """
        s3 = 3**0.5
        for more, sharpness, scale in (("", 4, 1), (", sharpness = 1", 1, 1), (", sharpness = 2", 2, 2)):
            # Rotated by 60 degrees around y: N is (sin 60, 0, cos 60), then transformed by the
            # inverse transpose of the scale along z.
            steps = f"[{{ rotate = {{ axis = [0, 1, 0], degrees = 60 }} }}, {{ scale = [1, 1, {scale}] }}]"
            text = f'mapping = {{ projection = "triplanar", transform = {steps}{more} }}'
            lines = f'{{ type = "grid_lines", a = 0, b = 1, width = [0.5, 0], {text} }}'
            found = self.seen(8, 8, lines)[:, :, 0]
            j, i = np.mgrid[0:8, 0:8]
            x, y = (i + 0.5) / 4 - 1, 1 - (j + 0.5) / 4
            w_x, w_z = (s3 / 2) ** sharpness, (0.5 / scale) ** sharpness
            # Along x the first coordinate is y, along z it is x, which the rotation has halved.
            on_y, on_x = (np.abs(u - np.round(u)) < 0.25 for u in (y, 0.5 * x))
            self.near(found, (w_x * on_y + w_z * on_x) / (w_x + w_z), rel=1e-5, atol=1e-6)
        self.refuse(scene(1, 1, '{ type = "checker", mapping = { sharpness = 2 } }'), "scene", "mapping.sharpness")

    def test_texel_centres(self):
        for filtering in ("bilinear", "nearest"):
            found = self.seen(4, 3, f'{{ type = "image", file = "t.png", filter = "{filtering}" }}')
            self.near(found, self.linear, rel=1e-5, atol=2e-6)

    def test_linear_space(self):
        found = self.seen(4, 3, '{ type = "image", file = "t.png", color_space = "linear" }')
        self.near(found, self.texels / 255.0, rel=1e-5, atol=2e-6)

    def test_filters_and_wraps(self):
        """Compared with the model's formulas, at positions off texel centres and off the image."""
        maps = {
            "repeat": lambda i, n: i % n,
            "clamp": lambda i, n: np.clip(i, 0, n - 1),
            "mirror": lambda i, n: np.where(i % (2 * n) < n, i % (2 * n), 2 * n - 1 - i % (2 * n)),
        }
        width, height = 13, 11
        u = (np.arange(width) + 0.5) / width * 2.7 - 1.1
        v = (1 - (np.arange(height) + 0.5) / height) * 1.9 - 0.4
        x, y = np.broadcast_arrays(u[None, :] * 4, (1 - v[:, None]) * 3)
        for along_u, along_v in itertools.product(maps, maps):
            wrap = json.dumps([along_u, along_v] if along_u != along_v else along_u)
            text = f'{{ type = "image", file = "t.png", wrap = {wrap}, scale = [2.7, 1.9], offset = [-1.1, -0.4]'
            i, j = np.floor(x).astype(int), np.floor(y).astype(int)
            self.near(self.seen(width, height, text + ', filter = "nearest" }'), self.linear[maps[along_v](j, 3), maps[along_u](i, 4)], rel=1e-5, atol=2e-6)
            i, j = np.floor(x - 0.5).astype(int), np.floor(y - 0.5).astype(int)
            fx, fy = (x - 0.5 - i)[..., None], (y - 0.5 - j)[..., None]
            expected = sum(
                weight_x * weight_y * self.linear[maps[along_v](j + dj, 3), maps[along_u](i + di, 4)]
                for di, weight_x in ((0, 1 - fx), (1, fx))
                for dj, weight_y in ((0, 1 - fy), (1, fy))
            )
            self.near(self.seen(width, height, text + " }"), expected, rel=1e-4, atol=1e-5)

    def test_exr_and_grey(self):
        grey = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
        write_exr(os.path.join(self.base, "g.exr"), {"Y": grey})
        self.near(self.seen(4, 3, '{ type = "image", file = "g.exr" }'), np.repeat(grey[..., None], 3, axis=2), rel=1e-5, atol=1e-6)
        mi.Bitmap(self.texels[:, :, :1]).write(os.path.join(self.base, "g.png"))
        self.near(self.seen(4, 3, '{ type = "image", file = "g.png" }')[:, :, 2], self.linear[:, :, 0], rel=1e-5, atol=2e-6)

    def test_alpha_and_16_bit(self):
        deep = np.random.default_rng(6).integers(0, 65536, (3, 4, 4), dtype=np.uint16)
        mi.Bitmap(deep, mi.Bitmap.PixelFormat.RGBA).write(os.path.join(self.base, "d.png"))
        expected = srgb_to_linear(deep[:, :, :3] / 65535.0)
        self.near(self.seen(4, 3, '{ type = "image", file = "d.png" }'), expected, rel=1e-5, atol=2e-6)

    def grey(self, width, height, texture):
        return self.seen(width, height, texture)[:, :, 0]

    def test_grid_lines(self):
        j, i = np.mgrid[0:16, 0:16]
        u, v = (i + 0.5) / 16, 1 - (j + 0.5) / 16
        for width, wide in (("0.3", (0.3, 0.3)), ("[0, 0.6]", (0, 0.6))):
            text = f'{{ type = "grid_lines", a = 0.9, b = 0.1, width = {width}, scale = [3, 2], offset = [0.1, 0.2] }}'
            # The distance from the nearest integer.
            x, y = 3 * u + 0.1, 2 * v + 0.2
            line = (np.abs(x - np.round(x)) < wide[0] / 2) | (np.abs(y - np.round(y)) < wide[1] / 2)
            self.near(self.grey(16, 16, text), np.where(line, 0.1, 0.9))
        self.refuse(scene(1, 1, '{ type = "grid_lines", width = 2 }'), "scene", "width", "from 0 to 1")

    def test_cells(self):
        """On a wall at z = 0, which lies exactly on a border of the third axis."""
        j, i = np.mgrid[0:16, 0:16]
        x, y = (i + 0.5) / 8 - 1, 1 - (j + 0.5) / 8

        def cell(x):
            return np.floor(x + 1 / 4096)

        def alike(cells):
            return np.where(cells % 2 == 1, 0.2, 0.8)

        self.near(self.grey(16, 16, '{ type = "checker3d" }'), alike(cell(x) + cell(y)))
        found = self.grey(16, 16, '{ type = "checker3d", scale = 3, offset = [0.1, -0.3, 1] }')
        self.near(found, alike(cell(3 * x + 0.1) + cell(3 * y - 0.3) + 1))
        self.near(self.grey(16, 16, '{ type = "stripes", scale = 3, offset = 0.1 }'), alike(cell(3 * x + 0.1)))
        self.near(self.grey(16, 16, '{ type = "rings", scale = 3, offset = 0.1 }'), alike(cell(3 * np.abs(x) + 0.1)))
        turned = "mapping = { transform = { rotate = { axis = [1, 0, 0], degrees = 90 } } }"
        self.near(self.grey(16, 16, f'{{ type = "rings", scale = 3, {turned} }}'), alike(cell(3 * np.hypot(x, y))))
        self.refuse(scene(1, 1, '{ type = "rings", scale = 0 }'), "scene", "scale", "> 0")

    def test_gradient(self):
        j, i = np.mgrid[0:16, 0:16]
        x = 1.5 * ((i + 0.5) / 8 - 1) + 0.3
        ramp = 'type = "gradient", a = 0, b = 1, scale = 1.5, offset = 0.3'
        self.near(self.grey(16, 16, f"{{ {ramp} }}"), x % 1, rel=1e-5, atol=1e-6)
        self.near(self.grey(16, 16, f'{{ {ramp}, wrap = "clamp" }}'), np.clip(x, 0, 1), rel=1e-5, atol=1e-6)
        self.near(self.grey(16, 16, f'{{ {ramp}, wrap = "mirror" }}'), np.arccos(np.cos(np.pi * x)) / np.pi, rel=1e-5, atol=1e-6)
        # A wall at x = 1 exactly shows the start of the ramp, not its end or a mixture of both.
        wall = 'type = "gradient", mapping = { transform = [{ scale = [0, 1, 0.5] }, { translate = [1, 0, 0] }] }'
        self.refuse(scene(1, 1, f"{{ {wall} }}"), "scene", "invertible")
        wall = 'type = "gradient", mapping = { transform = [{ rotate = { axis = [0, 1, 0], degrees = 90 } }, { translate = [1, 0, 0] }] }'
        self.near(self.grey(16, 16, f"{{ {wall} }}"), np.full((16, 16), 0.8), rel=1e-6)
        stops = "stops = [{ at = 0.25, color = 0.5 }, { at = 0.5, color = 1 }, { at = 1, color = 0 }]"
        t = (x - 0.3) / 1.5 % 1
        expected = np.where(t < 0.25, 0.5, np.where(t < 0.5, 2 * t, 2 - 2 * t))
        self.near(self.grey(16, 16, f'{{ type = "gradient", {stops} }}'), expected, rel=1e-5, atol=1e-6)
        for text, *words in (
            ('a = 0, stops = [{ at = 0, color = 0 }, { at = 1, color = 1 }]', ".a", "stops"),
            ("stops = [{ at = 0, color = 0 }]", "stops", "2 to 64"),
            ("stops = [{ at = 0.5, color = 0 }, { at = 0.5, color = 1 }]", "stops", "ascending"),
            ("stops = [{ at = 0, color = 0 }, { at = 2, color = 1 }]", "stops[1].at"),
        ):
            self.refuse(scene(1, 1, f'{{ type = "gradient", {text} }}'), "scene", *words)

    def test_noise(self):
        """The known value of Perlin's program, noise at integers, and kinds that are special cases
        of each other.
        """
        known = '{ type = "noise", a = 0, b = 1, mapping = { transform = { translate = [3.14, 42, 7] } } }'
        self.near(self.grey(1, 1, known), np.full((1, 1), 0.5 + 0.5 * 0.13691995878400012), rel=1e-6)
        j, i = np.mgrid[0:8, 0:8]
        # Pixel centres at odd numbers: noise is 0 there, in all octaves.
        whole, x, y = "mapping = { transform = { scale = 8 } }", 2 * i - 7, 7 - 2 * j
        ring = 0.5 + 0.5 * np.sin(2 * np.pi * np.hypot(x, y))
        for kind, more, expected in (
            ("perlin", "", np.full((8, 8), 0.5)),
            ("fbm", "seed = 7,", np.full((8, 8), 0.5)),
            ("turbulence", "seed = 7,", np.zeros((8, 8))),
            ("marble", "distortion = 3,", np.full((8, 8), 0.5)),
            ("wood", "distortion = 3,", ring),
        ):
            self.near(self.grey(8, 8, f'{{ type = "noise", kind = "{kind}", {more} a = 0, b = 1, {whole} }}'), expected, atol=2e-5)
        one = self.grey(8, 8, '{ type = "noise", a = 0, b = 1, scale = 3, seed = 5 }')
        self.assertGreater(one.std(), 0.05)
        alike = self.grey(8, 8, '{ type = "noise", kind = "fbm", a = 0, b = 1, scale = 3, seed = 5, lacunarity = 1, gain = 0.7 }')
        self.near(alike, one)
        absolute = self.grey(8, 8, '{ type = "noise", kind = "turbulence", a = 0, b = 1, scale = 3, seed = 5, octaves = 1 }')
        self.near(absolute, np.abs(2 * one - 1), atol=1e-6)
        self.refuse(scene(1, 1, '{ type = "noise", octaves = 2 }'), "scene", "octaves")
        self.refuse(scene(1, 1, '{ type = "noise", kind = "fbm", lacunarity = 1e50 }'), "scene", "1e100")

    def test_worley(self):
        """Compared with integers of arbitrary size, point by point, over more cells than needed."""

        def m(x):
            x = (x ^ x >> 16) * 0x7FEB352D % 2**32
            x = (x ^ x >> 15) * 0x846CA68B % 2**32
            return x ^ x >> 16

        def distances(p, seed):
            found = []
            for cell in itertools.product(*(range(math.floor(x) - 3, math.floor(x) + 4) for x in p)):
                h = m((m((m((m(seed) + cell[2]) % 2**32) + cell[1]) % 2**32) + cell[0]) % 2**32)
                found.append(math.dist(p, [cell[k] + m((h + k + 1) % 2**32) / 2**32 for k in range(3)]))
            return sorted(found)[:2]

        size = 6
        near = [[distances((4 * ((i + 0.5) / 3 - 1), 4 * (1 - (j + 0.5) / 3), 0.5), 9) for i in range(size)] for j in range(size)]
        f1, f2 = np.moveaxis(np.array(near), 2, 0)
        place = "mapping = { transform = [{ scale = 2 }, { translate = [0, 0, 0.25] }] }"
        for value, expected in (("f1", f1), ("f2", f2), ("f2_minus_f1", f2 - f1)):
            found = self.grey(size, size, f'{{ type = "worley", value = "{value}", a = 0, b = 1, scale = 2, seed = 9, {place} }}')
            self.near(found, np.minimum(expected, 1), rel=1e-5, atol=2e-6)

    def test_solid(self):
        numbers = [0, 0.1, 0.2, 0.3, 0.4, 0.5]
        block = f'type = "solid", size = [2, 3, 1], values = {numbers}'
        # The square becomes the face z = 0 of the unit cube.
        unit = "mapping = { transform = [{ translate = [1, 1, 0] }, { scale = 0.5 }] }"
        grid = np.array(numbers).reshape(3, 2)[::-1]
        for filtering in ("nearest", "trilinear"):
            self.near(self.grey(2, 3, f'{{ {block}, filter = "{filtering}", {unit} }}'), grid, atol=1e-6)
        # Linear functions are interpolated exactly.
        j, i = np.mgrid[0:9, 0:9]
        x, y = np.clip(2 * (i + 0.5) / 9 - 0.5, 0, 1), np.clip(3 * (1 - (j + 0.5) / 9) - 0.5, 0, 2)
        self.near(self.grey(9, 9, f'{{ {block}, wrap = "clamp", {unit} }}'), 0.1 * x + 0.2 * y, rel=1e-5, atol=1e-6)
        third = "mapping = { transform = [{ translate = [0, 0, 1.75] }] }"
        layers = 'type = "solid", size = [1, 1, 2], values = [0.2, 0.6], filter = "nearest"'
        for wrap, expected in (("repeat", 0.6), ("clamp", 0.6), ("mirror", 0.2)):
            self.near(self.value(scene(1, 1, f'{{ {layers}, wrap = "{wrap}", {third} }}')), [expected] * 3)
        np.array([0, 51, 255], dtype=np.uint8).tofile(os.path.join(self.base, "bytes"))
        np.array([0.5, 0.25, 0.125], dtype="<f4").tofile(os.path.join(self.base, "floats"))
        for more, expected in (('channels = 3, file = "bytes"', [0, 0.2, 1]), ('channels = 3, file = "floats", format = "f32"', [0.5, 0.25, 0.125])):
            self.near(self.value(scene(1, 1, f'{{ type = "solid", size = [1, 1, 1], {more} }}'), base=self.base), expected, atol=1e-7)
        for bad in (", values = [1]", ', file = "bytes"', ', file = "none"', ""):
            self.refuse(scene(1, 1, f'{{ type = "solid", size = [2, 1, 1]{bad} }}'), "scene", "expected", base=self.base)

    def test_seams(self):
        """The result is the cheapest of all paths."""
        random = np.random.default_rng(3)
        for _ in range(20):
            d = random.integers(0, 9, (5, 3))
            paths = [p for p in itertools.product(range(3), repeat=5) if all(abs(a - b) <= 1 for a, b in zip(p, p[1:]))]
            cost = min(sum(d[k, p[k]] for k in range(5)) for p in paths)
            found = quilting._seam(d)
            self.assertIn(tuple(found), paths)
            self.assertEqual(sum(d[k, found[k]] for k in range(5)), cost)

    def test_synthesized(self):
        """A sample no larger than a block is repeated, with seams where it differs least; the
        result for a larger sample consists of pieces of it.
        """
        sample = np.random.default_rng(8).integers(0, 256, (4, 4, 3), dtype=np.uint8)
        mi.Bitmap(sample).write(os.path.join(self.base, "s.png"))
        text = '{{ type = "synthesized", file = "{}", size = [{}, {}], block = 4, overlap = {}, filter = "nearest"{} }}'
        found = self.seen(4, 4, text.format("s.png", 4, 4, 1, ""))
        self.near(found, srgb_to_linear(sample / 255.0), rel=1e-5, atol=2e-6)
        # With an overlap of 1, the seam is that column: all of each new block.
        twice = np.concatenate([sample[:, :3], sample], axis=1)
        found = self.seen(7, 4, text.format("s.png", 7, 4, 1, ', color_space = "linear"'))
        self.near(found, twice / 255.0, rel=1e-5, atol=2e-6)
        more = np.random.default_rng(9).integers(0, 256, (9, 11, 3), dtype=np.uint8)
        mi.Bitmap(more).write(os.path.join(self.base, "m.png"))
        one, other = (self.seen(20, 15, text.format("m.png", 20, 15, 2, f', color_space = "linear", seed = {seed}')) for seed in (0, 1))
        self.assertGreater(np.abs(one - other).max(), 0.1)
        known = {tuple(texel) for texel in more.reshape(-1, 3)}
        self.assertTrue(all(tuple(texel) in known for texel in np.rint(one * 255).astype(int).reshape(-1, 3)))
        for bad in ((20, 15, 3, ""), (0, 1, 1, ""), (4, 4, 1, ", seed = -1")):
            self.refuse(scene(1, 1, text.format("m.png", *bad)), "scene", "expected", base=self.base)

    def test_alpha(self):
        """Alpha is never decoded, and colours are not multiplied by it."""
        random = np.random.default_rng(11)
        eight = random.integers(0, 256, (3, 4, 4), dtype=np.uint8)
        mi.Bitmap(eight).write(os.path.join(self.base, "8.png"))
        mi.Bitmap(eight[:, :, 2:], mi.Bitmap.PixelFormat.YA).write(os.path.join(self.base, "grey.png"))
        sixteen = random.integers(0, 65536, (3, 4, 4), dtype=np.uint16)
        mi.Bitmap(sixteen).write(os.path.join(self.base, "16.png"))
        floats = {name: random.random((3, 4), dtype=np.float32) for name in "ARGB"}
        write_exr(os.path.join(self.base, "f.exr"), floats)
        text = '{{ type = "image", file = "{}", filter = "nearest", channel = "{}" }}'
        for name, alpha in (("8.png", eight[:, :, 3] / 255), ("grey.png", eight[:, :, 3] / 255), ("16.png", sixteen[:, :, 3] / 65535), ("f.exr", floats["A"])):
            found = self.seen(4, 3, text.format(name, "alpha"))
            self.near(found, np.repeat(alpha[:, :, None], 3, axis=2), rel=1e-5, atol=2e-6)
        self.near(self.seen(4, 3, text.format("8.png", "color")), srgb_to_linear(eight[:, :, :3] / 255), rel=1e-5, atol=2e-6)
        self.refuse(scene(1, 1, text.format("t.png", "alpha")), "scene", "expected a channel A", base=self.base)
        self.refuse(scene(1, 1, text.format("8.png", 'alpha", color_space = "linear')), "scene", "color_space", base=self.base)

    def test_synthesized_and_optimized(self):
        """One iteration by the model's definition, with integers and loops."""
        random = np.random.default_rng(10)
        once = random.integers(0, 256, (7, 8, 3))
        # Each piece of this sample occurs four times.
        four_times = np.tile(random.integers(0, 256, (4, 4, 3)), (3, 3, 1))
        for sample in (once, four_times):
            picture = random.integers(0, 256, (11, 9, 3))
            found = [[[] for _ in range(9)] for _ in range(11)]
            pieces = [sample[y : y + 5, x : x + 5] for y in range(len(sample) - 4) for x in range(sample.shape[1] - 4)]
            for y in (0, 1, 2, 3, 4, 5, 6):
                for x in (0, 1, 2, 3, 4):
                    errors = [((piece - picture[y : y + 5, x : x + 5]) ** 2).sum() for piece in pieces]
                    for j, i in itertools.product(range(5), range(5)):
                        found[y + j][x + i].append(pieces[errors.index(min(errors))][j, i])
            means = np.array([[(2 * sum(texels) + len(texels)) // (2 * len(texels)) for texels in row] for row in found])
            np.testing.assert_array_equal(quilting.optimized(picture, sample, 5, 1), means)
            np.testing.assert_array_equal(quilting.optimized(picture, sample, 5, 0), picture)
            # Pieces in small tables, one row of them at a time.
            with unittest.mock.patch.object(quilting, "MOST_NUMBERS", 1):
                np.testing.assert_array_equal(quilting.optimized(picture, sample, 5, 1), means)
        # All pieces have equal distances: the first one wins, along both axes and from table to
        # table.
        halves = np.repeat([126, 130], (5, 6)).repeat(3).reshape(1, 11, 3).repeat(9, axis=0)
        for sample, numbers in itertools.product((halves, halves.transpose(1, 0, 2)), (1, 1 << 23)):
            with unittest.mock.patch.object(quilting, "MOST_NUMBERS", numbers):
                self.assertTrue(np.all(quilting.optimized(np.full((7, 6, 3), 128), sample, 5, 1) == 126))
        for length, starts in ((13, [0, 2, 4, 5]), (12, [0, 2, 4]), (8, [0])):
            with unittest.mock.patch.object(quilting, "_nearest", return_value=([0] * len(starts),) * 2) as asked:
                quilting.optimized(np.zeros((8, length, 3), dtype=np.int64), np.zeros((8, 8, 3), dtype=np.int64), 8, 1)
            self.assertEqual(len(asked.call_args.args[0]), len(starts))
        mi.Bitmap(sample.astype(np.uint8)).write(os.path.join(self.base, "o.png"))
        text = '{{ type = "synthesized", file = "o.png", size = [9, 9], block = 4, optimize = {} }}'
        several = ("[]", "[4, 10]", "[3]", "4", "[4], resolutions = 3", "[4], resolutions = 9")
        for bad in ("{ neighborhood = 10 }", "{ neighborhood = 3 }", "{}", "{ neighborhood = 4, iterations = 65 }", "1", *(f"{{ neighborhoods = {more} }}" for more in several)):
            self.refuse(scene(1, 1, text.format(bad)), "scene", "expected", base=self.base)

    def test_robust_weights(self):
        """The weights are the greatest integers of the model, and badly matching pieces count less."""
        for error in (0, 1, 2, 31, 32, 33, 99_999, 100_000, 3 * 255**2 * 256**2):
            weight, exact = quilting._weight(error), error**0.6
            self.assertTrue(2**32 / max(1, exact) - 1 <= weight <= 2**32 / max(1, exact - 1), error)
        self.assertEqual([quilting._weight(e) for e in (0, 31, 32)], [2**32, 2**32 // 7, 2**29])
        # Three neighbourhoods in a row: two columns of the first and the second do not match, and
        # one of the third. In the third column, the piece of the first is 100, of the others 0.
        sample, picture = (np.array(row)[None, :, None].repeat(5, axis=0).repeat(3, axis=2) for row in ([0] * 5 + [100] * 5, [100, 100, 100, 0, 0, 100, 100]))
        two, one = (quilting._weight(5 * 3 * columns * 100**2) for columns in (2, 1))
        expected = (2 * 100 * two + 2 * two + one) // (2 * (2 * two + one))
        self.assertTrue(np.all(quilting.optimized(picture, sample, 5, 1, True)[:, 2] == expected))
        self.assertTrue(np.all(quilting.optimized(picture, sample, 5, 1, False)[:, 2] == 33))
        self.assertEqual(expected, 28)

    def test_resolutions(self):
        """Halves and doubles by the model's definition, and the order of the stages."""
        random = np.random.default_rng(12)
        fine = random.integers(0, 256, (7, 9, 3))
        half = quilting._halved(fine)
        self.assertEqual(half.shape, (3, 4, 3))
        for j, i in itertools.product(range(3), range(4)):
            s = fine[2 * j : 2 * j + 2, 2 * i : 2 * i + 2].sum(axis=(0, 1))
            np.testing.assert_array_equal(half[j, i], (s + 2) // 4)
        done = []

        def record(picture: np.ndarray, sample: np.ndarray, side: int, iterations: int, robust: bool) -> np.ndarray:
            done.append((picture.shape[:2], sample.shape[:2], side, iterations, robust))
            return picture

        with unittest.mock.patch.object(quilting, "optimized", record):
            found = quilting.at_all_resolutions(fine, random.integers(0, 256, (12, 13, 3)), (7, 4, 3), 2, 5, True)
        # 7 is greater than the image at the coarser resolution, and so is 4.
        self.assertEqual(done, [((3, 4), (6, 6), 3, 5, True)] + [((7, 9), (12, 13), side, 5, True) for side in (7, 4, 3)])
        for j, i in itertools.product(range(7), range(9)):
            np.testing.assert_array_equal(found[j, i], half[min(j // 2, 2), min(i // 2, 3)])

    def test_names_without_an_extension(self):
        for name, other in (("t.png", "t"), ("v.exr", "e.png")):
            if name == "v.exr":
                write_exr(os.path.join(self.base, name), {"Y": np.full((2, 2), 0.5, dtype=np.float32)})
            with open(os.path.join(self.base, name), "rb") as source, open(os.path.join(self.base, other), "wb") as copy:
                copy.write(source.read())
            found, expected = (self.seen(4, 3, f'{{ type = "image", file = "{file}" }}') for file in (other, name))
            self.near(found, expected)
        with open(os.path.join(self.base, "text.png"), "wb") as file:
            file.write(b"text")
        self.refuse(scene(1, 1, '{ type = "image", file = "text.png" }'), "scene", "expected a PNG", base=self.base)

    def test_shared_and_range(self):
        shared = '[texture.t]\ntype = "constant"\nvalue = [0.1, 0.2, 0.3]\n'
        self.near(self.value(scene(1, 1, '"t"') + shared), [0.1, 0.2, 0.3])
        self.refuse(scene(1, 1, '"u"') + shared, "scene", "'u'", "known: t")
        write_exr(os.path.join(self.base, "bright.exr"), {"Y": np.full((2, 2), 3, dtype=np.float32)})
        # The model leaves the upper bound of varying textures open. It bounds colours on both sides
        # and varying textures from below.
        self.value(scene(1, 1, '{ type = "image", file = "bright.exr" }'), base=self.base)
        self.value(scene(1, 1, '{ type = "checker", a = 2 }'))
        self.refuse(scene(1, 1, '{ type = "constant", value = 2 }'), "scene", "from 0 to 1")
        self.refuse(scene(1, 1, '{ type = "checker", a = -1 }'), "scene", "found -1")
        self.refuse(scene(1, 1, '{ type = "image", file = "none.png" }'), "scene", "no such file", base=self.base)


if __name__ == "__main__":
    unittest.main()
