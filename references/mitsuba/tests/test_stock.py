"""Images by Mitsuba's own integrators."""

import os
import tempfile
import unittest

import numpy as np

from support import Case, film
from test_check import BALLS, FLOOR, LAMPS, LOOK, SKY
from whitstone_mitsuba import operations
from whitstone_mitsuba.runtime import mi

DEEP = '[integrator]\ntype = "whitted"\nat_max_depth = "black"\nmax_depth = 10\n'
GREEN = (1.2, 0.1, 0.9)


def absorbing(factor=1.0, outside=GREEN):
    """A mirror, balls of green glass, and a bubble in one of them."""
    inside, outside = ([factor * value for value in color] for color in (GREEN, outside))
    glass = f'type = "dielectric", absorption = {inside}'
    bubble = f'type = "dielectric", interior_ior = 1, exterior_ior = 1.5, exterior_absorption = {outside}'
    shapes = FLOOR.replace("MATERIAL", 'type = "mirror", reflectance = 0.5') + BALLS.replace("MATERIAL", glass)
    inner = f'[[shape]]\ntype = "sphere"\ncenter = [0, 1, 0]\nradius = 0.5\nmaterial = {{ {bubble} }}\n'
    box = f'[[shape]]\ntype = "box"\ntransform = [{{ scale = 0.4 }}, {{ translate = [1, 0.5, 1.5] }}]\nmaterial = {{ {glass} }}\n'
    return film(96, 64) + DEEP + LOOK + SKY + shapes + inner + box


def bias(mean, variance, repeats, own):
    """The relative difference of the means of all values, and the largest one that the harness
    accepts.
    """
    # The channels of a path are lit and absorbed together: their errors add up.
    error = np.sqrt((np.sqrt(variance.astype(np.float64) / repeats).sum(axis=2) ** 2).sum())
    mean, own = mean.astype(np.float64), own.astype(np.float64)
    return (own.sum() - mean.sum()) / mean.sum(), 1e-3 + 1.96 * error / mean.sum()


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
        mirror = (FLOOR).replace("MATERIAL", 'type = "mirror", reflectance = 0.5')
        glass = BALLS.replace("MATERIAL", 'type = "dielectric"')
        answer, mean, variance, own = self.images(film(96, 64) + DEEP + LOOK + SKY + mirror + glass, 64)
        self.assertEqual(answer["integrator"], "path")
        self.assertGreater(variance.max(), 0)

        def blocks(image):
            return image.reshape(8, 8, 12, 8, 3).mean(axis=(1, 3))

        # Of blocks of 64 pixels: in one, a rare event may have been missed, and its variance with
        # it.
        error = np.sqrt(blocks(variance) / 64 / 64)
        self.assertLess((np.abs(blocks(mean - own)) / (error + 1e-3 * own.mean())).max(), 5)
        self.assertAlmostEqual(mean.mean() / own.mean(), 1, delta=3e-3)

    def test_volpathmis_absorbs(self):
        answer, mean, variance, own = self.images(absorbing(), 64)
        self.assertEqual((answer["integrator"], answer["repeats"]), ("volpathmis", 64 * 16))
        self.assertEqual((answer["twin"], answer["hosted"]), ("native", []))
        found, limit = bias(mean, variance, answer["repeats"], own)
        self.assertLess(abs(found), limit)
        # Tight enough for the faults below.
        self.assertLess(limit, 2e-3)
        error = np.sqrt(np.maximum(variance / answer["repeats"], (1e-3 * own) ** 2))
        self.assertLess((np.abs(mean - own) > 6 * error).any(axis=2).mean(), 0.0025)
        # The bias of an absorption that is wrong by 3 % is found.
        for factor in (0.97, 1.03):
            with tempfile.TemporaryDirectory() as folder:
                out = os.path.join(folder, "wrong.exr")
                self.ask("render", absorbing(factor), out=out)
                wrong = np.array(mi.Bitmap(out))[:, :, :3]
            found, limit = bias(mean, variance, answer["repeats"], wrong)
            self.assertGreater(abs(found), 2 * limit, factor)
            self.assertEqual(found < 0, factor > 1)

    def test_samples_of_volpathmis_are_as_many_as_without_a_sampler(self):
        scene = absorbing() + '[sampler]\ntype = "grid"\nsamples_per_axis = 2\n'
        answer, mean, variance, own = self.images(scene, 4)
        self.assertEqual((answer["samples"], answer["repeats"]), (4, 4 * 4))
        found, limit = bias(mean, variance, answer["repeats"], own)
        self.assertLess(abs(found), limit)

    def test_other_media_than_those_of_the_shapes_are_refused(self):
        words = "in another medium than that of the side"
        # The bubble does not say that glass is around it.
        self.refused(absorbing(outside=(0, 0, 0)), words)
        # The camera is in a ball: the model's camera rays start in no medium.
        self.refused(absorbing().replace("origin = [0, 2, 6]", "origin = [2, 1, 0]"), words)
        # Mitsuba's volume integrators count fewer bounces.
        pane = '[[shape]]\ntype = "rectangle"\nmaterial = { type = "thin_dielectric" }\n'
        self.refused(absorbing() + pane, "no bounce")

    def test_mirrored_glass_is_refused(self):
        ball = '[[shape]]\ntype = "sphere"\ntransform = { scale = [1, 1, -1] }\nmaterial = { type = "MATERIAL" }\n'
        scene = film(32, 32) + DEEP + LOOK + SKY + ball
        self.refused(scene.replace("MATERIAL", "dielectric"), "mirrored")
        self.images(scene.replace("MATERIAL", "mirror"))

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
