"""Embree 4: a triangle of 1e-18 m is hit at a wrong distance, and one of 1e-20 m is missed.

Single precision holds numbers down to 1e-38, but products of three lengths underflow. The ray
starts above the triangle, as high as its sides are long.

Exit code 0 if the fault is seen, 1 if not. Needs `pip install embreex`.
"""

import sys

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh


def distance(size):
    """The distance at which the ray meets the triangle, over its size; None for a miss."""
    scene = rtcore_scene.EmbreeScene(robust=True)
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    TriangleMesh(scene, corners.astype("f4"), np.array([[0, 1, 2]], "i4"))
    origin, direction = np.array([[size / 4, size / 4, size]], "f4"), np.array([[0, 0, -1]], "f4")
    found = scene.run(origin, direction, query="INTERSECT", output=True)
    return found["tfar"][0] / size if found["primID"][0] == 0 else None


answers = {size: distance(size) for size in (1e-10, 1e-18, 1e-20)}
for size, found in answers.items():
    print(f"size {size:g} m: expected: t / size = 1, found: {'a miss' if found is None else f'{found:.3f}'}")
is_right = abs(answers[1e-10] - 1) < 1e-5
is_wrong = answers[1e-18] is not None and abs(answers[1e-18] - 1) > 0.1 and answers[1e-20] is None
sys.exit(0 if is_right and is_wrong else 1)
