"""Level sets: isosurface, implicit (model §9), against closed forms; faults, also of fractals."""

import math
import unittest

from level_sets import CAMERA, SeenFromAbove
from support import film, with_povray
from whitstone_povray.shapes import isosurface


@with_povray
class LevelSets(SeenFromAbove):
    def test_interpolation_is_trilinear(self):
        # The density is 1/2 + (xy - z)/4: the iso value 1/2 gives the saddle z = xy; inside is
        # below it.
        values = [0.5 + (x * y - z) / 4 for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
        shape = f'type = "isosurface"\nSEEN\nsize = [2, 2, 2]\nvalues = {values}\n'
        points = [(0.6, 0.6), (-0.6, -0.6), (0.6, -0.6), (0.45, 0.5), (0.9, 0.25)]
        self.assertEqual(self.seen(shape, points), [True] * 5)
        self.assertEqual(self.seen(shape, points, above=0.25), [True, True, False, False, False])
        self.assertEqual(self.seen(shape, points, above=0.22), [True, True, False, True, True])
        # The box itself is not a surface.
        self.assertEqual(self.seen(shape, [(1.05, 0)]), [False])

    def test_more_cells(self):
        # Along z the densities 0, 1, 1, 3: greater than 1.001 from just behind the third value on,
        # at z = 1/3. With iso value 1 POV-Ray would search the whole plateau for roots, for
        # minutes.
        values = [v for v in (0, 1, 1, 3) for _ in range(4)]
        shape = f'type = "isosurface"\nSEEN\nsize = [2, 2, 4]\niso_value = 1.001\nvalues = {values}\n'
        self.assertEqual(self.seen(shape, [(0.1, 0.2)], above=0.32), [True])
        self.assertEqual(self.seen(shape, [(0.1, 0.2)], above=0.35), [False])
        # Along x, iso value 1.5 of 0, 1, 2: from x = 1/2 on; a wall, rotated to face the viewer.
        shape = 'type = "isosurface"\nSEEN\nsize = [3, 2, 2]\niso_value = 1.5\nvalues = [0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2]\n'
        shape += "transform = { rotate = { axis = [0, 1, 0], degrees = 90 } }\n"
        self.assertEqual(self.seen(shape, [(0, 0)], above=-0.49), [False])
        self.assertEqual(self.seen(shape, [(0, 0)], above=-0.51), [True])

    def test_operations(self):
        def field(text, more=""):
            return f'type = "implicit"\nSEEN\n{more}field = {text}\n'

        # The top of a ball.
        self.assertEqual(self.seen(field("{ sphere = { radius = 0.5 } }"), [(0.49, 0), (0.51, 0)]), [True, False])
        ring = field("{ torus = { major = 1, minor = 0.25 } }")
        self.assertEqual(self.seen(ring, [(0, 0), (0.74, 0), (0.76, 0), (0, 1.24), (0, 1.26)]), [False, False, True, True, False])
        # A blend of width k adds k/4 where both distances are equal.
        for k, expected in ((0.38, False), (0.42, True)):
            balls = ", ".join(f"{{ translate = {{ by = [{x}, 0, 0], of = {{ sphere = {{ radius = 0.4 }} }} }} }}" for x in (-0.5, 0.5))
            self.assertEqual(self.seen(field(f"{{ smooth_union = {{ k = {k}, of = [{balls}] }} }}"), [(0, 0)]), [expected])
        bar = "{ box = { half = [0.6, 0.1, 0.5] } }"
        turned = field(f"{{ rotate = {{ axis = [0, 0, 2], degrees = 30, of = {bar} }} }}")
        self.assertEqual(self.seen(turned, [(0.45, 0.26), (0.45, -0.26)]), [True, False])
        # The upper half of a bar that is twisted by 45 degrees up to there.
        half = f"{{ difference = [{{ twist = {{ degrees_per_metre = 90, of = {bar} }} }}, {{ plane = {{ normal = [0, 0, 1] }} }}] }}"
        self.assertEqual(self.seen(field(half), [(0.35, 0.35), (0.35, -0.35)]), [True, False])
        three = "{ repeat = { period = [0.8, 1, 1], count = [3, 2, 1], of = { scale = { by = 0.2, of = { sphere = {} } } } } }"
        self.assertEqual(self.seen(field(three), [(0.8, 0.5), (0, -0.5), (0, 0), (0.4, 0.5), (1.6, 0.5)]), [True, True, False, False, False])
        capsule = "{ capsule = { a = [0, 0, 0], b = [1, 1, 0], radius = 0.1 } }"
        self.assertEqual(self.seen(field(capsule), [(0.5, 0.5), (1.06, 1.06), (1.08, 1.08), (0.5, 0.3)]), [True, True, False, False])
        both = "{ intersection = [{ sphere = {} }, { translate = { by = [1, 0, 0], of = { sphere = {} } } }] }"
        self.assertEqual(self.seen(field(both), [(0.5, 0.8), (0.5, 0.9), (-0.1, 0)]), [True, False, False])
        cut = field("{ plane = { normal = [0, 0, 2], offset = 0.5 } }", "bounds = { min = [-1, -1, -1], max = [0.5, 1, 1] }\n")
        self.assertEqual(self.seen(cut, [(0.4, 0.9), (0.6, 0)]), [True, False])

    def test_metaballs_as_blob_and_as_isosurface(self):
        # (1 - r²)² = 1/4.
        ball = "{ metaballs = { threshold = 0.25, balls = [{ center = [0, 0, 0], radius = 1 }] } }"
        edge = math.sqrt(0.5)
        for text in (ball, f"{{ union = [{ball}] }}"):
            found = self.seen(f'type = "implicit"\nSEEN\nfield = {text}\n', [(edge - 0.01, 0), (edge + 0.01, 0)])
            self.assertEqual(found, [True, False])

    def test_errors_are_reported(self):
        def scene(text):
            return film() + CAMERA + f"[[shape]]\n{text}\n"

        self.refuse(scene('type = "isosurface"\nsize = [2, 2, 2]\nvalues = [1]'), "scene", "expected 8")
        self.refuse(scene('type = "isosurface"\nsize = [2, 2, 2]'), "scene", "one of `values`")
        self.refuse(scene('type = "implicit"\nfield = { shpere = {} }'), "scene", "no such field")
        self.refuse(scene('type = "implicit"\nfield = { plane = { normal = [0, 0, 1] } }'), "scene", "unbounded")
        self.refuse(scene('type = "fractal"\nkind = "julia"\nc = [2, 1, 0, 0]'), "scene", "at most 2 long")
        self.refuse(scene('type = "fractal"\nkind = "mandelbulb"\nc = [0, 0, 0, 0]'), "scene", "unknown key")
        self.refuse(scene('type = "fractal"\nkind = "mandelbulb"\ndepth = 20'), "unsupported", "iterations")


class Densities(unittest.TestCase):
    def test_the_hash_and_the_noise(self):
        self.assertEqual(isosurface.mix(1), 0x688990C0)
        found = isosurface._noise([2, 3, 2], 5)
        lattice = isosurface.mix((isosurface.mix((isosurface.mix(6) + 2) % 2**32) + 1) % 2**32)
        self.assertEqual(found[11], lattice / 2**32)

    def test_one_ball(self):
        found = isosurface._metaballs([9, 9, 9], 7, 1)
        h = [isosurface.mix((isosurface.mix(7 + isosurface.mix(0)) + a) % 2**32) / 2**32 for a in range(4)]
        squared = sum((p / 4 - 1 - (c - 0.5)) ** 2 for p, c in zip((4, 3, 5), h))
        self.assertAlmostEqual(found[4 + 9 * (3 + 9 * 5)], max(0, 1 - squared / (0.3 + 0.15 * h[3]) ** 2) ** 2, 14)
        self.assertGreater(max(found), 0.3)


if __name__ == "__main__":
    unittest.main()
