"""Half floats, and the files that hold them."""

import os
import random
import struct
import tempfile
import unittest

from support import ROOT  # noqa: F401  (puts the package on the path)
from whitstone_povray import exr, halves, tracing


def half(value):
    return struct.unpack("<e", struct.pack("<e", value))[0]


class Halves(unittest.TestCase):
    def test_a_half_brackets_what_is_rounded_to_it(self):
        numbers = random.Random(1)
        for _ in range(20000):
            value = numbers.choice((-1, 1)) * 2.0 ** numbers.uniform(-26, 15)
            found = half(value)
            low, high = halves.bracket(found)
            self.assertTrue(low <= value <= high, (value, found, low, high))
            # The range is tight: just outside of it, numbers round to another half.
            width = high - low
            self.assertNotEqual(half(low - 1e-3 * width), found)
            self.assertNotEqual(half(high + 1e-3 * width), found)

    def test_powers_of_two_and_subnormals(self):
        for exponent in range(-24, 15):
            low, high = halves.bracket(2.0**exponent)
            self.assertEqual(half((low + high) / 2), 2.0**exponent)
            self.assertTrue(low < 2.0**exponent < high)

    def test_exposures_narrow_the_range(self):
        numbers = random.Random(2)
        exposures = tracing.brightness(8)
        worst = 0.0
        for _ in range(2000):
            value = 2.0 ** numbers.uniform(-8, 3)
            colors = [(half(value * exposure),) * 3 for exposure in exposures]
            worst = max(worst, abs(tracing._bracketed(colors, exposures, 0) / value - 1))
        # A single exposure is off by up to 2^-11.
        self.assertLessEqual(worst, 2.0**-14)


class Files(unittest.TestCase):
    def test_floats_are_written_as_the_layout_says(self):
        rows = [[(x + 0.5, y - 0.25, 1000.0 * x * y) for x in range(5)] for y in range(37)]
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "a.exr")
            exr.write(path, rows)
            self.assertEqual(os.listdir(folder), ["a.exr"])
            with open(path, "rb") as file:
                data = file.read()
        attributes, at = halves._header(data)
        self.assertEqual(halves._channels(attributes["channels"]), [("B", 2), ("G", 2), ("R", 2)])
        self.assertEqual(struct.unpack("<4i", attributes["dataWindow"]), (0, 0, 4, 36))
        self.assertEqual(len(struct.unpack_from("<3Q", data, at)), 3)


if __name__ == "__main__":
    unittest.main()
