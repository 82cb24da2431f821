"""Level sets: isosurface, implicit, fractal (model §9), against closed forms."""

import math
import unittest

from support import Case, film, with_povray
from whitstone_povray.shapes import isosurface

WHITE = '[[light]]\ntype = "ambient"\nradiance = 1\n'
SEEN = 'material = { type = "matte", reflectance = 1 }\n'
CAMERA = '[camera]\ntype = "orthographic"\nlook_at = { origin = [0, 0, 9], target = [0, 0, 0] }\nwidth = 4\n'


@with_povray
class LevelSets(Case):
    def seen(self, shape, points, above=None):
        """Whether the shape is seen from above at some points, also beyond a grey rectangle at a
        height.
        """
        size = 400
        sheet = f'[[shape]]\ntype = "rectangle"\ntransform = [{{ scale = 3 }}, {{ translate = [0, 0, {above}] }}]\nmaterial = {{ type = "matte", reflectance = 0.5 }}\n'
        scene = film(size, size) + CAMERA + WHITE + f"[[shape]]\n{shape}\n" + (sheet if above is not None else "")
        # The material precedes the tables of fields.
        scene = scene.replace("SEEN", SEEN)
        pixels = [(int((x + 2) / 4 * size), int((2 - y) / 4 * size)) for x, y in points]
        return [value[0] > 0.75 for value in self.values(scene, pixels)]

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

    def test_fractals(self):
        # z^8: a ball of radius 2^(1/8).
        ball = 'type = "fractal"\nSEEN\nkind = "julia"\nc = [0, 0, 0, 0]\ndepth = 3\n'
        self.assertEqual(self.seen(ball, [(1.08, 0), (0, -1.08), (1.1, 0)]), [True, True, False])
        # More iterations take POV-Ray minutes per pixel. With c = -1 the set is rotationally
        # symmetric about the x axis, so the view from above shows its whole profile.
        c, depth = -1, 2
        solid = f'type = "fractal"\nSEEN\nkind = "julia"\nc = [{c}, 0, 0, 0]\ndepth = {depth}\n'

        def inside(x, y):
            z = complex(x, y)
            for _ in range(depth):
                z = z * z + c
            return abs(z) < 2

        # POV-Ray takes some seconds per point.
        points = [(x / 8 + 0.01, y / 8 + 0.01) for x in range(-14, 15, 4) for y in (0, 4)]
        expected = [any(inside(x, y + k / 200) for k in range(300)) for x, y in points]
        clear = [p for p, e in zip(points, expected) if all(any(inside(p[0] + d, p[1] + f + k / 200) for k in range(300)) == e for d in (-0.02, 0.02) for f in (0, 0.02))]
        self.assertGreater(len(clear), 8)
        self.assertEqual(self.seen(solid, clear), [e for p, e in zip(points, expected) if p in clear])
        # On +z, one iterate is r² + r: 2 at r = 1; on -z it is r² - r: 2 at r = 2.
        bulb = 'type = "fractal"\nSEEN\nkind = "mandelbulb"\npower = 2\ndepth = 1\n'
        self.assertEqual(self.seen(bulb, [(0, 0)], above=0.98), [True])
        self.assertEqual(self.seen(bulb, [(0, 0)], above=1.02), [False])
        over = bulb + "transform = { rotate = { axis = [1, 0, 0], degrees = 180 } }\n"
        self.assertEqual(self.seen(over, [(0, 0)], above=1.98), [True])
        self.assertEqual(self.seen(over, [(0, 0)], above=2.02), [False])

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
