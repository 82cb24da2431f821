"""Local terms, lights and branches against closed forms (model §6-§8)."""

import math
import unittest

from support import BLACK_LIMIT, DOWN, EPS, FLOOR, Case, film, with_povray
from whitstone_povray import operations

HEAD = film() + DOWN
POINT = '[[light]]\ntype = "point"\nposition = [3, 4, 0]\nintensity = [25, 50, 75]\n'
SKY = '[[light]]\ntype = "background"\nradiance = [1, 2, 3]\n'


def material(text):
    return FLOOR + f"material = {{ {text} }}\n"


@with_povray
class Lights(Case):
    def floor(self, lights, more=""):
        return self.values(HEAD + lights + (more or FLOOR))[0]

    def test_point(self):
        # d = 5, cos = 4/5: rho/pi * cos * I/d2
        self.near(self.floor(POINT), [0.5 / math.pi * 0.8 * number for number in (1, 2, 3)])
        self.near(self.floor(POINT + 'falloff = "none"\n'), [0.5 / math.pi * 0.8 * number for number in (25, 50, 75)])

    def test_a_near_point_light(self):
        for height in (1e-3, 1e-2):
            light = f'[[light]]\ntype = "point"\nposition = [0, {height}, 0]\nintensity = {height**2}\n'
            self.near(self.floor(light), 0.5 / math.pi)

    def test_light_beyond_the_range_of_half_floats(self):
        for intensity in (1e-9, 1e-6, 1e6, 1e9):
            light = f'[[light]]\ntype = "point"\nposition = [0, 1, 0]\nintensity = {intensity}\n'
            self.near(self.floor(light), 0.5 / math.pi * intensity, atol=0)

    def test_distant_objects_block_directional_light(self):
        sun = '[[light]]\ntype = "directional"\ndirection = [0, -1, 0]\nirradiance = 1\n'
        block = '[[shape]]\ntype = "box"\ntransform = [{ scale = 100 }, { translate = [0, 3000, 0] }]\n'
        self.near(self.floor(sun), 0.5 / math.pi)
        self.assertEqual(self.floor(sun, FLOOR + block), [0, 0, 0])

    def test_directional(self):
        sun = '[[light]]\ntype = "directional"\ndirection = [0, %d, 2]\nirradiance = 3\n'
        self.near(self.floor(sun % -2), 0.5 / math.pi * 3 * math.sqrt(0.5))
        self.assertEqual(self.floor(sun % 2), [0, 0, 0])

    def test_spot(self):
        def spot(angle, more=""):
            x = math.tan(math.radians(angle))
            light = f'[[light]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [{x}, 0, 0]\nintensity = 1\n' + more
            return self.floor(light)[0] * math.pi / 0.5

        self.near([spot(14.9)], [1.0])
        self.near([spot(17.5)], [0.5])
        self.assertEqual(spot(20.5), 0)
        self.near([spot(30, "cutoff_angle = 60\nbeam_width = 10\n")], [0.6])
        light = '[[light]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = [1, 2, 3]\n'
        self.near(self.floor(light + "up = [1, 0, 0]\nimage = [4, 2, 0.5]\n"), [0.5 / math.pi * lit for lit in (4, 4, 1.5)])
        for keys, word in (("image = 1\n", "parallel"), ("up = [1, 0, 0]\n", "requires"), ("up = [1, 0, 0]\nimage = -1\n", "components")):
            self.refuse(HEAD + BLACK_LIMIT + light + keys, "scene", word)

    def test_ambient_and_background(self):
        ambient = '[[light]]\ntype = "ambient"\nradiance = [1, 2, 3]\n' * 2
        self.near(self.floor(ambient, material('type = "matte", reflectance = [0.1, 0.2, 0.3]')), [0.2, 0.8, 1.8])
        self.near(self.floor(ambient, material('type = "phong", k_d = 0.25')), [0.5, 1.0, 1.5])
        self.near(self.floor(ambient, material('type = "phong", k_a = 1')), [2, 4, 6])
        self.assertEqual(self.floor(ambient, material('type = "mirror"')), [0, 0, 0])
        self.assertEqual(self.floor(SKY), [0, 0, 0])
        self.assertEqual(self.values(HEAD + SKY + SKY)[0], [2, 4, 6])


