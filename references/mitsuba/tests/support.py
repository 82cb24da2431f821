"""Shared by all tests: puts the package on the path, and shortens requests."""

import json
import os
import sys
import tempfile
import unittest

import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, ROOT)

from whitstone_mitsuba import operations  # noqa: E402
from whitstone_mitsuba.runtime import mi  # noqa: E402

# Relative error of float32 chains of a few operations.
EPS = 2e-6

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


def film(width=1, height=1, aovs=()):
    return f"[film]\nwidth = {width}\nheight = {height}\naovs = {json.dumps(list(aovs))}\n"


class Case(unittest.TestCase):
    """Requests that must succeed, and comparisons of colours."""

    maxDiff = None

    def ask(self, op, scene, base=".", **more):
        answer = operations.answer({"op": op, "scene": scene, "base": base, **more})
        self.assertTrue(answer["ok"], answer)
        # Through JSON, as the harness sees it.
        return json.loads(json.dumps(answer, allow_nan=False))

    def refuse(self, scene, kind, *words, base="."):
        answer = operations.answer({"op": "probe", "scene": scene, "base": base, "pixels": [[0, 0]], "settings": [{}]})
        self.assertFalse(answer["ok"], answer)
        self.assertEqual(answer["kind"], kind, answer)
        for word in words:
            self.assertIn(word, answer["error"])

    def value(self, scene, x=0, y=0, base=".", **setting):
        return np.array(self.ask("probe", scene, base, pixels=[[x, y]], settings=[setting])["values"][0][0])

    def nodes(self, scene, x=0, y=0, base=".", sample=0, **setting):
        return self.ask("tree", scene, base, pixel=[x, y], sample=sample, setting=setting)["nodes"]

    def render(self, scene, base=".", **more):
        """(channels by name, the answer)."""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "out.exr")
            answer = self.ask("render", scene, base, out=path, **more)
            bitmap = mi.Bitmap(path)
            self.assertEqual(os.listdir(folder), ["out.exr"])
        pixels = np.atleast_3d(np.array(bitmap))
        names = [field.name for field in bitmap.struct_()]
        return {name: pixels[:, :, number] for number, name in enumerate(names)}, answer

    def near(self, found, expected, rel=EPS, atol=1e-7):
        np.testing.assert_allclose(np.broadcast_to(found, np.shape(expected) or np.shape(found)), expected, rtol=rel, atol=atol)
