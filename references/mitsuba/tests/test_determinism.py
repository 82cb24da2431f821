"""The same bytes for any run, thread count and chunking; `probe` and `tree` agree with `render`.
"""

import os
import tempfile
import unittest
from unittest import mock

import numpy as np
from support import Case, film

from whitstone_mitsuba import driver, operations

SCENE = """
[camera]
type = "perspective"
look_at = { origin = [0, 2, 6], target = [0, 1, 0] }
[sampler]
type = "grid"
samples_per_axis = 2
[[light]]
type = "point"
position = [3, 5, 4]
intensity = [60, 50, 40]
[[light]]
type = "background"
radiance = [0.1, 0.2, 0.4]
[[shape]]
type = "plane"
transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }
material = { type = "whitted", k_d = { type = "checker" }, k_refl = 0.3 }
[[shape]]
type = "sphere"
center = [-1.2, 1, 0]
material = { type = "mirror", reflectance = 0.9 }
[[shape]]
type = "sphere"
center = [1.2, 1, 0]
material = { type = "dielectric", absorption = [0.3, 0.1, 0] }
[[shape]]
type = "box"
transform = [{ scale = 0.4 }, { rotate = { axis = [1, 1, 0], degrees = 30 } }, { translate = [0, 0.6, 2] }]
material = { type = "phong", k_s = 0.2 }
"""


class Determinism(Case):
    def file(self, **more):
        operations._scenes.__init__(8)
        operations._documents.__init__(8)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "out.exr")
            answer = self.ask("render", film(64, 48) + SCENE, out=path, **more)
            with open(path, "rb") as file:
                return file.read(), answer

    def test_runs_and_threads(self):
        first, answer = self.file(threads=1)
        self.assertEqual(first, self.file(threads=2)[0])
        self.assertEqual(first, self.file(threads=1)[0])
        self.assertEqual(answer["rehits"], 0)
        self.assertEqual(answer["samples"], 4)
        self.assertEqual(answer["twin"], "formula")

    def test_chunks(self):
        whole, answer = self.file()
        with mock.patch.object(driver, "LANES", 1000):
            parts, again = self.file()
        self.assertEqual(whole, parts)
        self.assertEqual(answer["rays"], again["rays"])
        with mock.patch.object(driver, "RECORDS", 3000):
            retried, again = self.file()
        self.assertEqual(whole, retried)
        self.assertEqual(answer["rays"], again["rays"])

    def test_probe_is_render(self):
        scene = film(64, 48) + SCENE
        settings = [{}, {"dx": 1e-3, "dy": -2e-3}, {"k": 16}, {"robust": False}, {"ulps": 4, "seed": 7}, {"ulps": 1, "seed": 2, "largest": True}, {"vertices": True, "seed": 3}]
        generator = np.random.default_rng(1)
        pixels = [[int(generator.integers(64)), int(generator.integers(48))] for _ in range(40)]
        values = np.array(self.ask("probe", scene, pixels=pixels, settings=settings)["values"])
        self.assertEqual(values.shape, (7, 40, 3))
        for setting, found in zip(settings, values):
            channels, _ = self.render(scene, setting=setting)
            expected = np.array([[channels[letter][y, x] for letter in "RGB"] for x, y in pixels])
            np.testing.assert_array_equal(found.astype(np.float32), expected)
            # A probe of a single pixel gives the same value.
            self.assertEqual(self.value(scene, *pixels[3], **setting).tolist(), found[3].tolist())
        self.assertFalse((values[0] == values[4]).all())
        self.assertLess(np.median(np.abs(values[0] - values[4])), 1e-5 * values[0].mean())

    def test_largest_moves_small_components(self):
        """A ray along z has components 0, which multiplication by a factor does not change."""
        scene = film(1, 1) + '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 0], target = [0, 0, 1000] }\n'
        wall = '[[shape]]\ntype = "rectangle"\ntransform = { translate = [0, 0, 1000] }\n'
        found = []
        for largest in (False, True):
            setting = {"ulps": 1, "seed": 3, "largest": largest}
            node = self.ask("tree", scene + wall, pixel=[0, 0], setting=setting)["nodes"][0]
            found.append(max(abs(value) for value in node["p"][:2]))
        self.assertLess(found[0], 1e-30)
        self.assertGreater(found[1], 1e-6)
        self.assertLess(found[1], 1000 * 2.0**-23)

    def test_flat_shapes_do_not_shadow_themselves(self):
        """Mitsuba leaves the hits of a disk off its surface; the driver projects them onto it."""
        camera = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 2, 6], target = [0, 1, 0] }\n'
        sun = '[[light]]\ntype = "directional"\ndirection = [1, -2, -1]\nirradiance = 2\n'
        steps = "transform = [{ scale = 0.8 }, { rotate = { axis = [1, 2, 3], degrees = 20 } }, { translate = [0, 1, 0.2] }]\n"
        for kind in ("disk", "plane", "rectangle", "box", "sphere"):
            _, answer = self.render(film(96, 96) + camera + sun + f'[[shape]]\ntype = "{kind}"\n' + steps)
            self.assertGreater(answer["rays"]["shadow"], 100, kind)
            self.assertEqual(answer["rehits"], 0, kind)

    def test_tree_is_probe(self):
        scene = film(64, 48) + SCENE
        for x, y in ((40, 20), (20, 20), (32, 40)):
            total = np.zeros(3)
            for sample in range(4):
                nodes = self.ask("tree", scene, pixel=[x, y], sample=sample)["nodes"]
                total += sum(np.array(node["throughput"]) * np.array(node["local"]) for node in nodes)
            self.near(self.value(scene, x, y), total / 4, rel=5e-6)


if __name__ == "__main__":
    unittest.main()