@with_povray
class Materials(Case):
    def test_highlights(self):
        # The view is along the normal, so r.v = n.l = 0.8 and n.h = cos(half the angle).
        k = 'k_d = 0.3, k_s = [0.1, 0.2, 0.4], exponent = 12'
        half = math.cos(math.acos(0.8) / 2)
        for kind, lobe in (("phong", 0.8), ("blinn_phong", half)):
            found = self.values(HEAD + POINT + material(f'type = "{kind}", {k}'))[0]
            self.near(found, [(0.3 * 0.8 + s * lobe**12) * e for s, e in zip((0.1, 0.2, 0.4), (1, 2, 3))])

    def test_mirror(self):
        found = self.values(HEAD + BLACK_LIMIT + SKY + material('type = "mirror", reflectance = [0.5, 0.25, 0.1]'))[0]
        self.near(found, [0.5, 0.5, 0.3])
        # No reflection at depth 0.
        limited = BLACK_LIMIT + "max_depth = 0\n"
        self.assertEqual(self.values(HEAD + limited + SKY + material('type = "mirror"'))[0], [0, 0, 0])

    def test_mirror_with_a_texture(self):
        # At the origin, a checker shows a, and a ramp from 0 to 1 shows the colour at its offset.
        for text, expected in (
            ('{ type = "checker", a = [0.5, 0.25, 0.1], b = 0.9, offset = [0.5, 0.5] }', [0.5, 0.5, 0.3]),
            ('{ type = "gradient", a = [0, 1, 0], b = [1, 0, 0.5], offset = 0.25 }', [0.25, 1.5, 0.375]),
            ('{ type = "gradient", stops = [{ at = 0, color = 0 }, { at = 0.5, color = 1 }, { at = 1, color = 0 }], offset = 0.75 }', [0.5, 1, 1.5]),
        ):
            found = self.values(HEAD + BLACK_LIMIT + SKY + material(f'type = "mirror", reflectance = {text}'))[0]
            self.near(found, expected, rel=2 * EPS)

    def test_conductor(self):
        def formula(eta, k, c):
            # The model's formula.
            s2 = 1 - c * c
            d = eta * eta - k * k - s2
            big = math.sqrt(d * d + 4 * eta * eta * k * k)
            a = math.sqrt((big + d) / 2)
            r_s = (big - 2 * a * c + c * c) / (big + 2 * a * c + c * c)
            r_p = r_s * (c * c * big - 2 * a * c * s2 + s2 * s2) / (c * c * big + 2 * a * c * s2 + s2 * s2)
            return (r_s + r_p) / 2

        white = '[[light]]\ntype = "background"\nradiance = 1\n'
        for keys, eta, k, tint in (
            ('metal = "Cu"', (0.20101, 0.92375, 1.10222), (3.91326, 2.45305, 2.14209), (1, 1, 1)),
            ('eta = [1.6, 0.9, 1.5], k = [9, 6, 0.3], tint = [1, 0.5, 0.25]', (1.6, 0.9, 1.5), (9, 6, 0.3), (1, 0.5, 0.25)),
        ):
            for degrees in (1, 30, 62, 80, 86, 89):
                s, c = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
                look = f"look_at = {{ origin = [{5 * s}, {5 * c}, 0], target = [0, 0, 0], up = [0, 0, 1] }}"
                camera = f'[camera]\ntype = "perspective"\nfov = 0.01\n{look}\n'
                found = self.values(film() + camera + BLACK_LIMIT + white + material(f'type = "conductor", {keys}'))[0]
                self.near(found, [t * formula(e, x, c) for t, e, x in zip(tint, eta, k)], rel=1.5 * EPS)
        self.refuse(film() + DOWN + BLACK_LIMIT + material('type = "conductor", metal = "Cu", k = 1'), "scene", ".k")
        self.refuse(film() + DOWN + BLACK_LIMIT + material('type = "conductor", eta = 0.5, k = 0'), "unsupported", "sharply")

    def test_emissive(self):
        for lights in ("", POINT, '[[light]]\ntype = "ambient"\nradiance = 1\n'):
            self.near(self.values(HEAD + lights + material('type = "emissive", radiance = [1, 20, 0.5]'))[0], [1, 20, 0.5])
        checker = '{ type = "checker", a = [3, 2, 1], b = 0.9, offset = [0.5, 0.5] }'
        self.near(self.values(HEAD + material(f'type = "emissive", radiance = {checker}'))[0], [3, 2, 1])

    def glass(self, keys, inner="", depth=1):
        box = f'[[shape]]\ntype = "box"\nmaterial = {{ {keys} }}\n'
        ambient = '[[light]]\ntype = "ambient"\nradiance = 1\n'
        return self.values(HEAD + BLACK_LIMIT + f"max_depth = {depth}\n" + ambient + box + inner)[0]

    def test_dielectric(self):
        # A white box inside a box of glass: the share that enters is (1 - R)/n^2.
        inner = '[[shape]]\ntype = "box"\ntransform = { scale = 0.5 }\nmaterial = { type = "matte", reflectance = 1 }\n'
        self.near(self.glass('type = "dielectric", interior_ior = 1.5', inner), 0.96 / 1.5**2)
        # The path is half a metre long. Only the ratio of the indices matters.
        keys = 'type = "dielectric", interior_ior = 3, exterior_ior = 2, absorption = [0, 1, 2]'
        self.near(self.glass(keys, inner), [0.96 / 1.5**2 * math.exp(-0.5 * a) for a in (0, 1, 2)])
        # Reflected inside and absorbed on both segments: the light returns to the white box after
        # three branches.
        more = 0.96 / 1.5**2 * math.exp(-0.5)
        self.near(self.glass('type = "dielectric", absorption = 1', inner, 3), more)

    def test_whitted(self):
        inner = '[[shape]]\ntype = "box"\ntransform = { scale = 0.5 }\nmaterial = { type = "matte", reflectance = 1 }\n'
        keys = 'type = "whitted", k_d = 0.2, k_refr = [0.8, 0.6, 0.4]'
        # The ambient term k_d, and the radiance from behind, which is not scaled by the index.
        self.near(self.glass(keys, inner), [1.0, 0.8, 0.6])

    def test_total_internal_reflection(self):
        # Through the side of a box and from below against its top, at 62 degrees; the block below
        # is white.
        scene = (
            film() + BLACK_LIMIT + "max_depth = %d\n" + '[[light]]\ntype = "ambient"\nradiance = 1\n'
            '[camera]\ntype = "perspective"\nfov = 0.1\nlook_at = { origin = [-2, -0.5, 0], target = [-1, 0.5, 0] }\n'
            '[[shape]]\ntype = "box"\nmaterial = { %s }\n'
            '[[shape]]\ntype = "box"\ntransform = [{ scale = 0.1 }, { translate = [0.5, 0.65, 0] }]\n'
            'material = { type = "matte", reflectance = 1 }\n'
        )  # fmt: skip

        def seen(keys, depth=2):
            return self.values(scene % (depth, keys))[0]

        # In with k_refr; then total internal reflection, with k_refl + k_refr.
        for reflected, passed in ((0.3, 0.3), (0.5, 0.5), (0.6, 0.8), (0.0, 0.5)):
            keys = f'type = "whitted", k_refl = {reflected}, k_refr = {passed}'
            self.near(seen(keys), passed * (reflected + passed))
            self.near(seen(keys, 1), 0)
        keys = 'type = "whitted", k_refl = [0.1, 0.2, 0.3], k_refr = [0.1, 0.3, 0.6]'
        self.near(seen(keys), [0.02, 0.15, 0.54])
        # The local term is added at both hits.
        self.near(seen('type = "whitted", k_d = 0.1, k_refl = 0.3, k_refr = 0.3'), 0.1 + 0.3 * (0.1 + 0.6))
        # Only the ratio of the indices matters.
        self.near(seen('type = "whitted", k_refl = 0.2, k_refr = 0.4, interior_ior = 1.8, exterior_ior = 1.2'), 0.4 * 0.6)
        # For a dielectric the weight is 1.
        reflected = (math.cos(math.radians(45)), math.sqrt(1 - 0.5 / 2.25))
        r_s = (reflected[0] - 1.5 * reflected[1]) / (reflected[0] + 1.5 * reflected[1])
        r_p = (1.5 * reflected[0] - reflected[1]) / (1.5 * reflected[0] + reflected[1])
        self.near(seen('type = "dielectric"'), (1 - (r_s**2 + r_p**2) / 2) / 2.25)

    def test_total_reflection_outside(self):
        # From a denser medium against a box of air, at 71.6 degrees.
        scene = (
            film() + BLACK_LIMIT + '[[light]]\ntype = "ambient"\nradiance = 1\n'
            '[camera]\ntype = "perspective"\nfov = 0.1\nlook_at = { origin = [-3, 2, 0], target = [0, 1, 0] }\n'
            '[[shape]]\ntype = "box"\n'
            'material = { type = "whitted", k_refl = 0.2, k_refr = 0.5, interior_ior = 1, exterior_ior = 1.5 }\n'
            '[[shape]]\ntype = "box"\ntransform = [{ scale = 0.2 }, { translate = [3, 2, 0] }]\n'
            'material = { type = "matte", reflectance = 1 }\n'
        )  # fmt: skip
        self.near(self.values(scene)[0], 0.7)

    def test_overlapping_glass_and_cameras_in_glass_are_refused(self):
        glass = '[[shape]]\ntype = "sphere"\nradius = %s\ncenter = [%s, 0, 0]\nmaterial = { type = "whitted", k_refr = 1 }\n'
        scene = HEAD + BLACK_LIMIT

        def refused(text, *words):
            answer = operations.answer({"op": "probe", "scene": text, "pixels": [[0, 0]], "settings": [{}]})
            self.assertEqual(answer.get("kind"), "unsupported", answer)
            for word in words:
                self.assertIn(word, answer["error"])

        refused(scene + glass % (6, 0), "shape[0]", "camera")
        refused(scene.replace("perspective", "orthographic").replace("fov = 90", "width = 2") + glass % (6, 0), "shape[0]", "camera")
        refused(scene + glass % (1, 0) + glass % (0.5, 0), "shape[1]", "overlap")
        refused(scene + glass % (1, 0) + glass % (1, 1.9), "shape[1]", "overlap")
        box = '[[shape]]\ntype = "box"\ntransform = { translate = [%s, 0, 0] }\nmaterial = { type = "dielectric" }\n'
        refused(scene + box % 0 + box % 1.99, "shape[1]", "overlap")
        # Boxes that touch are separated.
        self.values(scene + box % 0 + box % 2)
        # Their bounding boxes overlap, the spheres do not.
        self.values(scene + glass % (1, 0) + glass.replace("0, 0]", "1.5, 0]") % (1, 1.5))

    def test_glass_casts_an_opaque_shadow(self):
        ball = '[[shape]]\ntype = "sphere"\ncenter = [1.5, 2, 0]\nradius = 0.5\nmaterial = { type = "dielectric" }\n'
        self.assertEqual(self.values(HEAD + BLACK_LIMIT + POINT + FLOOR + ball)[0], [0, 0, 0])
        without = "casts_shadow = false\n"
        self.near(self.values(HEAD + BLACK_LIMIT + POINT + FLOOR + ball + without)[0], [0.5 / math.pi * 0.8 * n for n in (1, 2, 3)])
        unshadowed = BLACK_LIMIT + 'shadows = "none"\n'
        self.near(self.values(HEAD + unshadowed + POINT + FLOOR + ball)[0], [0.5 / math.pi * 0.8 * n for n in (1, 2, 3)])

    def test_instances_replace_materials_and_shadows(self):
        glow = '[material.{}]\ntype = "emissive"\nradiance = {}\n'
        shared = "".join(glow.format(name, number) for name, number in (("one", 1), ("two", 2), ("three", 3)))
        floor = FLOOR.replace("[[shape]]", "[[group.inner.shape]]") + 'material = "one"\n'
        middle = '[[group.outer.shape]]\ntype = "instance"\ngroup = "inner"\nmaterials = { one = "two" }\n'
        place = '[[shape]]\ntype = "instance"\ngroup = "outer"\n'
        self.near(self.values(HEAD + shared + floor + middle + place)[0], [2] * 3)
        self.near(self.values(HEAD + shared + floor + middle + place + 'materials = { two = "three" }\n')[0], [3] * 3)
        roof = '[[group.roof.shape]]\ntype = "box"\ntransform = { translate = [1.5, 2, 0] }\n'
        above = '[[shape]]\ntype = "instance"\ngroup = "roof"\n'
        self.assertEqual(self.values(HEAD + POINT + FLOOR + roof + above)[0], [0, 0, 0])
        lit = self.values(HEAD + POINT + FLOOR + roof + above + "casts_shadow = false\n")[0]
        self.near(lit, [0.5 / math.pi * 0.8 * n for n in (1, 2, 3)])


if __name__ == "__main__":
    unittest.main()
