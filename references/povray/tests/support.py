"""Shared by all tests: puts the package on the path, and shortens requests."""

import json
import os
import shutil
import sys
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, ROOT)

from whitstone_povray import operations  # noqa: E402

# One exposure: half a unit in the last place of half precision, plus POV-Ray's own single precision
# of colours.
EPS = 2.0**-11

# Looks straight down at the origin from height 5: x to the right, z down in the image.
DOWN = """
[camera]
type = "perspective"
look_at = { origin = [0, 5, 0], target = [0, 0, 0], up = [0, 0, -1] }
fov = 90
"""
FLOOR = """
[[shape]]
type = "plane"
transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }
"""
BLACK_LIMIT = '[integrator]\ntype = "whitted"\nat_max_depth = "black"\n'

with_povray = unittest.skipUnless(
    shutil.which(os.environ.get("WHITSTONE_POVRAY") or "povray"), "povray is not installed (Debian: apt-get install povray)"
)


def film(width=1, height=1):
    return f"[film]\nwidth = {width}\nheight = {height}\n"


class Case(unittest.TestCase):
    """Requests that must succeed or be refused, and comparisons of colours."""

    maxDiff = None

    def ask(self, op, scene, base=".", **more):
        answer = operations.answer({"op": op, "scene": scene, "base": base, **more})
        self.assertTrue(answer["ok"], answer)
        return json.loads(json.dumps(answer, allow_nan=False))

    def refuse(self, scene, kind, *words, base="."):
        answer = operations.answer({"op": "write", "scene": scene, "base": base})
        self.assertFalse(answer["ok"], answer)
        self.assertEqual(answer["kind"], kind, answer)
        for word in words:
            self.assertIn(word, answer["error"])

    def values(self, scene, pixels=((0, 0),), base=".", **setting):
        found = self.ask("probe", scene, base, pixels=[list(pixel) for pixel in pixels], settings=[setting])
        return found["values"][0]

    def near(self, found, expected, rel=EPS, atol=1e-7):
        expected = [expected] * 3 if isinstance(expected, (int, float)) else expected
        for a, b in zip(found, expected):
            self.assertLessEqual(abs(a - b), rel * abs(b) + atol, f"{found} for {expected}")
