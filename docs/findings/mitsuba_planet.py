"""Mitsuba 3: a sphere of a large radius is hit at the wrong distance, or on its far side.

The camera is 2 m above a sphere that passes through the origin. All numbers are exact in single
precision. The distance along (1, -1, 0) is 2 + 2 / radius. The error grows with the radius; at 1e8
m the far root is returned.

Exit code 0 if the fault is seen, 1 if not.
"""

import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")

wrong = 0
for radius in (1e5, 1e6, 1e7, 1e8):
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "center": [0, -radius, 0], "radius": radius}})
    t = scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 2, 0), mi.Vector3f(1, -1, 0))).t
    expected = 2 + 2 / radius
    print(f"radius {radius:g} m: expected: {expected:.8f}, found: {t:.8g}")
    wrong += abs(t / expected - 1) > 1e-4
sys.exit(0 if wrong else 1)
