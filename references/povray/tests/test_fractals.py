"""Fractals (model §9), against closed forms."""

import unittest

from level_sets import SeenFromAbove
from support import with_povray


@with_povray
class Fractals(SeenFromAbove):
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


if __name__ == "__main__":
    unittest.main()
