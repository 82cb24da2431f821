"""Local terms and lights against closed forms (model §7, §8)."""

import math
import unittest

from support import DOWN, FLOOR, Case, film

HEAD = film() + DOWN
POINT = '[[light]]\ntype = "point"\nposition = [3, 4, 0]\nintensity = [25, 50, 75]\n'


def material(text):
    return FLOOR + f"material = {{ {text} }}\n"


class Lights(Case):
    def test_point_inverse_square(self):
        # d = 5, cos = 4/5: rho/pi * cos * I/d2
        self.near(self.value(HEAD + POINT + FLOOR), [0.5 / math.pi * 0.8 * number for number in (1, 2, 3)])

    def test_point_without_falloff(self):
        scene = HEAD + POINT + 'falloff = "none"\n' + FLOOR
        self.near(self.value(scene), [0.5 / math.pi * 0.8 * number for number in (25, 50, 75)])

    def test_directional(self):
        scene = HEAD + '[[light]]\ntype = "directional"\ndirection = [0, -2, 2]\nirradiance = 3\n' + FLOOR
        self.near(self.value(scene), 0.5 / math.pi * 3 * math.sqrt(0.5))

    def test_directional_from_below_is_hidden(self):
        scene = HEAD + '[[light]]\ntype = "directional"\ndirection = [0, 1, 0]\nirradiance = 3\n' + FLOOR
        self.assertEqual(list(self.value(scene)), [0, 0, 0])

    def spot(self, angle, more=""):
        """Lit from height 1 at the origin, axis tilted by `angle` degrees."""
        x = math.tan(math.radians(angle))
        light = f'[[light]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [{x}, 0, 0]\nintensity = 1\n' + more
        return float(self.value(HEAD + light + FLOOR)[0]) * math.pi / 0.5

    def test_spot(self):
        self.near(self.spot(0), 1.0)
        self.near(self.spot(14.9), 1.0)
        self.near(self.spot(17.5), 0.5, rel=1e-5)
        self.assertEqual(self.spot(20.5), 0)
        wide = "cutoff_angle = 60\nbeam_width = 10\n"
        self.near(self.spot(30, wide), 0.6, rel=1e-5)

    def test_background_is_seen_and_lights_nothing(self):
        scene = HEAD + '[[light]]\ntype = "background"\nradiance = [1, 2, 3]\n' * 2
        self.assertEqual(list(self.value(scene)), [2, 4, 6])
        self.assertEqual(list(self.value(scene + FLOOR)), [0, 0, 0])

    def test_ambient(self):
        scene = HEAD + '[[light]]\ntype = "ambient"\nradiance = [1, 2, 3]\n' * 2
        self.near(self.value(scene + material('type = "matte", reflectance = [0.1, 0.2, 0.3]')), [0.2, 0.8, 1.8])
        self.near(self.value(scene + material('type = "phong", k_d = 0.25')), [0.5, 1.0, 1.5])
        self.near(self.value(scene + material('type = "phong", k_a = 1')), [2, 4, 6])
        self.assertEqual(list(self.value(scene + material('type = "mirror"'))), [0, 0, 0])

    def test_light_at_the_surface_gives_nothing(self):
        scene = HEAD + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nintensity = 1\n' + FLOOR
        self.assertEqual(list(self.value(scene)), [0, 0, 0])

    def test_shadows(self):
        blocker = '[[shape]]\ntype = "sphere"\ncenter = [1.5, 2, 0]\nradius = 0.1\nmaterial = { type = "dielectric" }\n'
        self.assertEqual(list(self.value(HEAD + POINT + FLOOR + blocker)), [0, 0, 0])
        beyond = blocker.replace("[1.5, 2, 0]", "[6, 8, 0]")
        self.near(self.value(HEAD + POINT + FLOOR + beyond), self.value(HEAD + POINT + FLOOR))
        off = HEAD + '[integrator]\ntype = "whitted"\nshadows = "none"\n' + POINT + FLOOR
        self.near(self.value(off + blocker), self.value(HEAD + POINT + FLOOR))

    def test_both_sides(self):
        under = FLOOR.replace("degrees = -90", "degrees = 90")
        self.near(self.value(HEAD + POINT + under), self.value(HEAD + POINT + FLOOR))


class Lobes(Case):
    # v = +y, l = (0.6, 0.8, 0): n.l = 0.8, r.v = 0.8, n.h = cos(acos(0.8) / 2)
    def test_phong(self):
        value = self.value(HEAD + POINT + material('type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10'))
        expected = 0.1 * 0.8 + 0.2 * 0.8**10
        self.near(value, [expected, 2 * expected, 3 * expected])

    def test_blinn_phong(self):
        value = self.value(HEAD + POINT + material('type = "blinn_phong", k_d = 0.1, k_s = 0.2, exponent = 10'))
        expected = 0.1 * 0.8 + 0.2 * math.cos(math.acos(0.8) / 2) ** 10
        self.near(value, [expected, 2 * expected, 3 * expected])

    def test_whitted_lobes(self):
        value = self.value(HEAD + POINT + material('type = "whitted", k_d = 0.1, k_s = 0.2, exponent = 10'))
        self.near(value, self.value(HEAD + POINT + material('type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10')))
        self.assertEqual(list(self.value(HEAD + POINT + material('type = "whitted"'))), [0, 0, 0])

    def test_phong_from_behind(self):
        under = FLOOR.replace("degrees = -90", "degrees = 90")
        text = 'material = { type = "phong", k_d = 0.1, k_s = 0.2, exponent = 10 }\n'
        self.near(self.value(HEAD + POINT + under + text), self.value(HEAD + POINT + FLOOR + text))

    def test_default_material(self):
        self.near(self.value(HEAD + POINT + FLOOR), self.value(HEAD + POINT + material('type = "matte", reflectance = 0.5')))


if __name__ == "__main__":
    unittest.main()
