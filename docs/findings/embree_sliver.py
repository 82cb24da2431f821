"""Embree 4: the distance of a long, thin triangle is off by thousands of units in the last place.

The triangle is about a million times as long as wide. The ray meets it at an angle of 31 degrees to
its plane, so that the distance is a well-conditioned function of the numbers, which are all exact
in single precision. `exact` is the same quotient in rational numbers.

Exit code 0 if the fault is seen, 1 if not. Needs `pip install embreex`.
"""

import sys
from fractions import Fraction

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

ORIGIN = [-1.1660090684890747, -1.9806010723114014, 0.6760745048522949]
DIRECTION = [1.8260092735290527, 2.315600872039795, -0.5510744452476501]
CORNERS = [
    [0.30000001192092896, 0.20000000298023224, -0.10000000149011612],
    [1.100000023841858, 0.5, 0.4000000059604645],
    [0.7000004649162292, 0.3499990403652191, 0.1500001847743988],
]

scene = rtcore_scene.EmbreeScene(robust=True)
TriangleMesh(scene, np.array(CORNERS, "f4"), np.array([[0, 1, 2]], "i4"))
found = scene.run(np.array([ORIGIN], "f4"), np.array([DIRECTION], "f4"), query="INTERSECT", output=True)
t = float(found["tfar"][0])

a, b, c = (np.array([Fraction(x) for x in corner]) for corner in CORNERS)
normal = np.cross(b - a, c - a)
exact = float(np.dot(normal, a - [Fraction(x) for x in ORIGIN]) / np.dot(normal, [Fraction(x) for x in DIRECTION]))
off = abs(t - exact) / 2.0**-24
print(f"expected: t = {exact:.9f}, found: {t:.9f}, {off:.0f} units in the last place off")
sys.exit(0 if found["primID"][0] == 0 and off > 1000 else 1)
