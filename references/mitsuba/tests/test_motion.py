"""Moving shapes and the shutter (model §3 and §9): closed forms, and every fault."""

import unittest

import numpy as np

from support import Case

VIEW = """
[camera]
type = "orthographic"
look_at = { origin = [0, 0, 5], target = [0, 0, 0] }
width = 2
"""


def keys(*frames):
    """Keyframes of times and steps."""
    return "motion = [" + ", ".join(f"{{ time = {time}, transform = {steps} }}" for time, steps in frames) + "]\n"


def moving(motion, time="", more=""):
    """A bright square over the view of one pixel."""
    square = '[[shape]]\ntype = "rectangle"\nmaterial = { type = "emissive", radiance = 1 }\n'
    return f"[film]\nwidth = 1\nheight = 1\n{time}\n{VIEW}{square}{more}{motion}"


PASSING = keys((0, "{ translate = [-4, 0, 0] }"), (1, "{ translate = [4, 0, 0] }"))


class Motion(Case):
    def test_a_square_that_passes(self):
        # It covers the centre for |8 t - 4| <= 1.
        for time, expected in ((0.0, 0), (0.4, 1), (0.62, 1), (0.63, 0), (9, 0)):
            self.near(self.value(moving(PASSING, f"time = {time}")), [expected] * 3)
        ending = PASSING.replace("[4,", "[0,")
        self.near(self.value(moving(ending, "time = -1")), [0] * 3)
        self.near(self.value(moving(ending, "time = 9")), [1] * 3)
        for count, expected in ((2, 0), (8, 2 / 8), (16, 4 / 16), (5, 1 / 5)):
            time = f"time = {{ open = 0, close = 1, count = {count} }}"
            self.near(self.value(moving(PASSING, time)), [expected] * 3)

    def test_the_steps_of_the_motion_come_last(self):
        # A scaled square is moved by whole metres: 0.2 wide at x = 0.15 does not cover the centre.
        motion = keys((0, "{ translate = [0.15, 0, 0] }"), (1, "{ translate = [0.15, 0, 0] }"))
        self.near(self.value(moving(motion, more="transform = { scale = 0.1 }\n")), [0] * 3)
        motion = keys((0, "{ scale = 0.1 }"), (1, "{ scale = 0.1 }"))
        self.near(self.value(moving(motion, more="transform = { translate = [0.15, 0, 0] }\n")), [1] * 3)

    def test_every_kind_of_step(self):
        # The square is at distance 3 from an axis; after a third of the way it covers the centre.
        for first, second, share in (
            ("{ rotate = { axis = [0, 0, 1], degrees = 0 } }", "{ rotate = { axis = [0, 0, 1], degrees = 540 } }", 1 / 3),
            ("[{ scale = 1 }, { translate = [-3, 0, 0] }]", "[{ scale = [1, 1, 1] }, { translate = [6, 0, 0] }]", 0),
            (
                "{ matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]] }",
                "{ matrix = [[1, 0, 0, -9], [0, 1, 0, 0], [0, 0, 1, 0]] }",
                1 / 3,
            ),
        ):
            more = "transform = { translate = [3, 0, 0] }\n"
            shifted = moving(keys((1, first), (4, second)), f"time = {1 + 3 * share}", more)
            if "rotate" in first:
                # Half a turn about the z axis: back to the other side, not over the centre.
                self.near(self.value(shifted), [0] * 3)
                self.near(self.value(shifted.replace("origin = [0, 0, 5], target = [0, 0, 0]", "origin = [-3, 0, 5], target = [-3, 0, 0]")), [1] * 3)
            else:
                self.near(self.value(shifted), [1] * 3)

    def test_groups(self):
        # The inner motion is undone by that of the instance.
        group = (
            '[[group.g.shape]]\ntype = "rectangle"\nmaterial = { type = "emissive", radiance = 1 }\n'
            + keys((0, "{ translate = [0, 0, 0] }"), (1, "{ translate = [4, 0, 0] }"))
        )
        film = "[film]\nwidth = 1\nheight = 1\ntime = { open = 0, close = 1, count = 4 }\n"
        instance = '[[shape]]\ntype = "instance"\ngroup = "g"\n'
        back = keys((0, "{ translate = [0, 0, 0] }"), (1, "{ translate = [-4, 0, 0] }"))
        self.near(self.value(film + VIEW + group + instance + back), [1] * 3)
        self.near(self.value(film + VIEW + group + instance), [1 / 4] * 3)

    def test_layers(self):
        time = "time = { open = 0, close = 1, count = 8 }\naovs = [\"shape_id\"]\npaths = { shown = \"E O\" }"
        channels, answer = self.render(moving(PASSING.replace("-4", "-0.5"), time))
        self.assertEqual(answer["samples"], 8)
        # At the first time it covers the pixel, later it leaves.
        self.assertEqual(channels["shape_id.I"][0, 0], 0)
        self.near(channels["R"][0, 0], 3 / 8)
        self.near(channels["path.shown.R"][0, 0], 3 / 8)
        self.assertEqual([entry["type"] for entry in answer["hosted"]], ["emissive", "motion"])

    def test_trees_have_the_samples_of_all_times(self):
        time = "time = { open = 0, close = 1, count = 8 }"
        shapes = [self.nodes(moving(PASSING, time), sample=sample)[0]["shape"] for sample in range(8)]
        self.assertEqual(shapes, [-1, -1, -1, 0, 0, -1, -1, -1])

    def test_settings(self):
        time = "time = { open = 0, close = 1, count = 8 }"
        answer = self.ask("probe", moving(PASSING, time), pixels=[[0, 0]], settings=[{}, {"dx": 0.1}, {"ulps": 1.0, "seed": 3}])
        np.testing.assert_allclose([value[0] for value in answer["values"]], np.full((3, 3), 0.25), rtol=1e-6)

    def test_faults(self):
        one = "{ translate = [0, 0, 0] }"
        turn = "{{ rotate = {{ axis = [0, {}, 1], degrees = 0 }} }}"
        for motion, *words in (
            (keys((0, one)), "shape[0].motion", "two keyframes"),
            ("motion = 3\n", "shape[0].motion", "two keyframes"),
            (keys((0, one), (0, one)), "motion[1].time", "more than 0"),
            (keys((0, one), (2, one), (1, one)), "motion[2].time"),
            (keys((0, one), (1, "{ scale = 1 }")), "motion[1].transform"),
            (keys((0, one), (1, f"[{one}, {one}]")), "motion[1].transform"),
            (keys((0, turn.format(0)), (1, turn.format(1))), "motion[1].transform"),
            ("motion = [{ time = 0 }, { time = 1, transform = [] }]\n", "motion[0].transform", "required"),
            ("motion = [{ time = nan, transform = [] }, { time = 1, transform = [] }]\n", "motion[0].time"),
            (keys((0, one), (1, one)).replace("time = 1", "tme = 1"), "motion[1].time", "motion[1].tme"),
        ):
            self.refuse(moving(motion), "scene", *words)
        shrinking = keys((0, "{ scale = 1 }"), (1, "{ scale = -1 }"))
        self.refuse(moving(shrinking, "time = 0.5"), "scene", "invertible")
        self.value(moving(shrinking, "time = 0.4"))
        for time, *words in (
            ('time = "noon"', "film.time"),
            ("time = { open = 1, close = 0, count = 2 }", "film.time.close"),
            ("time = { open = 0, close = 1, count = 257 }", "film.time.count"),
            ("time = { open = 0, close = 1 }", "film.time.count", "required"),
        ):
            self.refuse(moving(PASSING, time), "scene", *words)


if __name__ == "__main__":
    unittest.main()
