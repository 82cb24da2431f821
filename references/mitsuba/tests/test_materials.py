"""Metals, thin dielectrics, emissive and composite materials (model §8)."""

import math
import os
import tempfile
import unittest

import numpy as np

from support import DOWN, FLOOR, Case, film, write_exr
from whitstone_mitsuba.materials import METALS
from whitstone_mitsuba.runtime import mi
from whitstone_mitsuba.shaders import diffuse_transmittance

HEAD = film() + DOWN
SKY = '[[light]]\ntype = "background"\nradiance = [1, 2, 4]\n'
POINT = '[[light]]\ntype = "point"\nposition = [3, 4, 0]\nintensity = [25, 50, 75]\n'
# From 45 degrees onto the origin.
OBLIQUE = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [5, 5, 0], target = [0, 0, 0], up = [0, 0, 1] }\n'


def floor(text):
    return FLOOR + f"material = {{ {text} }}\n"


def pane(height, text):
    """An infinite plane at a height, facing up."""
    turn = "{ rotate = { axis = [1, 0, 0], degrees = -90 } }"
    return f'[[shape]]\ntype = "plane"\ntransform = [{turn}, {{ translate = [0, {height}, 0] }}]\nmaterial = {{ {text} }}\n'


class Conductors(Case):
    def test_normal_incidence(self):
        value = self.value(HEAD + SKY + floor('type = "conductor", eta = [0.2, 1, 3], k = [4, 2, 0], tint = 0.5'))
        self.near(value, 0.5 * np.array([16.64 / 17.44, 2 * 0.5, 4 * 0.25]))

    def test_oblique(self):
        eta, k = 0.5, 2.0
        n2, s2, c = (eta + 1j * k) ** 2, 0.5, math.sqrt(0.5)
        g = np.sqrt(n2 - s2)
        expected = (abs((c - g) / (c + g)) ** 2 + abs((n2 * c - g) / (n2 * c + g)) ** 2) / 2
        nodes = self.nodes(OBLIQUE + SKY + floor(f'type = "conductor", eta = {eta}, k = {k}'))
        self.near(nodes[1]["throughput"], [expected] * 3)

    def test_metals_are_those_of_mitsuba(self):
        for name, (eta, k) in METALS.items():
            table = {"Ni": "Ni_palik"}.get(name, name)
            found = mi.traverse(mi.load_dict({"type": "conductor", "material": table}))
            self.near(np.array(found["eta.value"]).ravel(), eta, rel=0, atol=6e-6)
            self.near(np.array(found["k.value"]).ravel(), k, rel=0, atol=6e-6)

    def test_bad_numbers(self):
        self.refuse(HEAD + floor('type = "conductor", eta = 0, k = 1'), "scene", "eta")
        self.refuse(HEAD + floor('type = "conductor", metal = "Zn"'), "scene", "metal")
        self.refuse(HEAD + floor('type = "conductor", metal = "Au", k = 1'), "scene", "metal")


class Panes(Case):
    def test_both_faces_together(self):
        by_path = {node["path"]: node for node in self.nodes(HEAD + SKY + pane(1, 'type = "thin_dielectric", tint = [1, 0.5, 0]'))}
        self.near(by_path["R"]["throughput"], [0.08 / 1.04] * 3)
        self.near(by_path["T"]["throughput"], np.array([1, 0.5, 0]) * 0.96 / 1.04)

    def test_a_ray_stays_in_its_medium(self):
        """In a box of absorbing glass, the segment behind a pane absorbs as well."""
        text = 'type = "dielectric", interior_ior = 1, exterior_ior = 1, absorption = [0, 0.5, 2]'
        box = f'[[shape]]\ntype = "box"\nmaterial = {{ {text} }}\n'
        clear = pane(0, 'type = "thin_dielectric", interior_ior = 1')
        self.near(self.value(HEAD + SKY + box + clear), [1, 2 * math.exp(-1), 4 * math.exp(-4)])


class Emission(Case):
    def test_it_is_visible_and_lights_nothing(self):
        glow = pane(1, 'type = "emissive", radiance = [1, 2, 3]')
        self.near(self.value(HEAD + SKY + POINT + glow), [1, 2, 3])
        self.near(self.value(HEAD + POINT + pane(-1, 'type = "emissive", radiance = 5') + floor('type = "matte"')), self.value(HEAD + POINT + FLOOR))

    def test_it_is_seen_in_a_mirror(self):
        glow = '[[shape]]\ntype = "plane"\ntransform = [{ rotate = { axis = [1, 0, 0], degrees = 90 } }, { translate = [0, 9, 0] }]\n'
        glow += 'material = { type = "emissive", radiance = [1, 2, 3] }\n'
        self.near(self.value(HEAD + glow + floor('type = "mirror", reflectance = 0.5')), [0.5, 1, 1.5])

    def test_it_lies_over_other_materials(self):
        under = '{ type = "phong", k_d = 0.1, k_s = 0.2 }'
        plain = self.value(HEAD + POINT + FLOOR + f"material = {under}\n")
        self.near(self.value(HEAD + POINT + floor(f'type = "emissive", radiance = 0.5, material = {under}')), plain + 0.5)
        shared = f"[material.plastic]\n{under[1:-1].replace(', ', chr(10))}\n"
        self.near(self.value(HEAD + POINT + floor('type = "emissive", radiance = 0.5, material = "plastic"') + shared), plain + 0.5)

    def test_a_material_must_not_contain_itself(self):
        shared = '[material.a]\ntype = "emissive"\nmaterial = "b"\n[material.b]\ntype = "emissive"\nmaterial = "a"\n'
        self.refuse(HEAD + FLOOR + 'material = "a"\n' + shared, "scene", "contains itself")


