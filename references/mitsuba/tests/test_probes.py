"""Mitsuba's own results for single queries."""

import math
import unittest

from support import DOWN, EPS, Case, film, operations

BALL = film(4, 4) + DOWN + '[[shape]]\ntype = "sphere"\n'
MIRRORS = film() + DOWN + '[[shape]]\ntype = "rectangle"\n[[shape]]\ntype = "rectangle"\ntransform = { translate = [0, 0, 1] }\n'


class Probes(Case):
    def test_closest(self):
        answer = self.ask("closest", BALL, rays=[[0, 0, 3, 0, 0, -1], [0, 5, 3, 0, 0, -1], [0, 0, 3, 0, 0, -2]])
        self.assertEqual(answer["t"], [2, "inf", 1])
        self.assertGreater(answer["ns_per_ray"], 0)

    def test_occluded(self):
        rays = [[0, 0, 3, 0, 0, -1], [0, 5, 3, 0, 0, -1]]
        self.assertEqual(self.ask("occluded", BALL, rays=rays, target=[0, 0, -9])["blocked"], [True, None])
        self.assertEqual(self.ask("occluded", BALL, rays=rays, target=[0, 0, 9])["blocked"], [False, None])

    def test_walk(self):
        rays = [[0, 0, 3, 0, 0, -1], [0, 5, 3, 0, 0, -1]]
        self.assertEqual(self.ask("walk", BALL, rays=rays, mode="through", limit=9)["counts"], [2, 0])
        self.assertEqual(self.ask("walk", BALL, rays=rays, mode="reflect", limit=9)["counts"], [1, 0])
        between = [[0.1, 0.2, 0.5, 0, 0, -1]]
        self.assertEqual(self.ask("walk", MIRRORS, rays=between, mode="reflect", limit=9)["counts"], [9])

    def test_fresnel(self):
        answer = operations.answer({"op": "fresnel", "cosines": [1, 0.1], "ior": 1.5})
        self.assertAlmostEqual(answer["reflectance"][0], 0.04, delta=EPS)
        self.assertAlmostEqual(abs(answer["cosine"][0]), 1, delta=EPS)
        total = operations.answer({"op": "fresnel", "cosines": [0.5], "ior": 0.5})
        self.assertEqual((total["reflectance"], total["cosine"]), ([1], [0]))

    def test_camera(self):
        # Straight down, and a quarter of the image width to the right.
        directions = self.ask("camera", BALL, positions=[[0.5, 0.5], [0.75, 0.5]])["directions"]
        slant = math.atan(0.5)
        for found, expected in zip(directions, ([0, -1, 0], [math.sin(slant), -math.cos(slant), 0])):
            for a, b in zip(found, expected):
                self.assertAlmostEqual(a, b, delta=EPS)

    def test_bad_requests(self):
        for op, more in [
            ("closest", {"rays": [[0, 0, 3]]}),
            ("closest", {"rays": ["up"]}),
            ("walk", {"rays": [[0, 0, 3, 0, 0, -1]], "mode": "sideways", "limit": 3}),
            ("occluded", {"rays": [[0, 0, 3, 0, 0, -1]]}),
        ]:
            answer = operations.answer({"op": op, "scene": BALL, "base": ".", **more})
            self.assertFalse(answer["ok"], answer)


if __name__ == "__main__":
    unittest.main()
