"""Twins of out-of-tree plugins."""

import os
import tempfile
import unittest

from support import DOWN, ROOT, Case, film

from whitstone_mitsuba import shapes, twins
from whitstone_mitsuba.errors import DriverError

EXAMPLE = os.path.join(ROOT, "..", "..", "examples", "plugin-superquadric", "src", "superquadric.py")
LAMP = '[[light]]\ntype = "point"\nposition = [2, 6, 3]\nintensity = 40\n'


class Twins(Case):
    def tearDown(self):
        shapes.READERS.pop("superquadric", None)

    def image(self, shape):
        scene = film(24, 16) + DOWN + LAMP + f'[[shape]]\n{shape}\nmaterial = {{ type = "mirror" }}\n'
        scene += '[[shape]]\ntype = "plane"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n'
        pixels = [[x, y] for y in range(16) for x in range(24)]
        return self.ask("probe", scene, pixels=pixels, settings=[{}])["values"][0]

    def test_a_superquadric_of_exponent_1_is_an_ellipsoid(self):
        twins.load([EXAMPLE])
        turned = "transform = [{ rotate = { axis = [1, 2, 0], degrees = 40 } }, { translate = [0.3, 0.8, 0] }]"
        radii = "radii = [1.5, 0.6, 0.9]"
        ours = self.image(f'type = "superquadric"\n{radii}\n{turned}')
        theirs = self.image(f'type = "ellipsoid"\n{radii}\n{turned}')
        self.assertEqual(len(ours), len(theirs))
        for pixel, (a, b) in enumerate(zip(ours, theirs)):
            for value, other in zip(a, b):
                self.assertAlmostEqual(value, other, delta=1e-4 * (1 + abs(other)), msg=pixel)

    def test_a_type_is_added_once(self):
        twins.load([EXAMPLE])
        with self.assertRaises(DriverError) as raised:
            twins.load([EXAMPLE])
        self.assertIn("already exists", str(raised.exception))
        self.assertIn("superquadric.py", str(raised.exception))

    def test_a_file_that_cannot_be_run_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "broken.py")
            with open(path, "w", encoding="utf-8") as file:
                file.write("import nothing_of_this_name\n")
            for name in (path, os.path.join(folder, "absent.py"), os.path.join(folder, "twin.txt")):
                with self.assertRaises(DriverError) as raised:
                    twins.load([name])
                self.assertIn(name, str(raised.exception))


if __name__ == "__main__":
    unittest.main()
