"""Sample positions (model §5): closed forms, and numbers that the tracer's own tests contain too.
"""

import unittest

import numpy as np
from support import DOWN, FLOOR, Case, film

from whitstone_mitsuba import samplers

SIDE = 2.0**32


def positions(text, pixels):
    """(pixels, samples, 2)."""
    errors, unsupported = [], []
    table = dict(item.split("=") for item in text.split()) if text else {}
    table = {key: value if key == "type" else int(value) for key, value in table.items()}
    sampler = samplers.read(table, errors, unsupported)
    assert not errors and not unsupported, (errors, unsupported)
    xy = np.array(pixels)
    return samplers.Samples.all(sampler).positions(xy[:, 0], xy[:, 1])


class Samplers(Case):
    def test_the_first_points_are_those_of_sobol(self):
        points = samplers.sobol(np.arange(8, dtype=np.uint32)[None, :])
        known = [[0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875], [0, 0.5, 0.75, 0.25, 0.625, 0.125, 0.375, 0.875]]
        np.testing.assert_array_equal([row[0] / SIDE for row in points], known)

    def test_every_elementary_box_holds_one_sobol_point(self):
        for at in positions("type=sobol samples=64 seed=9", [(0, 0), (5, 3)]):
            for wide in range(7):
                boxes = np.floor(at * [2**wide, 2 ** (6 - wide)])
                self.assertEqual(len(np.unique(boxes, axis=0)), 64)

    def test_each_cell_has_one_stratified_sample(self):
        for at in positions("type=stratified samples_per_axis=5", [(0, 0), (65535, 7)]):
            cells = np.floor(at * 5)
            np.testing.assert_array_equal(cells, [(k % 5, k // 5) for k in range(25)])

    def test_the_hash_wraps(self):
        # By hand, in integers of arbitrary size.
        def m(x):
            x &= 0xFFFFFFFF
            x ^= x >> 16
            x = x * 0x7FEB352D & 0xFFFFFFFF
            x ^= x >> 15
            x = x * 0x846CA68B & 0xFFFFFFFF
            return x ^ (x >> 16)

        seed, i, j, s = 4294967295, 12, 65535, 6
        p = m(m(m(seed) + j) + i)
        h = m(p + s)
        expected = [(0 + m(h + 1) / SIDE) / 3, (2 + m(h + 2) / SIDE) / 3]
        found = positions(f"type=stratified samples_per_axis=3 seed={seed}", [(i, j)])[0, s]
        self.assertEqual(found.tolist(), expected)
        # The same numbers as in the tracer's own test.
        self.assertEqual(found.tolist(), [0.20647533028386533, 0.8268316030347099])

        def reverse(x):
            return int(f"{x:032b}"[::-1], 2)

        def scrambled(x, q):
            x = (reverse(x) + q) & 0xFFFFFFFF
            for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
                x ^= x * factor & 0xFFFFFFFF
            return reverse(x)

        second = (1 << 30 | 1 << 31) ^ (1 << 31 | 1 << 29)  # v_1 and v_2, for s = 6
        expected = [scrambled(reverse(s), m(p + 1)) / SIDE, scrambled(second, m(p + 2)) / SIDE]
        found = positions(f"type=sobol samples=8 seed={seed}", [(i, j)])[0, s]
        self.assertEqual(found.tolist(), expected)
        self.assertEqual((found * SIDE).tolist(), [3596272196, 1078120820])

    def test_an_image_is_the_mean_over_its_positions(self):
        # The brightness of the floor under a directional light is that of its texture: stripes,
        # each as wide as half a pixel.
        light = '[[light]]\ntype = "directional"\ndirection = [0, -1, 0]\nirradiance = 3.141592653589793\n'
        floor = FLOOR + 'material = { type = "matte", reflectance = { type = "checker", a = 1, b = 0, scale = [0.3, 0.001] } }\n'
        size = 4
        for kind in ("type=stratified samples_per_axis=3 seed=2", "type=sobol samples=9 seed=2"):
            table = "[sampler]\n" + "\n".join(
                f'type = "{value}"' if key == "type" else f"{key} = {value}" for key, value in (item.split("=") for item in kind.split())
            )
            scene = film(size, size) + DOWN + table + "\n" + light + floor
            pixels = [[x, y] for y in range(size) for x in range(size)]
            values = np.array(self.ask("probe", scene, pixels=pixels, settings=[{}])["values"][0])[:, 0]
            at = positions(kind, pixels)
            # Five metres above the floor, 90 degrees wide.
            x = (np.array(pixels)[:, None, :] + at)[:, :, 0] / size * 10 - 5
            z = (np.array(pixels)[:, None, :] + at)[:, :, 1] / size * 10 - 5
            even = (np.floor(0.3 * x) + np.floor(-0.001 * z)) % 2 == 0
            np.testing.assert_allclose(values, even.mean(axis=1), atol=1e-6)

    def test_a_pixel_takes_more_samples_where_they_differ(self):
        # Stripes of the width of several pixels, crossed by others: some pixels show one colour,
        # some an edge.
        light = '[[light]]\ntype = "directional"\ndirection = [0, -1, 0]\nirradiance = 3.141592653589793\n'
        floor = FLOOR + 'material = { type = "matte", reflectance = { type = "checker", a = 1, b = 0, scale = [0.31, 0.17] } }\n'
        size, most, first, threshold = 8, 50, 3, 0.02
        table = f'[sampler]\ntype = "adaptive"\nsamples = {most}\ninitial_samples = {first}\nthreshold = {threshold}\nseed = 5\n'
        pixels = [[x, y] for y in range(size) for x in range(size)]
        scene = film(size, size) + DOWN + table + light + floor
        found = np.array(self.ask("probe", scene, pixels=pixels, settings=[{}])["values"][0])[:, 0]

        at = (positions(f"type=sobol samples={most} seed=5", pixels) + np.array(pixels)[:, None, :]) / size * 10 - 5
        shown = (np.floor(0.31 * at[:, :, 0]) + np.floor(-0.17 * at[:, :, 1])) % 2 == 0
        # The model's rule, applied pixel by pixel.
        expected, numbers = [], []
        for number, (x, y) in enumerate(pixels):
            beside = [j * size + i for i, j in pixels if max(abs(i - x), abs(j - y)) == 1]
            q = max(float(np.ptp(shown[k, :first].astype(float))) for k in beside)
            n = first
            while n < most and max(0.3 * np.ptp(shown[number, :n].astype(float)) / n**0.75, 0.15 * q / n) > threshold:
                n = min(2 * n, most)
            expected.append(shown[number, :n].mean())
            numbers.append(n)
        np.testing.assert_allclose(found, expected, atol=1e-6)
        # 3 samples in uniform regions, 12 next to an edge, 48 on an edge.
        self.assertEqual(set(numbers), {3, 12, 48})


if __name__ == "__main__":
    unittest.main()
