"""Errors in documents are found, and all of them are reported at once."""

import unittest

from support import DOWN, FLOOR, Case, film

HEAD = film() + DOWN


class Documents(Case):
    def test_each(self):
        cases = {
            "[film]\nwidth = 0\n" + DOWN: ("film.width", "1 to 65536"),
            '[film]\naovs = ["depht"]\n' + DOWN: ("film.aovs",),
            film(): ("camera: is required",),
            HEAD.replace("fov = 90", "fov = 180"): ("camera.fov", "between 0 and 180"),
            HEAD.replace("fov = 90", "fov = 9\nwindow = { l = 0, r = 1, b = 0, t = 1 }"): ("together with `window`",),
            HEAD.replace("fov = 90", "window = { l = 1, r = 1, b = 0, t = 1 }"): ("l < r",),
            HEAD.replace("up = [0, 0, -1]", "up = [0, 1, 0]"): ("parallel",),
            HEAD.replace("target = [0, 0, 0]", "target = [0, 5, 0]"): ("differ",),
            HEAD.replace("fov = 90", "fov = nan"): ("camera.fov",),
            HEAD.replace("fov = 90", "near = nan"): ("camera.near",),
            HEAD.replace("fov = 90", 'near_kind = "round"'): ("camera.near_kind",),
            HEAD.replace("perspective", "thin_lens"): ("camera.aperture", "camera.focus_distance"),
            HEAD.replace("perspective", "environment"): ("camera.fov", "unknown key"),
            HEAD + "[sampler]\nn = 2\n": ("sampler.type", "required"),
            HEAD + '[sampler]\ntype = "grid"\nsamples_per_axis = 65\n': ("sampler.samples_per_axis",),
            HEAD + '[integrator]\ntype = "whitted"\nmax_depth = -1\n': ("integrator.max_depth",),
            HEAD + '[integrator]\ntype = "appel"\nmax_depth = 1\n': ("max_depth", "unknown key"),
            HEAD + '[[light]]\ntype = "point"\nposition = [0, 0, 0]\nintensity = -1\n': ("light[0].intensity", ">= 0"),
            HEAD + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ntarget = [0, 0, 0]\nintensity = 1\n': ("direction",),
            HEAD + '[[light]]\ntype = "spot"\nposition = [0, 0, 0]\ntarget = [0, 1, 0]\nintensity = 1\nbeam_width = 20\n': ("beam",),
            HEAD + FLOOR + 'material = "gold"\n': ("'gold'",),
            HEAD + FLOOR + 'material = { type = "matte", reflectance = 1.5 }\n': ("from 0 to 1",),
            HEAD + FLOOR + 'material = { type = "phong", exponent = 0 }\n': ("exponent",),
            HEAD + FLOOR + 'material = { type = "dielectric", interior_ior = 0 }\n': ("interior_ior",),
            HEAD + FLOOR + 'id = "a"\n' + FLOOR + 'id = "a"\n': ("already the id",),
            HEAD + '[[shape]]\ntype = "box"\ntransform = [{ scale = [1, 0, 1] }]\n': ("invertible",),
            HEAD + '[[shape]]\ntype = "box"\ntransform = [{ scale = 1, translate = [0, 0, 0] }]\n': ("exactly one",),
            HEAD + '[[shape]]\ntype = "box"\ntransform = { rotate = { axis = [0, 0, 0], degrees = 3 } }\n': ("zero",),
            HEAD + '[[shape]]\ntype = "triangle"\nvertices = [[0, 0, 0], [1, 0, 0]]\n': ("3 arrays",),
            HEAD + "[[shape]]\ntype = 3\n": ("expected a string",),
            HEAD + "[[shape]]\nradius = 3\n": ("shape[0].type",),
            HEAD + "[lihgt]\n": ("did you mean 'light'",),
        }
        for document, words in cases.items():
            with self.subTest(words=words):
                self.refuse(document, "scene", *words)

    def test_all_at_once(self):
        self.refuse(HEAD + FLOOR + "radus = 1\n" + '[[shape]]\ntype = "sphere"\nradius = -1\n', "scene", "radus", "radius")

    def test_unsupported(self):
        for text, word in (
            ('[[shape]]\ntype = "isosurface"\n', "isosurface"),
            ('[[light]]\ntype = "laser"\n', "laser"),
            (FLOOR + 'material = { type = "velvet" }\n', "velvet"),
            (FLOOR + 'material = { type = "matte", reflectance = { type = "marble" } }\n', "marble"),
            ('[sampler]\ntype = "halton"\n', "halton"),
            ('[integrator]\ntype = "photon"\n', "photon"),
        ):
            self.refuse(HEAD + text, "unsupported", word)
        self.refuse(HEAD.replace("perspective", "fisheye"), "unsupported", "fisheye")

    def test_tables_that_do_not_affect_the_image(self):
        self.value(HEAD + '[accelerator]\ntype = "anything"\nleaf = 4\n[expect]\nrmse = 1e-3\n')

    def test_a_target_far_away(self):
        for distance in ("1e300", "1e-300"):
            self.value(HEAD.replace("target = [0, 0, 0]", f"target = [{distance}, 0, 0]").replace("origin = [0, 5, 0]", "origin = [0, 0, 0]"))

    def test_shared_tables_that_nothing_uses(self):
        unused = '[texture.t]\ntype = "constant"\n[material.m]\ntype = "two_sided"\nfront = "m"\nback = "m"\nkey = 1\n'
        self.value(HEAD + unused)
        self.refuse(HEAD + "[texture.t]\nvalue = 1\n[material.m]\ntype = 3\n", "scene", "texture.t.type", "material.m.type")
        self.refuse(HEAD + unused + FLOOR + 'material = "m"\n', "scene", "itself", "material.m.key")


if __name__ == "__main__":
    unittest.main()
