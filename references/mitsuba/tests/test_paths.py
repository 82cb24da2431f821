"""Path classes: expressions against Python's `re` on all signatures, and parts of a pixel against
closed forms.
"""

import itertools
import re
import unittest

import numpy as np

from support import Case
from whitstone_mitsuba import paths

EXPRESSIONS = [
    ".*",
    "E D L",
    "E S* D L",
    "E [ST]* T [ST]* D [LA]",
    "E (S|T S){1,2} D.",
    "E [^S]* (O|B)",
    "E S{2,} . .",
    "E(ST?)+G?(DL|)O?",
    "E (|S S+) (D.|O)",
]
FAULTS = ["E (D L", "E D) L", "*", "E [", "E [DL", "E X", "E S{3,1}", "E S{", "E S{500}", "E|*"]

# A mirror with reflectance 0.5, in which the camera sees a ceiling that emits 3, reflects 0.8 of an
# ambient radiance of 0.25, and has a lamp of irradiance pi.
MIRROR = """
[film]
width = 1
height = 1

[film.paths]
lamp = "E S D L"
ambient = "E S D A"
glow = "ESO"
sky = "E .* B"
rest = "E (|S S+) (D.|O)"

[camera]
type = "orthographic"
width = 0.01
look_at = { origin = [0, 1, 0], target = [0, 0, 0], up = [0, 0, 1] }

[integrator]
type = "whitted"
shadows = "none"

[[light]]
type = "directional"
direction = [0, 1, 0]
irradiance = 3.14159265358979

[[light]]
type = "ambient"
radiance = 0.25

[[shape]]
type = "rectangle"
transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }
material = { type = "mirror", reflectance = 0.5 }

[[shape]]
type = "plane"
transform = [{ rotate = { axis = [1, 0, 0], degrees = 90 } }, { translate = [0, 2, 0] }]
material = { type = "emissive", radiance = 3, material = { type = "matte", reflectance = 0.8 } }
"""


def signatures(depth):
    """All signatures with at most this many branches."""
    branches = ["".join(way) for count in range(depth + 1) for way in itertools.product("SGT", repeat=count)]
    return [f"E{way}{end}" for way in branches for end in paths.ENDS]


class Expressions(unittest.TestCase):
    def test_expressions_match_as_regular_expressions(self):
        for text in EXPRESSIONS:
            found = paths.classes([("one", text)])
            reference = re.compile(text.replace(" ", ""))
            matched = 0
            for signature in signatures(5):
                end = next(end for end in paths.ENDS if signature.endswith(end))
                states = np.zeros(2, dtype=np.int64)
                for event in signature[1 : len(signature) - len(end)]:
                    states = found.after(states, event)
                expected = reference.fullmatch(signature) is not None
                self.assertEqual(list(found.ends(states, end)[0]), [expected, expected], (text, signature))
                matched += expected
            self.assertGreater(matched, 0, text)

    def test_faults_are_refused(self):
        for text in FAULTS:
            errors = []
            paths.read({"one": text}, errors)
            self.assertEqual(len(errors), 1, text)
            self.assertTrue(errors[0].startswith("film.paths.one: "), errors)

    def test_an_expression_that_remembers_much_is_refused(self):
        found = paths.classes([("one", ".* S .{20} B")])
        with self.assertRaises(paths.ParseError):
            states = np.zeros(1, dtype=np.int64)
            for _ in range(20):
                states = np.concatenate([found.after(states, event) for event in "ST"])


class Parts(Case):
    def test_the_parts_of_a_reflection_are_those_of_its_lights(self):
        channels, _ = self.render(MIRROR)
        expected = {"lamp": 0.4, "ambient": 0.1, "glow": 1.5, "sky": 0.0, "rest": 0.0}
        for name, value in expected.items():
            self.assertAlmostEqual(float(channels[f"path.{name}.G"].flat[0]), value, delta=1e-6, msg=name)
        self.assertAlmostEqual(float(channels["G"].flat[0]), 2.0, delta=1e-6)

    def test_interpolated_colours_have_no_classes(self):
        scene = MIRROR.replace('type = "whitted"', 'type = "rasterizer"\ninterpolation = "gouraud"').replace("orthographic", "perspective")
        self.refuse(scene.replace("width = 0.01", "fov = 1"), "scene", "film.paths")


if __name__ == "__main__":
    unittest.main()
