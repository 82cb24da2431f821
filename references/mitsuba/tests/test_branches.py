"""Mirrors, dielectrics, absorption and the limits of the recursion (model §6, §8)."""

import math
import unittest

import numpy as np

from support import DOWN, FLOOR, Case, film

HEAD = film() + DOWN
SKY = '[[light]]\ntype = "background"\nradiance = [1, 2, 4]\n'


def slab(text, bottom=-1, top=1):
    """A box from y = bottom to y = top."""
    return (
        f'[[shape]]\ntype = "box"\ntransform = [{{ scale = [9, {(top - bottom) / 2}, 9] }}, '
        f"{{ translate = [0, {(top + bottom) / 2}, 0] }}]\nmaterial = {{ {text} }}\n"
    )


def integrator(text):
    return f'[integrator]\ntype = "whitted"\n{text}\n'


class Mirrors(Case):
    def test_mirror(self):
        scene = HEAD + SKY + FLOOR + 'material = { type = "mirror", reflectance = [0.5, 0.25, 1] }\n'
        self.near(self.value(scene), [0.5, 0.5, 4])

    def test_facing_mirrors(self):
        """Between two mirrors, every reflection loses the same factor; the limit shows the
        background or black.
        """
        upper = '[[shape]]\ntype = "plane"\ntransform = [{ rotate = { axis = [1, 0, 0], degrees = 90 } }, { translate = [0, 8, 0] }]\n'
        mirror = 'material = { type = "mirror", reflectance = 0.5 }\n'
        scene = SKY + FLOOR + mirror + upper + mirror
        for depth in (0, 1, 5):
            self.near(self.value(HEAD + integrator(f"max_depth = {depth}") + scene), np.array([1, 2, 4]) * 0.5 ** (depth + 1))
            black = integrator(f'max_depth = {depth}\nat_max_depth = "black"')
            self.assertEqual(list(self.value(HEAD + black + scene)), [0, 0, 0])
        # 0.5^(n+1) < 0.1 first at n = 3: three branches are followed, the fourth is cut off.
        cut = HEAD + integrator("max_depth = 10000\nmin_contribution = 0.1") + scene
        self.assertEqual([node["path"] for node in self.nodes(cut)], ["", "R", "RR", "RRR"])
        self.assertEqual(list(self.value(cut)), [0, 0, 0])

    def test_a_large_max_depth_ends(self):
        scene = HEAD + integrator("max_depth = 100000") + SKY + FLOOR + 'material = { type = "mirror" }\n'
        self.near(self.value(scene), [1, 2, 4])

    def test_a_rasterizer_agrees_with_ray_casting(self):
        triangle = '[[shape]]\ntype = "triangle"\nvertices = [[-9, 0, 0], [9, 0, 9], [9, 0, -9]]\n'
        light = '[[light]]\ntype = "directional"\ndirection = [0, -1, 0]\nirradiance = 2\n'
        for material in ('material = { type = "mirror" }\n', 'material = { type = "matte" }\n'):
            values = [self.value(HEAD + f'[integrator]\ntype = "{kind}"\n' + SKY + light + triangle + material) for kind in ("rasterizer", "appel")]
            self.assertEqual(values[0].tolist(), values[1].tolist())
        self.refuse(HEAD + '[integrator]\ntype = "rasterizer"\n' + FLOOR, "scene", "triangles only", "plane")

    def test_interpolated_colours(self):
        """A triangle under a lamp close above its middle, which Gouraud shading cannot resolve.
        """
        corners = np.array([[-3, 0, 0], [3, 0, 3], [3, 0, -3.0]])
        eye, lamp, middle = np.array([0, 5, 1.0]), np.array([1, 0.5, 0]), corners.mean(axis=0)
        look = f"look_at = {{ origin = {eye.tolist()}, target = {middle.tolist()}, up = [0, 0, -1] }}"
        scene = film() + f'[camera]\ntype = "perspective"\n{look}\n'
        scene += f'[[light]]\ntype = "point"\nposition = {lamp.tolist()}\nintensity = 2\nfalloff = "none"\n'
        shape = f'[[shape]]\ntype = "triangle"\nvertices = {corners.tolist()}\nmaterial = {{ type = "phong", k_d = 0.5, k_s = 0.25, exponent = 4 }}\n'

        def local(p):
            light, view = (lamp - p) / np.linalg.norm(lamp - p), (eye - p) / np.linalg.norm(eye - p)
            mirrored = 2 * light[1] * np.array([0, 1, 0]) - light
            return 2 * (0.5 * light[1] + 0.25 * max(0.0, mirrored @ view) ** 4)

        kinds = '[integrator]\ntype = "rasterizer"\nshadows = "none"\ninterpolation = "{}"\n'
        self.near(self.value(scene + shape + kinds.format("phong")), [local(middle)] * 3)
        expected = np.mean([local(corner) for corner in corners])
        self.near(self.value(scene + shape + kinds.format("gouraud")), [expected] * 3, rel=1e-5)
        # With shadows: a small triangle half way between the lamp and the first corner.
        half, across = (corners[0] + lamp) / 2, 0.05 * np.array([[-0.25, 2, 0], [-0.25, -1, 2], [-0.25, -1, -2]])
        blocker = f'[[shape]]\ntype = "triangle"\nvertices = {(half + across).tolist()}\n'
        expected = (local(corners[1]) + local(corners[2])) / 3
        for shadows in ("opaque", "filtered"):
            text = scene + shape + blocker + kinds.format("gouraud").replace("none", shadows)
            self.near(self.value(text), [expected] * 3, rel=1e-5)

    def test_appel_traces_no_specular_rays(self):
        scene = HEAD + '[integrator]\ntype = "appel"\n' + SKY + FLOOR + 'material = { type = "mirror" }\n'
        self.assertEqual(list(self.value(scene)), [0, 0, 0])

    def test_mirror_image(self):
        """A sphere reflected in the floor appears at the position of its mirror image."""
        head = film(64, 64) + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 1, 6], target = [0, 1, 0] }\nfov = 60\n'
        lamp = '[[light]]\ntype = "ambient"\nradiance = 1\n'
        ball = '[[shape]]\ntype = "sphere"\ncenter = [0, {}, 0]\nradius = 0.7\n'
        mirror = FLOOR + 'material = { type = "mirror" }\n'
        direct, _ = self.render(head + lamp + ball.format(-1))
        image, _ = self.render(head + lamp + mirror + ball.format(1))
        below = slice(40, 64)
        self.assertGreater((direct["R"][below] > 0).sum(), 100)
        self.assertEqual(((direct["R"] > 0) != (image["R"] > 0))[below].sum(), 0)


