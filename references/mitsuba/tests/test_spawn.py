"""Rays that leave a surface: none hits it again, and the driver agrees with Mitsuba's own `direct`
at any size and distance.
"""

import math
import os
import unittest

import numpy as np
from support import Case, film

ASSETS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "scenes", "assets")
TURNED = "transform = [{{ scale = {0} }}, {{ rotate = {{ axis = [1, 0.2, 0], degrees = -60 }} }}]\n"
SHAPES = {
    "sphere": 'type = "sphere"\nradius = {0}\n',
    "disk": 'type = "disk"\n' + TURNED,
    "rectangle": 'type = "rectangle"\n' + TURNED,
    "box": 'type = "box"\n' + TURNED,
    "mesh": 'type = "mesh"\nfile = "icosphere_2.ply"\ntransform = {{ scale = {0} }}\n',
}


def scene(shape, size, ratio, more=""):
    """A shape of this size, seen from `ratio` times its size away so that it fills the view, lit by
    one lamp.
    """
    eye = [size * ratio * x for x in (0.48, 0.6, 0.64)]
    lamp = [size * x for x in (3, 5, 4)]
    return (
        film(64, 64)
        + f'[camera]\ntype = "perspective"\nlook_at = {{ origin = {eye}, target = [0, 0, 0] }}\n'
        + f"fov = {math.degrees(2 * math.atan(1.3 / ratio))}\n"
        + f'[[light]]\ntype = "point"\nposition = {lamp}\nintensity = {60 * size * size}\n'
        + "[[shape]]\n"
        + SHAPES[shape].format(size)
        + more
    )


class Spawn(Case):
    def test_stock_direct_at_any_size_and_distance(self):
        for shape in SHAPES:
            for size in (1e-2, 1.0, 1e2):
                for ratio in (3, 12, 30, 100, 300, 1000):
                    with self.subTest(shape=shape, size=size, ratio=ratio):
                        text = scene(shape, size, ratio)
                        direct = self.ask("check", text, ASSETS)["direct"]
                        self.assertGreater(direct["pixels"], 1000)
                        # For a disk that is 100 m wide and far away, stock Mitsuba itself shadows
                        # some points by the disk.
                        own_fault = shape == "disk" and size == 1e2 and ratio >= 100
                        self.assertLessEqual(direct["over_1e3"], (3e-3 if own_fault else 1e-3) * direct["pixels"])
                        self.assertEqual(self.render(text, ASSETS)[1]["rehits"], 0)

    def test_a_wide_disk_is_lit_where_stock_mitsuba_shadows_it(self):
        """The disk faces the lamp, so every pixel that shows it must be lit."""
        channels, answer = self.render(scene("disk", 1e2, 100).replace('aovs = []', 'aovs = ["shape_id"]'))
        seen = channels["shape_id.I"] == 0
        self.assertGreater(seen.sum(), 1000)
        self.assertEqual((channels["R"][seen] == 0).sum(), 0)
        self.assertEqual(answer["rehits"], 0)

    def test_glass_balls_are_left_inward_and_outward(self):
        for radius in (1, 9):
            glass = 'material = { type = "dielectric", interior_ior = 1.5 }\n'
            sky = '[[light]]\ntype = "background"\nradiance = 1\n'
            answer = self.render(scene("sphere", radius, 12, glass + sky))[1]
            self.assertGreater(answer["rays"]["closest"], 3 * 64 * 64)
            self.assertEqual(answer["rehits"], 0)

    def test_rehits_that_remain_are_counted(self):
        """With an offset far too small for the coordinates, doubling it does not help, and the
        driver reports it.
        """
        tiny = {"k": 1e-9}
        self.assertGreater(self.render(scene("rectangle", 1e2, 30), setting=tiny)[1]["rehits"], 0)

    def test_an_offset_that_is_too_small_is_doubled_for_its_ray_only(self):
        text = scene("rectangle", 1e2, 30)
        channels, answer = self.render(text)
        self.assertGreater(answer["respawned"], 0)
        larger, _ = self.render(text, setting={"k": 64})
        np.testing.assert_allclose(channels["R"], larger["R"], rtol=1e-4, atol=1e-9)


if __name__ == "__main__":
    unittest.main()
