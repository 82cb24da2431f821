"""Errors in documents are found, all at once, and what has no twin is named with its place."""

import os
import unittest

from support import BLACK_LIMIT, DOWN, FLOOR, ROOT, Case, film
from whitstone_povray import registry

HEAD = film() + DOWN
SKY = '[[light]]\ntype = "background"\nradiance = 1\n'
SPOT = '[[light]]\ntype = "spot"\nposition = [0, 4, 0]\ntarget = [0, 0, 0]\nintensity = 1\n'
POINT = '[[light]]\ntype = "point"\nposition = [0, 4, 0]\nintensity = 1\n'
MOVING = '[[shape]]\ntype = "sphere"\nmotion = [{ time = 0, transform = [] }, { time = 1, transform = [] }]\n'
BALL = '[[shape]]\ntype = "sphere"\nmaterial = { %s }\n'


class Documents(Case):
    def test_each(self):
        cases = {
            "[film]\nwidth = 0\n" + DOWN: ("film.width", "1 to 65536"),
            film(): ("camera",),
            HEAD.replace("fov = 90", "fov = 180"): ("camera.fov", "between 0 and 180"),
            HEAD.replace("fov = 90", "fov = 9\nwindow = { l = 0, r = 1, b = 0, t = 1 }"): ("together with window",),
            HEAD.replace("fov = 90", "window = { l = 1, r = 1, b = 0, t = 1 }"): ("l < r",),
            HEAD.replace("up = [0, 0, -1]", "up = [0, 1, 0]"): ("parallel",),
            HEAD + "[sampler]\nsamples_per_axis = 2\n": ("sampler.type", "required"),
            HEAD + '[integrator]\ntype = "appel"\nmax_depth = 1\n': ("max_depth", "unknown key"),
            HEAD + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nintensity = -1\n': ("light[0].intensity",),
            HEAD + FLOOR + 'material = "gold"\n': ("'gold'",),
            HEAD + FLOOR + 'material = { type = "matte", reflectance = 1.5 }\n': ("from 0 to 1",),
            HEAD + '[[shape]]\ntype = "box"\ntransform = [{ scale = [1, 0, 1] }]\n': ("invertible",),
            HEAD + '[[shape]]\ntype = "box"\ntransform = [{ scale = 1, translate = [0, 0, 0] }]\n': ("one of",),
            HEAD + '[[shape]]\ntype = "triangle"\nvertices = [[0, 0, 0], [1, 0, 0]]\n': ("3 arrays",),
            HEAD + '[[shape]]\ntype = "instance"\ngroup = "none"\n': ("'none'",),
            HEAD + "[[shape]]\nradius = 3\n": ("shape[0].type",),
            HEAD + FLOOR + "radus = 3\n": ("shape[0].radus", "unknown key"),
            HEAD + "[lihgt]\n": ("did you mean 'light'",),
        }
        for document, words in cases.items():
            with self.subTest(words=words):
                self.refuse(document, "scene", *words)

    def test_all_at_once(self):
        self.refuse(HEAD + FLOOR + "radus = 1\n" + '[[shape]]\ntype = "sphere"\nradius = -1\n', "scene", "radus", "radius")

    def test_what_has_no_twin_is_named_with_its_place(self):
        dark = HEAD + BLACK_LIMIT
        for text, *words in (
            (dark + FLOOR + '[[shape]]\ntype = "gyroid"\n', "shape[1]", "shape type 'gyroid'"),
            (dark + '[[light]]\ntype = "area"\n', "light[0]", "light type 'area'"),
            (dark + FLOOR + 'material = { type = "velvet" }\n', "shape[0].material", "material type 'velvet'"),
            (dark + FLOOR + 'material = { type = "matte", reflectance = { type = "marble" } }\n', "texture type 'marble'"),
            (dark + FLOOR + 'material = { type = "matte", reflectance = { type = "product", factors = [1] } }\n', "texture type 'product'"),
            (dark + FLOOR + 'material = { type = "matte", reflectance = { type = "vertex_color" } }\n', "texture type 'vertex_color'"),
            (dark + FLOOR + 'material = { type = "matte", reflectance = { type = "checker", mapping = { uv_set = 1 } } }\n', "mapping.uv_set"),
            (dark + FLOOR + 'material = { type = "normal_map", tangent = "mesh", strength = 2 }\n', "material type 'normal_map'"),
            (dark + '[[shape]]\ntype = "mesh"\nfile = "a.gltf"\nmesh = 1\nskin = 0\n', "shape[0].file", "glTF"),
            (dark + '[[shape]]\ntype = "mesh"\nfile = "a.glb"\nuv_sets = [0, 1]\n', "shape[0].uv_sets"),
            (HEAD + '[sampler]\ntype = "sobol"\n', "sampler", "'sobol'"),
            (HEAD + '[integrator]\ntype = "photon"\n', "integrator", "'photon'"),
            (HEAD.replace("perspective", "fisheye"), "camera", "'fisheye'"),
            (dark + "[group.g]\n" + FLOOR.replace("shape", "group.g.shape").replace("plane", "knot")
             + '[[shape]]\ntype = "instance"\ngroup = "g"\n', "group.g.shape[0]", "'knot'"),
        ):  # fmt: skip
            with self.subTest(words=words):
                self.refuse(text, "unsupported", *words)

    def test_what_povray_shows_otherwise_is_refused(self):
        dark = HEAD + BLACK_LIMIT
        glass = 'type = "dielectric"'
        for text, *words in (
            (HEAD + SKY + BALL % 'type = "mirror"', "integrator.at_max_depth", "black"),
            (HEAD + BLACK_LIMIT + MOVING, "shape[0].motion", "one time"),
            (HEAD.replace("height = 1\n", 'height = 1\naovs = ["uv"]\n') + BLACK_LIMIT, "film.aovs", "layers"),
            (HEAD.replace("height = 1\n", 'height = 1\npaths = { one = "E D L" }\n') + BLACK_LIMIT, "film.paths", "layers"),
            (HEAD + BLACK_LIMIT + "min_contribution = 0.1\n", "integrator.min_contribution"),
            (HEAD + BLACK_LIMIT + "max_depth = 256\n", "integrator.max_depth", "255"),
            (dark + FLOOR + f"material = {{ {glass} }}\n", "shape[0]", "not closed"),
            (dark + BALL % (glass + ", exterior_absorption = 1"), "exterior_absorption"),
            (dark + BALL % (glass + ", priority = 2"), "priority", "overlap"),
            (dark + BALL % glass + BALL % (glass + ", exterior_ior = 1.2"), "Fresnel"),
            (dark + '[[shape]]\ntype = "triangle"\nvertices = [[0, 0, 0], [1, 0, 0], [0, 0, 1]]\n'
             + 'normals = [[0, 1, 0], [0, 1, 0], [0, 1, 0]]\nmaterial = { type = "mirror" }\n', "shape[0]", "interpolated"),
            # Interpolated normals turn towards light from behind, and an open surface does not
            # block it.
            (dark + '[[shape]]\ntype = "triangle"\nvertices = [[0, 0, 0], [1, 0, 0], [0, 0, 1]]\n'
             + 'normals = [[0, 1, 0], [0, 1, 0], [0, 1, 0]]\n', "shape[0]", "behind"),
            (dark + SPOT + SPOT.replace("[0, 0, 0]", "[9, 0, 0]"), "light[1]", "same place"),
            (dark + SPOT + 'up = [1, 0, 0]\nimage = { type = "checker" }\n', "light[0].image", "no texture"),
            (dark + SPOT + 'up = [1, 0, 0]\nimage = "slide"\n[texture.slide]\ntype = "checker"\n', "light[0].image", "no texture"),
            (dark + '[[light]]\ntype = "area"\nradiance = 1\nfalloff = "none"\n', "light[0]", "light type 'area'"),
            (dark + '[[shape]]\ntype = "heightfield"\nheight = { type = "noise" }\n', "shape[0]", "shape type 'heightfield'"),
            (dark + POINT + SPOT, "light[1]", "same place"),
            (dark + BALL % 'type = "emissive", material = { type = "matte" }', "material.material", "one pigment"),
            (dark + BALL % 'type = "phong", k_s = { type = "checker" }', "k_s", "no texture"),
        ):  # fmt: skip
            with self.subTest(words=words):
                self.refuse(text, "unsupported", *words)

    def test_where_no_branch_can_meet_the_limit_it_does_not_matter(self):
        self.ask("write", HEAD + SKY + FLOOR)

    def test_colours_where_povray_has_numbers_are_rendered_one_by_one(self):
        grey = self.ask("write", HEAD + BALL % 'type = "phong", k_s = 0.3')
        coloured = self.ask("write", HEAD + BALL % 'type = "phong", k_s = [0.1, 0.2, 0.3]')
        self.assertEqual((len(grey["scenes"]), len(coloured["scenes"])), (1, 3))


class Twins(unittest.TestCase):
    def test_every_file_of_a_family_is_a_twin(self):
        for family in ("cameras", "lights", "materials", "shapes", "textures"):
            folder = os.path.join(ROOT, "whitstone_povray", family)
            for name in registry.names(family):
                with open(os.path.join(folder, name + ".py"), encoding="utf-8") as file:
                    text = file.read()
                self.assertIn("\ndef twin(", text, name)
                self.assertTrue(text.startswith(f'"""Twin of the {family[:-1]} `{name}`'), name)


if __name__ == "__main__":
    unittest.main()
