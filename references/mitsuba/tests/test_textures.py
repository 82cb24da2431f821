"""Textures (model §10), read off a unit rectangle lit by ambient light."""

import os
import tempfile
import unittest

import numpy as np
from support import Case, film

from whitstone_mitsuba import exr
from whitstone_mitsuba.images import srgb_to_linear
from whitstone_mitsuba.runtime import mi

# An orthographic view of the rectangle z = 0, so that raster and uv match: u = x / width, v = 1 - y / height.
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
        """Cells of a checker by the place in the world, on the square from -1 to 1 at z = 0."""
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

    def test_texel_centres(self):
        for filtering in ("bilinear", "nearest"):
            found = self.seen(4, 3, f'{{ type = "image", file = "t.png", filter = "{filtering}" }}')
            self.near(found, self.linear, rel=1e-5, atol=2e-6)

    def test_linear_space(self):
        found = self.seen(4, 3, '{ type = "image", file = "t.png", color_space = "linear" }')
        self.near(found, self.texels / 255.0, rel=1e-5, atol=2e-6)

    def test_filters_and_wraps(self):
        """Against the model's formulas, at positions off the centres and off the image."""
        maps = {
            "repeat": lambda i, n: i % n,
            "clamp": lambda i, n: np.clip(i, 0, n - 1),
            "mirror": lambda i, n: np.where(i % (2 * n) < n, i % (2 * n), 2 * n - 1 - i % (2 * n)),
        }
        width, height = 13, 11
        u = (np.arange(width) + 0.5) / width * 2.7 - 1.1
        v = (1 - (np.arange(height) + 0.5) / height) * 1.9 - 0.4
        x, y = np.broadcast_arrays(u[None, :] * 4, (1 - v[:, None]) * 3)
        for wrap, fold in maps.items():
            text = f'{{ type = "image", file = "t.png", wrap = "{wrap}", scale = [2.7, 1.9], offset = [-1.1, -0.4]'
            i, j = np.floor(x).astype(int), np.floor(y).astype(int)
            self.near(self.seen(width, height, text + ', filter = "nearest" }'), self.linear[fold(j, 3), fold(i, 4)], rel=1e-5, atol=2e-6)
            i, j = np.floor(x - 0.5).astype(int), np.floor(y - 0.5).astype(int)
            fx, fy = (x - 0.5 - i)[..., None], (y - 0.5 - j)[..., None]
            expected = sum(
                weight_x * weight_y * self.linear[fold(j + dj, 3), fold(i + di, 4)]
                for di, weight_x in ((0, 1 - fx), (1, fx))
                for dj, weight_y in ((0, 1 - fy), (1, fy))
            )
            self.near(self.seen(width, height, text + " }"), expected, rel=1e-4, atol=1e-5)

    def test_exr_and_grey(self):
        grey = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
        exr.write(os.path.join(self.base, "g.exr"), {"Y": grey})
        self.near(self.seen(4, 3, '{ type = "image", file = "g.exr" }'), np.repeat(grey[..., None], 3, axis=2), rel=1e-5, atol=1e-6)
        mi.Bitmap(self.texels[:, :, :1]).write(os.path.join(self.base, "g.png"))
        self.near(self.seen(4, 3, '{ type = "image", file = "g.png" }')[:, :, 2], self.linear[:, :, 0], rel=1e-5, atol=2e-6)

    def test_alpha_and_16_bit(self):
        deep = np.random.default_rng(6).integers(0, 65536, (3, 4, 4), dtype=np.uint16)
        mi.Bitmap(deep, mi.Bitmap.PixelFormat.RGBA).write(os.path.join(self.base, "d.png"))
        expected = srgb_to_linear(deep[:, :, :3] / 65535.0)
        self.near(self.seen(4, 3, '{ type = "image", file = "d.png" }'), expected, rel=1e-5, atol=2e-6)

    def test_shared_and_range(self):
        shared = '[texture.t]\ntype = "constant"\nvalue = [0.1, 0.2, 0.3]\n'
        self.near(self.value(scene(1, 1, '"t"') + shared), [0.1, 0.2, 0.3])
        self.refuse(scene(1, 1, '"u"') + shared, "scene", "'u'", "known: t")
        exr.write(os.path.join(self.base, "bright.exr"), {"Y": np.full((2, 2), 3, dtype=np.float32)})
        # The model leaves the upper end of textures that vary open; of colours it does not, nor the lower end.
        self.value(scene(1, 1, '{ type = "image", file = "bright.exr" }'), base=self.base)
        self.value(scene(1, 1, '{ type = "checker", a = 2 }'))
        self.refuse(scene(1, 1, '{ type = "constant", value = 2 }'), "scene", "from 0 to 1")
        self.refuse(scene(1, 1, '{ type = "checker", a = -1 }'), "scene", "found -1")
        self.refuse(scene(1, 1, '{ type = "image", file = "none.png" }'), "scene", "no such file", base=self.base)


if __name__ == "__main__":
    unittest.main()