class ReflectionMaps(Case):
    # Red grows with x, from 0 at -1 to 1 at 1.
    RAMP = '{ type = "gradient", scale = 0.5, offset = 0.5, a = 0, b = [1, 0, 0], wrap = "clamp" }'

    def seen(self, inner, map_=f"radiance = {RAMP}", more=""):
        """A ray along (3, -4, 0)/5 onto the floor, reflected to (3, 4, 0)/5."""
        head = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [-3, 4, 0], target = [0, 0, 0] }\n'
        return head + SKY + more + floor(f'type = "reflection_map", {map_}, material = {inner}')

    def test_reflections_are_looked_up(self):
        mirror = self.seen('{ type = "mirror", reflectance = 0.5 }')
        self.near(self.value(mirror), [0.4, 0, 0], atol=1e-6)
        self.assertEqual([node["path"] for node in self.nodes(mirror)], [""])

    def test_what_is_not_native_is_listed(self):
        """The lookup is a formula of the driver, and textures of the map are listed too."""
        _, answer = self.render(self.seen('{ type = "mirror" }'))
        kinds = {entry["type"]: entry["twin"] for entry in answer["hosted"]}
        self.assertEqual((kinds["reflection_map"], kinds["pattern"]), ("formula", "hosted"))
        _, answer = self.render(self.seen('{ type = "mirror" }', "radiance = 1"))
        self.assertNotIn("pattern", {entry["type"] for entry in answer["hosted"]})

    def test_the_rest_is_traced(self):
        pane = self.seen('{ type = "thin_dielectric" }', "radiance = [5, 0, 0]")
        self.assertEqual([node["path"] for node in self.nodes(pane)], ["", "T"])
        traced = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [-3, 4, 0], target = [0, 0, 0] }\n' + SKY
        through = {node["path"]: node for node in self.nodes(traced + floor('type = "thin_dielectric"'))}
        sky = self.value(traced + floor('type = "mirror"'))
        shares = [np.array(through[path]["throughput"]) for path in "RT"]
        self.near(self.value(pane), shares[0] * [5, 0, 0] + shares[1] * sky)

    def test_bumps_bend_what_is_looked_up(self):
        mapped = f'{{ type = "reflection_map", radiance = {self.RAMP}, material = {{ type = "mirror", reflectance = 0.5 }} }}'
        head = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [-3, 4, 0], target = [0, 0, 0] }\n'
        n = np.array([0.25, 1, 0]) / np.hypot(0.25, 1)
        v = np.array([-0.6, 0.8, 0])
        r = 2 * n.dot(v) * n - v
        bent = head + SKY + floor(f'type = "bump", vector_map = [1, 0.5, 0.5], scale = 0.25, material = {mapped}')
        self.near(self.value(bent), [0.25 * (1 + r[0]), 0, 0], atol=1e-6)

    def test_glossy_reflections_are_means(self):
        inner = '{ type = "glossy", exponent = 200, samples = 3 }'
        self.near(self.value(self.seen(inner, "radiance = [0.5, 1, 2]")), [0.5, 1, 2])
        traced = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [-3, 4, 0], target = [0, 0, 0] }\n' + floor(f"{inner[1:-1]}")
        sky = f'[[light]]\ntype = "environment"\nradiance = {self.RAMP}\n'
        self.near(self.value(self.seen(inner)), self.value(traced + sky), atol=1e-6)

    def test_a_mix_with_a_traced_mirror(self):
        mapped = '{ type = "reflection_map", radiance = 8, material = { type = "mirror" } }'
        mixed = floor(f'type = "mix", weight = 0.25, a = {mapped}, b = {{ type = "mirror" }}')
        sky = self.value(HEAD + SKY + floor('type = "mirror"'))
        self.near(self.value(HEAD + SKY + mixed), 0.75 * 8 + 0.25 * sky)

    def test_a_map_is_a_colour_a_texture_or_a_cube(self):
        self.refuse(self.seen('{ type = "mirror" }', "radiance = -1"), "scene", "radiance")
        self.refuse(self.seen('{ type = "mirror" }', "radiance = 1, faces = {}"), "scene", "faces")
        self.refuse(HEAD + floor('type = "reflection_map", material = { type = "mirror" }'), "scene", "radiance")
        self.refuse(HEAD + floor('type = "reflection_map", radiance = 1'), "scene", "material")


