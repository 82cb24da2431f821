"""The driver against Mitsuba's own C++ integrators, and the `time` op."""

import unittest

from support import Case, film

LOOK = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 2, 6], target = [0, 1, 0] }\n'
SKY = '[[light]]\ntype = "background"\nradiance = [1, 2, 4]\n'
LAMPS = """
[[light]]
type = "point"
position = [3, 5, 4]
intensity = [60, 50, 40]
[[light]]
type = "directional"
direction = [1, -2, -1]
irradiance = 2
[[light]]
type = "spot"
position = [-2, 4, 3]
target = [0, 0, 0]
intensity = 50
"""
BALLS = "".join(
    f'[[shape]]\ntype = "sphere"\ncenter = [{x}, 1, 0]\nradius = 0.9\nmaterial = {{ MATERIAL }}\n' for x in (-2, 0, 2)
)
FLOOR = '[[shape]]\ntype = "plane"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\nmaterial = { MATERIAL }\n'


class Check(Case):
    def check(self, material, lights, more=""):
        return self.ask("check", film(96, 64) + more + LOOK + lights + (FLOOR + BALLS).replace("MATERIAL", material))

    def test_direct_on_matte(self):
        answer = self.check('type = "matte", reflectance = { type = "checker", a = [0.9, 0.5, 0.1], scale = 3 }', LAMPS)
        direct = answer["direct"]
        self.assertEqual(direct["median_rel"], 0)
        self.assertGreater(direct["pixels"], 3000)
        # Differences only at shadow edges and terminators, where the spawn offsets differ.
        self.assertLess(direct["over_1e3"], 0.005 * direct["pixels"])
        self.assertIsNone(answer["path"])
        self.assertIn("matte", answer["why"]["path"])

    def test_direct_on_hosted(self):
        lamps = LAMPS + 'falloff = "none"\n'
        for material in ('type = "phong"', 'type = "blinn_phong"', 'type = "whitted", k_d = 0.5, k_refl = 0.1'):
            direct = self.check(material, lamps)["direct"]
            self.assertLess(direct["median_rel"], 1e-6)
            self.assertLess(direct["over_1e3"], 0.005 * direct["pixels"])

    def test_path_on_mirrors(self):
        answer = self.check('type = "mirror", reflectance = [0.9, 0.8, 0.7]', SKY)
        self.assertIsNone(answer["direct"])
        path = answer["path"]
        self.assertEqual(path["pixels"], 96 * 64)
        self.assertLess(path["median_rel"], 1e-6)
        self.assertLess(path["over_1e3"], 0.02 * path["pixels"])

    def test_time(self):
        scene = film(32, 32) + LOOK + LAMPS + (FLOOR + BALLS).replace("MATERIAL", 'type = "phong"')
        answer = self.ask("time", scene, repeats=1)
        self.assertGreater(answer["driver_s"], 0)
        self.assertGreater(answer["path_s"], 0)
        self.assertEqual(answer["driver_rays"]["closest"], 32 * 32)


if __name__ == "__main__":
    unittest.main()
