"""Stochastic rounding of mesh vertices: by at most one unit in the last place, and nothing else
changes.
"""

import os
import tempfile
import unittest

import numpy as np
from support import DOWN, Case, film

from whitstone_mitsuba import rounding

LIGHT = '[[light]]\ntype = "point"\nposition = [1, 3, 2]\nintensity = 30\n'


class Rounding(Case):
    def test_numbers(self):
        exact = np.random.default_rng(1).normal(size=20000) * 10.0 ** np.random.default_rng(2).integers(-6, 6, 20000)
        near, other = rounding.nearest(exact), rounding.by_hash(5)(exact)
        self.assertEqual(other.dtype, np.float32)
        moved = near != other
        # A number is 0 to 1/2 of the gap away from the nearest float. This share is the
        # probability that it is rounded to the other one.
        self.assertTrue(0.23 < moved.mean() < 0.27, moved.mean())
        gap = np.spacing(np.abs(near))
        self.assertLess(abs(((other - exact) / gap).mean()), 0.02)
        # The number lies between the two, which are adjacent floats.
        self.assertTrue(((near.astype(float) < exact) == (other.astype(float) > exact))[moved].all())
        np.testing.assert_array_equal(np.nextafter(near, other)[moved], other[moved])
        np.testing.assert_array_equal(rounding.by_hash(5)(exact[::-1])[::-1], other)
        # Twice the probability that one is rounded up and the other down, 1/6.
        self.assertTrue(0.3 < (rounding.by_hash(6)(exact) != other).mean() < 0.37)
        held = exact.astype(np.float32).astype(float)
        np.testing.assert_array_equal(rounding.by_hash(5)(held), held)

    def test_only_inexact_numbers_vary(self):
        turned = "transform = { rotate = { axis = [1, 2, 3], degrees = 31 } }\n"
        for kind, steps, varies in (("box", turned, True), ("box", "", False), ("sphere", turned, False), ("rectangle", turned, False)):
            scene = film(8, 8) + DOWN + LIGHT + f'[[shape]]\ntype = "{kind}"\n{steps}'
            nominal, again = (self.render(scene, setting={"seed": 3})[0]["R"] for _ in range(2))
            found = [self.render(scene, setting={"vertices": True, "seed": seed})[0]["R"] for seed in (3, 4)]
            np.testing.assert_array_equal(nominal, again)
            for values in found:
                self.assertEqual((values != nominal).any(), varies, (kind, steps))
                np.testing.assert_allclose(values, nominal, rtol=1e-5)
            self.assertEqual((found[0] != found[1]).any(), varies)

    def test_no_gap_opens(self):
        """Two meshes that share an edge, each with vertices of its own: no ray slips through."""
        points = "\n".join(f"v {x} 0 {z}" for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        with tempfile.TemporaryDirectory() as folder:
            for name, face in (("one", "1 3 2"), ("two", "1 4 3")):
                with open(os.path.join(folder, name + ".obj"), "w", encoding="utf-8") as file:
                    file.write(f"{points}\nf {face}\n")
            shape = '[[shape]]\ntype = "mesh"\nfile = "{}.obj"\ntransform = {{ scale = 0.7 }}\n'
            camera = DOWN.replace("fov = 90", "fov = 10")
            scene = film(64, 64, ["shape_id"]) + camera + LIGHT + shape.format("one") + shape.format("two")
            for seed in range(4):
                channels, _ = self.render(scene, folder, setting={"vertices": True, "seed": seed})
                self.assertTrue((channels["shape_id.I"] >= 0).all())
                self.assertTrue((channels["R"] > 0).all())

    def test_refused(self):
        answer = self.ask("probe", film() + DOWN, pixels=[[0, 0]], settings=[{"vertices": False}])
        self.assertEqual(answer["values"], [[[0, 0, 0]]])
        with self.assertRaises(AssertionError):
            self.ask("probe", film() + DOWN, pixels=[[0, 0]], settings=[{"vertices": 1}])


if __name__ == "__main__":
    unittest.main()