class Composites(Case):
    AMBIENT = '[[light]]\ntype = "ambient"\nradiance = 4\n'

    def test_a_mask_shows_what_is_behind(self):
        net = pane(1, 'type = "mask", opacity = [0, 0.25, 1], material = { type = "matte", reflectance = 0.5 }')
        self.near(self.value(HEAD + SKY + self.AMBIENT + net), [1, 0.75 * 2 + 0.5, 2])
        nodes = self.nodes(HEAD + SKY + self.AMBIENT + net)
        self.assertEqual([node["path"] for node in nodes], ["", "T"])

    def test_a_pane_with_holes(self):
        by_path = {node["path"]: node for node in self.nodes(HEAD + SKY + pane(1, 'type = "mask", opacity = 0.5, material = { type = "thin_dielectric", tint = 0.5 }'))}
        self.near(by_path["R"]["throughput"], [0.5 * 0.08 / 1.04] * 3)
        self.near(by_path["T"]["throughput"], [0.5 + 0.25 * 0.96 / 1.04] * 3)

    def test_light_goes_through_holes(self):
        lamp = '[[light]]\ntype = "point"\nposition = [0, 4, 0]\nintensity = 10\n'
        side = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [3, 0.3, 0], target = [0, 0, 0] }\n'
        net = pane(1, 'type = "mask", opacity = [0, 0.25, 1], material = { type = "mirror" }')
        bare = self.value(side + lamp + FLOOR)
        self.near(self.value(side + lamp + FLOOR + net), bare * [1, 0.75, 0], rel=1e-5)
        off = '[integrator]\ntype = "whitted"\nshadows = "none"\n'
        self.near(self.value(side + off + lamp + FLOOR + net), bare)

    def test_refractive_materials_cannot_have_holes(self):
        self.refuse(HEAD + floor('type = "mask", material = { type = "dielectric" }'), "scene", "holes")
        self.refuse(HEAD + floor('type = "mask"'), "scene", "material")

    def test_a_mix(self):
        text = 'type = "mix", weight = [0, 0.25, 1], a = { type = "matte", reflectance = 0.5 }, b = { type = "mirror" }'
        self.near(self.value(HEAD + SKY + self.AMBIENT + floor(text)), [2, 0.75 * 2 + 0.25 * 2, 4])
        text = 'type = "mix", weight = 0.25, a = { type = "mirror" }, b = { type = "dielectric" }'
        by_path = {node["path"]: node for node in self.nodes(HEAD + SKY + pane(1, text))}
        self.near(by_path["R"]["throughput"], [0.75 + 0.25 * 0.04] * 3)
        self.near(by_path["T"]["throughput"], [0.25 * 0.96 / 2.25] * 3)
        text = 'type = "mix", a = { type = "thin_dielectric" }, b = { type = "dielectric" }'
        self.refuse(HEAD + floor(text), "scene", "refracts")

    def test_two_sides(self):
        text = 'type = "two_sided", front = { type = "emissive", radiance = 3 }, back = { type = "dielectric", interior_ior = 1, absorption = 1 }'
        self.near(self.value(HEAD + SKY + floor(text)), [3, 3, 3])
        under = floor(text).replace("degrees = -90", "degrees = 90")
        self.near(self.value(HEAD + SKY + under), [1, 2, 4])
        # The front is a pane inside the ray's medium; the back is glass, which ends that medium.
        text = 'type = "two_sided", front = { type = "thin_dielectric", interior_ior = 1 }, back = { type = "dielectric", interior_ior = 1 }'
        self.near(self.value(HEAD + SKY + floor(text)), [1, 2, 4])


