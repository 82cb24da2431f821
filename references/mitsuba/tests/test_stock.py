"""Images by Mitsuba's own integrators."""

import os
import tempfile
import unittest

import numpy as np
from support import Case, film
from test_check import BALLS, FLOOR, LAMPS, LOOK, SKY

from whitstone_mitsuba import operations
from whitstone_mitsuba.runtime import mi


class Stock(Case):
    def images(self, scene, repeats=16):
        """The answer, and (height, width, 3) of the mean, of the variance, and of the driver's own
        image.
        """
        with tempfile.TemporaryDirectory() as folder:
            out, own = os.path.join(folder, "stock.exr"), os.path.join(folder, "own.exr")
            answer = self.ask("stock", scene, out=out, repeats=repeats)
            self.ask("render", scene, out=own)
            channels = dict(mi.Bitmap(out).split())
            mean, variance = (np.array(channels[name].convert(mi.Bitmap.PixelFormat.RGB)) for name in ("<root>", "variance"))
            return answer, mean, variance, np.array(mi.Bitmap(own))[:, :, :3]

    def scene(self, material, lights, more=""):
        return film(96, 64) + more + LOOK + lights + (FLOOR + BALLS).replace("MATERIAL", material)

    def refused(self, scene, *words):
        answer = operations.answer({"op": "stock", "scene": scene, "base": ".", "out": "none.exr"})
        self.assertEqual((answer["ok"], answer.get("kind")), (False, "unsupported"), answer)
        for word in words:
            self.assertIn(word, answer["error"])

    def test_direct_shows_lights_and_the_background(self):
        scene = self.scene('type = "matte", reflectance = [0.9, 0.5, 0.1]', LAMPS + SKY)
        answer, mean, variance, own = self.images(scene)
        self.assertEqual((answer["integrator"], answer["repeats"]), ("direct", 2))
        self.assertEqual(variance.max(), 0)
        self.assertTrue((mean[0] == (1, 2, 4)).all(), mean[0])
        apart = (np.abs(mean - own) > 1e-3 * (own + own.mean())).any(axis=2)
        # Shadow edges and terminators, where the spawn offsets differ.
        self.assertLess(apart.mean(), 0.0025)
        self.assertGreater((mean > 0).all(axis=2).mean(), 0.5)

    def test_path_follows_one_branch_at_random(self):
        more = '[integrator]\ntype = "whitted"\nat_max_depth = "black"\nmax_depth = 10\n'
        mirror = (FLOOR).replace("MATERIAL", 'type = "mirror", reflectance = 0.5')
        glass = BALLS.replace("MATERIAL", 'type = "dielectric"')
        answer, mean, variance, own = self.images(film(96, 64) + more + LOOK + SKY + mirror + glass, 64)
        self.assertEqual(answer["integrator"], "path")
        self.assertGreater(variance.max(), 0)

        def blocks(image):
            return image.reshape(8, 8, 12, 8, 3).mean(axis=(1, 3))

        # Of blocks of 64 pixels: in one, a rare event may have been missed, and its variance with
        # it.
        error = np.sqrt(blocks(variance) / 64 / 64)
        self.assertLess((np.abs(blocks(mean - own)) / (error + 1e-3 * own.mean())).max(), 5)
        self.assertAlmostEqual(mean.mean() / own.mean(), 1, delta=3e-3)

    def test_what_they_cannot_render_is_refused(self):
        self.refused(self.scene('type = "matte"', '[[light]]\ntype = "ambient"\nradiance = 1\n'), "ambient")
        self.refused(self.scene('type = "mirror"', SKY), "bounce")
        self.refused(self.scene('type = "whitted", k_d = 0.5, k_refl = 0.1', LAMPS), "direct follows no reflections")
        checker = 'type = "matte", reflectance = { type = "checker" }'
        self.refused(self.scene(checker, LAMPS), "texture coordinates on a plane")
        noise = 'type = "matte", reflectance = { type = "noise" }'
        self.refused(self.scene(noise, LAMPS), "Python")
        torus = LOOK + LAMPS + '[[shape]]\ntype = "torus"\nmaterial = { type = "matte" }\n'
        self.refused(film(8, 8) + torus, "intersects by itself")


if __name__ == "__main__":
    unittest.main()