class Dielectrics(Case):
    def test_fresnel_at_normal_incidence(self):
        nodes = self.nodes(HEAD + SKY + slab('type = "dielectric", interior_ior = 1.5'))
        by_path = {node["path"]: node for node in nodes}
        self.near(by_path["R"]["throughput"], [0.04] * 3)
        # (1 - R) * (1 / 1.5)^2 going in, (1 - R) * 1.5^2 coming out
        self.near(by_path["T"]["throughput"], [0.96 / 2.25] * 3)
        self.near(by_path["TT"]["throughput"], [0.96**2] * 3)
        self.near(by_path["TR"]["throughput"], [0.96 / 2.25 * 0.04] * 3)
        order = [node["path"] for node in nodes][:4]
        self.assertEqual(order, ["", "R", "T", "TR"])

    def test_fresnel_oblique(self):
        # At 45 degrees onto n = 1.5, cos_t = sqrt(1 - 0.5 / 2.25)
        head = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [5, 6, 0], target = [0, 1, 0], up = [0, 0, 1] }\n'
        by_path = {node["path"]: node for node in self.nodes(head + SKY + slab('type = "dielectric"'))}
        c_i, c_t = math.sqrt(0.5), math.sqrt(1 - 0.5 / 2.25)
        r_s, r_p = (c_i - 1.5 * c_t) / (c_i + 1.5 * c_t), (1.5 * c_i - c_t) / (1.5 * c_i + c_t)
        reflectance = (r_s**2 + r_p**2) / 2
        self.near(by_path["R"]["throughput"], [reflectance] * 3)
        self.near(by_path["T"]["throughput"], [(1 - reflectance) / 2.25] * 3)
        # Two metres down inside: the ray moves sideways by 2 tan(theta_t).
        self.near(by_path["T"]["p"], [-2 * math.sqrt(0.5) / 1.5 / c_t, -1, 0], atol=1e-6)

    def test_equal_indices_have_no_effect(self):
        text = 'type = "dielectric", interior_ior = 1.3, exterior_ior = 1.3'
        self.assertEqual(list(self.value(HEAD + SKY + slab(text))), [1, 2, 4])
        self.assertEqual([node["path"] for node in self.nodes(HEAD + SKY + slab(text))], ["", "T", "TT"])

    def test_beer_lambert(self):
        text = 'type = "dielectric", interior_ior = 1, exterior_ior = 1, absorption = [0, 0.5, 2]'
        self.near(self.value(HEAD + SKY + slab(text)), [1, 2 * math.exp(-1), 4 * math.exp(-4)])

    def test_infinite_absorbing_segment_is_black(self):
        text = 'type = "dielectric", interior_ior = 1, exterior_ior = 1, absorption = [0, 0.5, 2]'
        self.near(self.value(HEAD + SKY + FLOOR + f"material = {{ {text} }}\n"), [1, 0, 0])
        limited = HEAD + integrator("max_depth = 0") + SKY
        self.near(self.value(limited + slab(text)), [1, 0, 0])

    def test_exterior_absorption(self):
        text = 'type = "dielectric", interior_ior = 1, exterior_ior = 1, exterior_absorption = [0, 0.5, 2]'
        # The camera's own segment does not absorb. Behind the box the ray is outside, and its
        # segment is infinite.
        self.near(self.value(HEAD + SKY + slab(text)), [1, 0, 0])

    def test_whitted_branches(self):
        text = 'type = "whitted", k_refl = 0.25, k_refr = [0.5, 0.25, 1]'
        by_path = {node["path"]: node for node in self.nodes(HEAD + SKY + slab(text))}
        self.near(by_path["R"]["throughput"], [0.25] * 3)
        self.near(by_path["T"]["throughput"], [0.5, 0.25, 1])
        self.near(by_path["TT"]["throughput"], [0.25, 0.0625, 1])

    def test_total_internal_reflection(self):
        # Inside the box at 60 degrees, beyond the critical angle of 41.8 degrees.
        head = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 0], target = [1.7320508, 1, 0] }\n'
        box = slab('type = "whitted", k_refl = 0.25, k_refr = 0.5')
        nodes = self.nodes(head + integrator("max_depth = 1") + SKY + box)
        self.assertEqual([node["path"] for node in nodes], ["", "R", "RR"])
        self.near(nodes[1]["throughput"], [0.75] * 3)
        nodes = self.nodes(head + integrator("max_depth = 1") + SKY + slab('type = "dielectric"'))
        self.assertEqual([node["path"] for node in nodes], ["", "R", "RR"])
        self.near(nodes[1]["throughput"], [1] * 3)

    def test_tree_adds_up_to_the_pixel(self):
        head = film(9, 9) + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 2, 5], target = [0, 0.5, 0] }\n'
        lamps = SKY + '[[light]]\ntype = "point"\nposition = [2, 5, 3]\nintensity = 40\n[[light]]\ntype = "ambient"\nradiance = 0.1\n'
        ball = '[[shape]]\ntype = "sphere"\nmaterial = { type = "dielectric", absorption = [0.1, 0.2, 0.3] }\n'
        under = '[[shape]]\ntype = "plane"\ntransform = [{ rotate = { axis = [1, 0, 0], degrees = -90 } }, { translate = [0, -1, 0] }]\n'
        text = under + 'material = { type = "whitted", k_d = 0.3, k_refl = 0.2 }\n' + ball
        for x, y in ((4, 4), (4, 5), (2, 7), (0, 0)):
            nodes = self.nodes(head + lamps + text, x, y)
            total = sum(np.array(node["throughput"]) * np.array(node["local"]) for node in nodes)
            self.near(self.value(head + lamps + text, x, y), total)
            for node in nodes:
                if node["shape"] == 0:
                    self.near(np.sum([light["value"] for light in node["lights"]], axis=0), node["local"])