class Detail(Case):
    """Replaced normals, seen straight from above on a floor with n_s = y."""

    def mirrored(self, text):
        """The direction in which a ray from straight above is reflected."""
        ball = '[[shape]]\ntype = "sphere"\nradius = 50\nmaterial = { type = "emissive" }\n'
        nodes = self.nodes(HEAD + floor(text) + ball)
        self.assertEqual([node["path"] for node in nodes], ["", "R"])
        return np.array(nodes[1]["p"]) / 50

    def test_colours_are_parts_of_the_normal(self):
        # Along x, then along y x x = -z, then both.
        text = 'type = "normal_map", map = {}, material = {{ type = "mirror" }}'
        self.near(self.mirrored(text.format("[0.8, 0.5, 0.9]")), [0.96, 0.28, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(text.format("[0.5, 0.8, 0.9]")), [0, 0.28, -0.96], rel=1e-5, atol=1e-5)
        around = text.format("[0.8, 0.5, 0.9], axis = [0, 0, -2]")
        self.near(self.mirrored(around), [0.96, 0.28, 0], rel=1e-5, atol=1e-5)
        # A normal that faces away from the viewer is ignored.
        self.near(self.mirrored(text.format("[0.5, 0.5, 0]")), [0, 1, 0], rel=1e-5, atol=1e-5)

    def test_a_slope_is_a_normal(self):
        # A block of two voxels along x from 0 to 1: between their middles the height rises by 0.375
        # over half a metre.
        block = '{ type = "solid", size = [2, 1, 1], values = [0, 0.375], wrap = "clamp", mapping = { transform = { translate = [0.5, 0, 0] } } }'
        self.near(self.mirrored(f'type = "bump", height = {block}, material = {{ type = "mirror" }}'), [-0.96, 0.28, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(f'type = "bump", scale = -1, height = {block}, material = {{ type = "mirror" }}'), [0.96, 0.28, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored('type = "bump", height = 0.3, material = { type = "mirror" }'), [0, 1, 0], rel=1e-5, atol=1e-5)
        second = '{ type = "checker", mapping = { uv_set = 1 } }'
        self.refuse(HEAD + floor(f'type = "bump", height = {second}, material = {{ type = "mirror" }}'), "scene", "height")

    def test_a_slope_over_uv_is_a_normal(self):
        """The height rises by 0.375 over u from 0 to 1, which is from x = -1 to 1 on the square."""
        block = '{ type = "solid", size = [2, 1, 1], values = [0, 0.375], wrap = "clamp", mapping = { projection = "uv", transform = { translate = [0, 0.5, 0] } } }'
        turn = "{ rotate = { axis = [1, 0, 0], degrees = -90 } }"
        for scale, more in ((1, 'scale = 2'), (2, 'scale = 4'), (0.5, '')):
            square = f'[[shape]]\ntype = "rectangle"\ntransform = [{{ scale = {scale} }}, {turn}]\n'
            ball = '[[shape]]\ntype = "sphere"\nradius = 50\nmaterial = { type = "emissive" }\n'
            bump = f'material = {{ type = "bump", height = {block}, {more + ", " if more else ""}material = {{ type = "mirror" }} }}\n'
            nodes = self.nodes(HEAD + square + bump + ball)
            self.near(np.array(nodes[1]["p"]) / 50, [-0.96, 0.28, 0], rel=1e-4, atol=1e-4)
        # In single precision, the slope over so small a step would be wrong by 4 %.
        with tempfile.TemporaryDirectory() as folder:
            write_exr(os.path.join(folder, "h.exr"), {"Y": np.array([[0, 0.375]], dtype=np.float32)})
            image = '{ type = "image", file = "h.exr", wrap = "clamp" }'
            square = f'[[shape]]\ntype = "rectangle"\ntransform = [{turn}]\n'
            fine = f'material = {{ type = "bump", height = {image}, scale = 2, step = 1e-6, material = {{ type = "mirror" }} }}\n'
            nodes = self.nodes(HEAD + square + fine + ball, base=folder)
            self.near(np.array(nodes[1]["p"]) / 50, [-0.96, 0.28, 0], rel=1e-4, atol=1e-4)
        cone = '[[shape]]\ntype = "cone"\n' + bump
        self.refuse(HEAD + cone, "unsupported", "bump map by (u, v)")

    def test_vectors_are_added(self):
        text = 'type = "bump", vector_map = {}, material = {{ type = "mirror" }}'
        # The normal (0.25, 0.5, 0) is half way between straight up and the ray, and tan of half the
        # angle is 1/2.
        sideways = text.format("[0.625, 0.25, 0.5]")
        self.near(self.mirrored(sideways), [0.8, 0.6, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(text.format("[0.5625, 0.5, 0.5], scale = 4")), [0.8, 0.6, 0], rel=1e-5, atol=1e-5)
        # Along x, y x x = -z and the normal; x across the axis -z is the tangent, too.
        own = '[0.75, 0.5, 0.5], space = "tangent"'
        self.near(self.mirrored(text.format(own)), [0.8, 0.6, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(text.format('[0.5, 0.75, 0.5], space = "tangent"')), [0, 0.6, -0.8], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(text.format(f"{own}, axis = [0, 0, -2]")), [0.8, 0.6, 0], rel=1e-5, atol=1e-5)
        self.near(self.mirrored(text.format(f"{own}, tangent = [0, 7, 3]")), [0, 0.6, 0.8], rel=1e-5, atol=1e-5)
        # No offset, a normal that faces away, and a zero normal.
        for colour in ("0.5", "[0.5, 0, 0.5], scale = 2", "[0.5, 0, 0.5]"):
            self.near(self.mirrored(text.format(colour)), [0, 1, 0], rel=1e-5, atol=1e-5)
        for more in ("step = 1", "axis = [0, 1, 0]", "height = 1"):
            self.refuse(HEAD + floor(text.format(f"0.5, {more}")), "scene", more.split()[0])
        self.refuse(HEAD + floor('type = "bump", height = 0.5, space = "world", material = { type = "mirror" }'), "scene", "space")

    def test_light_on_a_slope(self):
        lamp = '[[light]]\ntype = "directional"\ndirection = [0.6, -0.8, 0]\nirradiance = 3\n'
        text = 'type = "normal_map", map = [0.2, 0.5, 0.9], material = { type = "matte", reflectance = 0.5 }'
        # n' = (-0.6, 0.8, 0) faces the light.
        self.near(self.value(HEAD + lamp + floor(text)), 3 * 0.5 / math.pi)


class Glossy(Case):
    BALL = '[[shape]]\ntype = "sphere"\nradius = 50\nmaterial = { type = "emissive" }\n'

    def directions(self, text, scene=HEAD):
        """The directions of the reflections of a ray from straight above."""
        nodes = self.nodes(scene + floor(text) + self.BALL)
        paths = [node["path"] for node in nodes if node["path"] not in ("", "T")]
        self.assertEqual(paths, [f"R{number:02}" for number in range(len(paths))])
        return np.array([node["p"] for node in nodes if node["path"].startswith("R")]) / 50, nodes

    def test_directions(self):
        # X and Y where n = r = y: the first turned from (0.8, -0.6, 0), across (0.48, 0.64, 0.6),
        # by hand.
        x, z = np.array([40, 0, 9]) / 41, np.array([9, 0, -40]) / 41
        cosine = 0.75 ** (1 / 8)
        sine = math.sqrt((1 - cosine**2) / 2)
        expected = [sine * (a * x + b * z) + cosine * np.array([0, 1, 0]) for b in (-1, 1) for a in (-1, 1)]
        found, nodes = self.directions('type = "glossy", exponent = 7, samples = 2, reflectance = [1, 0.5, 0]')
        self.near(found, expected, rel=1e-5, atol=1e-5)
        for node in nodes[1:]:
            self.near(node["throughput"], [0.25, 0.125, 0])
        # About a replaced normal, and weighted by the opacity.
        text = 'type = "{}", {}material = {{ type = "glossy", exponent = 7, samples = 2 }}'
        found, nodes = self.directions(text.format("mask", "opacity = 0.5, "))
        self.near(found, expected, rel=1e-5, atol=1e-5)
        self.near(nodes[1]["throughput"], [0.125] * 3)
        found, _ = self.directions(text.format("normal_map", "map = [0.8, 0.5, 0.9], "))
        self.near(found @ [0.96, 0.28, 0], [cosine] * 4, rel=1e-5)

    def test_one_sample_is_a_mirror(self):
        nodes = self.nodes(OBLIQUE + floor('type = "glossy", samples = 1, reflectance = 0.5') + self.BALL)
        mirrored = self.nodes(OBLIQUE + floor('type = "mirror", reflectance = 0.5') + self.BALL)
        self.assertEqual([node["path"] for node in nodes], ["", "R"])
        self.near(nodes[1]["p"], mirrored[1]["p"], rel=1e-5, atol=1e-5)
        self.near(nodes[1]["throughput"], [0.5] * 3)

    def test_directions_below_the_surface_are_dropped(self):
        """At 45 degrees, with a lobe so broad that some directions point below the surface."""
        scene = OBLIQUE + '[integrator]\ntype = "whitted"\nmax_depth = 2\n' + SKY + floor('type = "glossy", samples = 8, exponent = 0.5')
        there = len(self.nodes(scene)) - 1
        self.assertTrue(40 < there < 64, there)
        self.near(self.value(scene), np.array([1, 2, 4]) * there / 64)

    def test_together_with_a_mirror(self):
        """An image equals the sums over the trees of its pixels."""
        look = '[camera]\ntype = "perspective"\nlook_at = { origin = [0, 2, 6], target = [0, 0.5, 0] }\n[integrator]\ntype = "whitted"\nmax_depth = 2\n'
        ball = '[[shape]]\ntype = "sphere"\nradius = 1\nmaterial = { type = "mirror", reflectance = 0.9 }\n'
        glossy = '{ type = "glossy", samples = 2, reflectance = [0.3, 0.4, 0.5] }'
        table = floor(f'type = "mix", a = {{ type = "matte" }}, b = {glossy}')
        scene = film(6, 6) + look + SKY + POINT + table + ball
        channels, _ = self.render(scene)
        for x, y in ((3, 3), (2, 4), (3, 5), (0, 4)):
            nodes = self.nodes(scene, x, y)
            self.assertGreater(len(nodes), 1)
            sum_ = np.sum([np.multiply(node["throughput"], node["local"]) for node in nodes], axis=0)
            self.near([channels[name][y, x] for name in "RGB"], sum_, rel=1e-5)

    def test_two_sided(self):
        text = 'type = "two_sided", front = {{ type = "{}" }}, back = {{ type = "{}" }}'
        found, _ = self.directions(text.format("glossy", "mirror"))
        self.assertEqual(len(found), 16)
        found, nodes = self.directions(text.format("mirror", "glossy"))
        self.assertEqual(len(found), 1)
        self.near(nodes[1]["throughput"], [1] * 3)

    def test_bad_numbers(self):
        self.refuse(HEAD + floor('type = "glossy", exponent = 0'), "scene", "exponent")
        self.refuse(HEAD + floor('type = "glossy", samples = 9'), "scene", "samples")
        self.refuse(HEAD + floor('type = "mix", a = { type = "glossy" }, b = { type = "mirror" }'), "scene", "glossy")
        rules = '[integrator]\ntype = "whitted"\nmax_depth = {}\n'
        self.refuse(HEAD + rules.format(7) + floor('type = "glossy"'), "scene", "16^7")
        self.value(HEAD + rules.format("9\nmin_contribution = 1e-7") + SKY + floor('type = "glossy"'))


class Rough(Case):
    BALL = Glossy.BALL

    def test_a_rough_metal_is_a_weighted_glossy_mirror(self):
        lobe = "exponent = 7, samples = 2"
        glossy = self.nodes(OBLIQUE + floor(f'type = "glossy", {lobe}') + self.BALL)
        rough = self.nodes(OBLIQUE + floor(f'type = "rough", {lobe}, material = {{ type = "conductor", eta = [0.2, 1, 3], k = [4, 2, 0] }}') + self.BALL)
        smooth = self.nodes(OBLIQUE + floor('type = "conductor", eta = [0.2, 1, 3], k = [4, 2, 0]') + self.BALL)
        self.assertEqual([node["path"] for node in rough], [node["path"] for node in glossy])
        self.assertEqual(len(rough), 5)
        for found, expected in zip(rough[1:], glossy[1:]):
            self.near(found["p"], expected["p"], rel=1e-5, atol=1e-4)
            self.near(found["throughput"], np.array(smooth[1]["throughput"]) / 4)

    def test_glass_spreads_both_rays(self):
        """From straight above, transmitted rays leave a plane in the lobe about -y, whose frame is
        that of the normal -y.
        """
        head = OBLIQUE.replace("origin = [5, 5, 0]", "origin = [0, 5, 0]") + self.BALL

        def of(inner):
            return self.nodes(head + pane(1, f'type = "rough", exponent = 7, samples = 2, material = {{ {inner} }}'))

        nodes = of('type = "dielectric", interior_ior = 2')
        paths = [node["path"] for node in nodes]
        self.assertEqual(paths, ["", "R00", "R01", "R02", "R03", "T00", "T01", "T02", "T03"])
        a, b, n = np.array([0.8, -0.6, 0]), np.array([0.48, 0.64, 0.6]), np.array([0.0, -1, 0])
        m = b + n
        x = a - 2 * a.dot(m) / m.dot(m) * m
        y = np.cross(n, x)
        cosine = 0.75 ** (1 / 8)
        sine = math.sqrt((1 - cosine**2) / 2)
        expected = [sine * (i * x + j * y) + cosine * n for j in (-1, 1) for i in (-1, 1)]
        for node, direction in zip(nodes[5:], expected):
            way = np.array(node["p"]) - [0, 1, 0]
            self.near(way / np.linalg.norm(way), direction, rel=1e-5, atol=1e-5)
            self.near(node["throughput"], [8 / 9 / 4 / 4] * 3)
        for node in nodes[1:5]:
            self.near(node["throughput"], [1 / 9 / 4] * 3)
        # The same directions through a pane, whose rays keep their radiance.
        through = of('type = "thin_dielectric", tint = 0.5')[5:]
        for node, same in zip(through, nodes[5:]):
            self.near(node["p"], same["p"], rel=1e-5, atol=1e-4)
            self.near(node["throughput"], [0.5 * 0.96 / 1.04 / 4] * 3)

    def test_other_terms_are_those_of_the_material(self):
        ambient = '[[light]]\ntype = "ambient"\nradiance = 4\n'
        text = 'type = "mix", weight = 0.25, a = { type = "matte", reflectance = 0.5 }, b = { type = "mirror" }'
        rough = floor(f'type = "rough", exponent = 1e4, material = {{ {text} }}')
        self.near(self.value(HEAD + SKY + ambient + rough), self.value(HEAD + SKY + ambient + floor(text)), rel=1e-5)
        filtered = '[integrator]\ntype = "whitted"\nshadows = "filtered"\nmax_depth = 1\n'
        side = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [3, 0.3, 0], target = [0, 0, 0] }\n'
        lamp = '[[light]]\ntype = "point"\nposition = [0, 4, 0]\nintensity = 10\n'
        glass = 'type = "thin_dielectric", tint = [0.2, 0.5, 1]'
        smooth, rough = (self.value(side + filtered + lamp + FLOOR + pane(1, text)) for text in (glass, f'type = "rough", material = {{ {glass} }}'))
        self.near(rough, smooth)

    def test_one_sample_is_the_material(self):
        for inner in ('type = "dielectric"', 'type = "thin_dielectric"', 'type = "mirror"'):
            rough = self.nodes(OBLIQUE + SKY + pane(1, f'type = "rough", samples = 1, material = {{ {inner} }}'))
            self.assertEqual(rough, self.nodes(OBLIQUE + SKY + pane(1, inner)))

    def test_what_cannot_be_rough(self):
        text = 'type = "rough", material = {{ {} }}'
        self.refuse(HEAD + floor(text.format('type = "glossy"')), "scene", "material")
        self.refuse(HEAD + floor(text.format(text.format('type = "mirror"'))), "scene", "material")
        self.refuse(HEAD + floor(text.format('type = "mask", material = { type = "mirror" }')), "scene", "holes")
        self.refuse(HEAD + floor(text.format('type = "dielectric", priority = 1')), "scene", "priority")
        self.refuse(HEAD + floor('type = "rough"'), "scene", "material")
        self.refuse(HEAD + floor('type = "mask", material = { type = "rough", material = { type = "thin_dielectric" } }'), "scene", "holes")
        rules = '[integrator]\ntype = "whitted"\nmax_depth = {}\n'
        glass = floor(text.format('type = "dielectric"').replace("material =", "samples = 2, material =", 1))
        self.refuse(HEAD + rules.format(9) + glass, "scene", "8^9")


class Plastic(Case):
    def fresnel(self, cosine, index):
        behind = math.sqrt(1 - (1 - cosine**2) / index**2)
        s, p = (cosine - index * behind) / (cosine + index * behind), (index * cosine - behind) / (index * cosine + behind)
        return (s * s + p * p) / 2

    def test_the_diffuse_reflectance(self):
        # Walsh's closed form.
        for m in (1.2, 1.5, 2.0, 3.0):
            walsh = (
                0.5 + (m - 1) * (3 * m + 1) / (6 * (m + 1) ** 2)
                + m * m * (m * m - 1) ** 2 / (m * m + 1) ** 3 * math.log((m - 1) / (m + 1))
                - 2 * m**3 * (m * m + 2 * m - 1) / ((m * m + 1) * (m**4 - 1))
                + 8 * m**4 * (m**4 + 1) / ((m * m + 1) * (m**4 - 1) ** 2) * math.log(m)
            )  # fmt: skip
            self.near(diffuse_transmittance(m), 1 - walsh, rel=1e-13)
            self.near(diffuse_transmittance(1 / m), (1 - walsh) / m**2, rel=1e-13)
        self.near(diffuse_transmittance(1.0), 1, rel=1e-13)
        self.near(diffuse_transmittance(1e4) * 3e4 / 16, 1, rel=1e-2)

    def test_light_on_the_base(self):
        for index, outside in ((1.5, 1.0), (2.4, 1.0), (1.3, 1.5), (1.0, 1.0)):
            text = f'type = "plastic", reflectance = [0.8, 0.4, 0.1], interior_ior = {index}, exterior_ior = {outside}'
            lamp = '[[light]]\ntype = "directional"\ndirection = [0.3, -0.954, 0]\nirradiance = 3\n'
            m, cosine = index / outside, 0.954 / math.hypot(0.3, 0.954)
            passed = (1 - self.fresnel(1, m)) * (1 - self.fresnel(cosine, m)) if m != 1 else 1.0
            expected = np.array([0.8, 0.4, 0.1]) * 3 * cosine * passed / diffuse_transmittance(m) / math.pi
            self.near(self.value(HEAD + lamp + floor(text)), expected, rel=1e-5)
            under = floor(text).replace("degrees = -90", "degrees = 90")
            self.near(self.value(HEAD + lamp + under), expected, rel=1e-5)
            ambient = '[[light]]\ntype = "ambient"\nradiance = 4\n'
            self.near(self.value(HEAD + ambient + floor(text)), np.array([0.8, 0.4, 0.1]) * 4 * (1 - self.fresnel(1, m) if m != 1 else 1), rel=1e-5)

    def test_the_coat_reflects(self):
        nodes = self.nodes(OBLIQUE + SKY + floor('type = "plastic"') + Glossy.BALL)
        self.assertEqual([node["path"] for node in nodes], ["", "R"])
        self.near(nodes[1]["throughput"], [self.fresnel(math.sqrt(0.5), 1.5)] * 3, rel=1e-5)
        spread = self.nodes(OBLIQUE + SKY + floor('type = "plastic", samples = 2, exponent = 7') + Glossy.BALL)
        glossy = self.nodes(OBLIQUE + SKY + floor('type = "glossy", samples = 2, exponent = 7') + Glossy.BALL)
        self.assertEqual([node["path"] for node in spread], ["", "R00", "R01", "R02", "R03"])
        for a, b in zip(spread[1:], glossy[1:]):
            self.near(a["p"], b["p"], rel=1e-5, atol=1e-4)
            self.near(a["throughput"], np.array(nodes[1]["throughput"]) / 4)

    def test_textures_of_the_base(self):
        lamp = '[[light]]\ntype = "directional"\ndirection = [0.3, -0.954, 0]\nirradiance = 3\n'
        half = self.value(HEAD + lamp + floor('type = "plastic", reflectance = { type = "noise", a = 0.5, b = 0.5 }'))
        self.near(half, self.value(HEAD + lamp + floor('type = "plastic"')), rel=1e-5)

    def test_bad_numbers(self):
        for keys in ("reflectance = 1.5", "interior_ior = 0", "exterior_ior = -1", "samples = 9", "exponent = 0"):
            self.refuse(HEAD + floor(f'type = "plastic", {keys}'), "scene", keys.split()[0])


class ReplacedMaterials(Case):
    def test_instances_replace_materials_from_the_innermost(self):
        glow = '[material.{}]\ntype = "emissive"\nradiance = {}\n'
        shared = "".join(glow.format(name, number) for name, number in (("one", 1), ("two", 2), ("three", 3)))
        floor = FLOOR.replace("[[shape]]", "[[group.inner.shape]]") + 'material = "one"\n'
        middle = '[[group.outer.shape]]\ntype = "instance"\ngroup = "inner"\n'
        place = '[[shape]]\ntype = "instance"\ngroup = "outer"\n'

        def seen(inside, outside):
            given = [f"materials = {{ {keys} }}\n" if keys else "" for keys in (inside, outside)]
            return self.value(HEAD + shared + floor + middle + given[0] + place + given[1])[0]

        self.assertEqual(seen("", ""), 1)
        self.assertEqual(seen('one = "two"', ""), 2)
        self.assertEqual(seen("", 'one = "three"'), 3)
        self.assertEqual(seen('one = "two"', 'one = "three"'), 2)
        self.assertEqual(seen('one = "two"', 'two = "three"'), 3)
        self.assertEqual(seen("", 'one = { type = "emissive", radiance = 5 }'), 5)
        self.assertEqual(seen('one = { type = "emissive", radiance = 5 }', 'one = "two"'), 5)
        self.assertEqual(seen("", 'two = "three"'), 1)
        scene = HEAD + shared + floor + middle + place
        self.refuse(scene + 'materials = { four = "one" }\n', "scene", "no material is called 'four'")
        self.refuse(scene + 'materials = { one = "four" }\n', "scene", "no material is called 'four'")
        self.refuse(scene + "materials = 3\n", "scene", "materials")


class FilteredShadows(Case):
    def lit(self, shape, more=""):
        """The transmittance of light onto a floor from straight above."""
        lamp = '[[light]]\ntype = "point"\nposition = [0, 4, 0]\nintensity = 10\n'
        # Seen from the side, below the shape that attenuates the light.
        side = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [3, 0.3, 0], target = [0, 0, 0] }\n'
        filtered = '[integrator]\ntype = "whitted"\nshadows = "filtered"\n'
        self.assertEqual(list(self.value(side + lamp + FLOOR + shape)), [0, 0, 0])
        return self.value(side + filtered + lamp + FLOOR + shape + more) / self.value(side + lamp + FLOOR)

    def test_glass(self):
        box = '[[shape]]\ntype = "box"\ntransform = [{{ scale = [1, 0.5, 1] }}, {{ translate = [0, 1.5, 0] }}]\nmaterial = {{ {} }}\n'
        found = self.lit(box.format('type = "dielectric", absorption = [0, 1, 2]'))
        self.near(found, 0.96**2 * np.exp([0, -1, -2.0]), rel=1e-5)
        self.near(self.lit(box.format('type = "whitted", k_refr = [1, 0.5, 0]')), [1, 0.25, 0], rel=1e-5)
        self.near(self.lit(pane(1, 'type = "thin_dielectric", tint = [1, 0.5, 0]')), np.array([1, 0.5, 0]) * 0.96 / 1.04, rel=1e-5)
        self.near(self.lit(pane(1, 'type = "emissive", material = { type = "thin_dielectric" }')), [0.96 / 1.04] * 3, rel=1e-5)

    def test_the_transmittance_threshold(self):
        panes = [pane(1 + number, 'type = "whitted", k_refr = 0.1') for number in range(3)]
        self.near(self.lit(panes[0] + panes[1]), [0.01] * 3, rel=1e-5)
        self.assertEqual(list(self.lit("".join(panes))), [0, 0, 0])

    def test_shapes_without_a_shadow(self):
        lamp = '[[light]]\ntype = "point"\nposition = [0, 4, 0]\nintensity = 10\n'
        side = film() + '[camera]\ntype = "perspective"\nlook_at = { origin = [3, 0.3, 0], target = [0, 0, 0] }\n'
        free = self.value(side + lamp + FLOOR)
        dark = 'type = "matte"'
        without = "casts_shadow = false\n"
        for mode in ("opaque", "filtered"):
            head = side + f'[integrator]\ntype = "whitted"\nshadows = "{mode}"\n' + lamp + FLOOR
            self.near(self.value(head + pane(1, dark) + without), free, rel=1e-6)
            self.assertEqual(list(self.value(head + pane(1, dark) + without + pane(2, dark))), [0, 0, 0])
            group = "[[group.g.shape]]" + pane(1, dark).replace("[[shape]]", "")
            place = '[[shape]]\ntype = "instance"\ngroup = "g"\n'
            self.assertEqual(list(self.value(head + group + place)), [0, 0, 0])
            self.near(self.value(head + group + place + without), free, rel=1e-6)
            self.near(self.value(head + group + without + place), free, rel=1e-6)
        self.refuse(side + FLOOR + "casts_shadow = 1\n", "scene", "casts_shadow")

    def test_opaque_surfaces_block_light(self):
        self.assertEqual(list(self.lit(pane(1, 'type = "thin_dielectric"') + pane(2, 'type = "mirror"'))), [0, 0, 0])


if __name__ == "__main__":
    unittest.main()