class Bodies(Case):
    """Dielectrics with priorities, compared with interfaces that give the media of both sides."""

    GLASS = "interior_ior = 1.5, absorption = [0.4, 0.1, 0.2]"
    WATER = "interior_ior = 1.25, absorption = [0.1, 0.1, 0.5]"

    def picture(self, shapes, shadows):
        scene = film(24, 18) + '[camera]\ntype = "perspective"\nlook_at = { origin = [0.3, 0.2, 6], target = [0, 0, 0] }\nfov = 40\n'
        scene += f'[integrator]\ntype = "whitted"\nmax_depth = 20\nshadows = "{shadows}"\n'
        scene += '[[light]]\ntype = "directional"\ndirection = [0.2, -0.3, -1]\nirradiance = 3\n'
        scene += '[[light]]\ntype = "ambient"\nradiance = 0.5\n[[light]]\ntype = "background"\nradiance = [0.3, 0.5, 0.7]\n'
        scene += '[[shape]]\ntype = "rectangle"\ntransform = [{ scale = 9 }, { translate = [0, 0, -3] }]\nmaterial = { type = "matte", reflectance = 0.8 }\n'
        channels, _ = self.render(scene + shapes)
        return np.stack([channels[name] for name in "RGB"], axis=2)

    def ball(self, radius, keys):
        return f'[[shape]]\ntype = "sphere"\nradius = {radius}\nmaterial = {{ type = "dielectric", {keys} }}\n'

    def test_nested_bodies(self):
        for shadows in ("opaque", "filtered"):
            outside = "exterior_ior = 1.5, exterior_absorption = [0.4, 0.1, 0.2]"
            named = self.picture(self.ball(1.5, self.GLASS) + self.ball(0.9, f"{self.WATER}, {outside}"), shadows)
            both = self.ball(1.5, f"{self.GLASS}, priority = 1") + self.ball(0.9, f"{self.WATER}, priority = PRIORITY")
            ranked = self.picture(both.replace("PRIORITY", "2"), shadows)
            self.near(ranked, named, rel=1e-4, atol=1e-4)
            # With a lower priority the water is ignored; with an equal one too, because it is the
            # second in the document.
            alone = self.picture(self.ball(1.5, self.GLASS), shadows)
            for priority in ("0", "1"):
                self.near(self.picture(both.replace("PRIORITY", priority), shadows), alone, rel=1e-4, atol=1e-3)
            self.assertGreater(np.abs(alone - ranked).max(), 0.05)

    def test_overlapping_blocks(self):
        """Glass from -1 to 0.5 and water from 0 to 1, compared with the three remaining interfaces.
        """

        def block(low, high, keys):
            steps = f"[{{ scale = [50, 50, {(high - low) / 2}] }}, {{ translate = [0, 0, {(high + low) / 2}] }}]"
            return f'[[shape]]\ntype = "box"\ntransform = {steps}\nmaterial = {{ type = "dielectric", {keys} }}\n'

        def pane(z, keys):
            steps = f"[{{ scale = 50 }}, {{ translate = [0, 0, {z}] }}]"
            return f'[[shape]]\ntype = "rectangle"\ntransform = {steps}\nmaterial = {{ type = "dielectric", {keys} }}\n'

        for shadows in ("opaque", "filtered"):
            for glass, water, meet in ((9, 4, 0.5), (4, 9, 0.0)):
                found = block(-1, 0.5, f"{self.GLASS}, priority = {glass}") + block(0, 1, f"{self.WATER}, priority = {water}")
                middle = pane(meet, f"{self.GLASS}, exterior_ior = 1.25, exterior_absorption = [0.1, 0.1, 0.5]")
                last = pane(-1, "interior_ior = 1, exterior_ior = 1.5, exterior_absorption = [0.4, 0.1, 0.2]")
                expected = self.picture(pane(1, self.WATER) + middle + last, shadows)
                self.near(self.picture(found, shadows), expected, rel=1e-4, atol=1e-5)

    def test_a_camera_inside(self):
        """A camera ray starts in no medium; the medium is known from the first interface on."""
        scene = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 0], target = [0, 0, -1] }\n'
        sky = '[[light]]\ntype = "background"\nradiance = 1\n'
        # (1 - R) eta^2 through one interface; the reflected share R stays inside, at each bounce.
        found = self.value(scene + '[integrator]\ntype = "whitted"\nmax_depth = 30\n' + sky + self.ball(1, "interior_ior = 1.5, priority = 3"))
        self.near(found, [2.25] * 3, rel=1e-5)

    def test_refused(self):
        scene = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n'
        self.refuse(scene + self.ball(1, "priority = 1, exterior_ior = 1.2"), "scene", "exterior_ior")
        self.refuse(scene + self.ball(1, "priority = 70000"), "scene", "priority")
        glass = '{ type = "dielectric", priority = 1 }'
        self.refuse(scene + f'[[shape]]\ntype = "sphere"\nmaterial = {{ type = "two_sided", front = {glass}, back = {glass} }}\n', "scene", "part of another")
        group = f'[[group.g.shape]]\ntype = "sphere"\nmaterial = {glass}\n[[shape]]\ntype = "instance"\ngroup = "g"\n'
        self.refuse(scene + group, "scene", "all instances")
        self.refuse(scene + 65 * self.ball(1, "priority = 1"), "scene", "at most 64")


if __name__ == "__main__":
    unittest.main()
