"""Mitsuba 3: a ray through a thin pane meets one of its two faces.

A pane of glass is 5e-5 m thick. A ray that `spawn_ray` starts at its first face starts behind the
second one.

Exit code 0 if the fault is seen, 1 if not.
"""

import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")

THICKNESS = 5e-5

scene = mi.load_dict(
    {
        "type": "scene",
        "pane": {"type": "cube", "to_world": mi.ScalarTransform4f().scale([1, 1, 0.5 * THICKNESS])},
    }
)
ray = mi.Ray3f(mi.Point3f(0.1, 0.2, 2), mi.Vector3f(0, 0, -1))
faces = 0
while faces < 8:
    hit = scene.ray_intersect(ray)
    if not hit.is_valid():
        break
    faces += 1
    ray = hit.spawn_ray(ray.d)
print(f"thickness {THICKNESS:g} m: expected: 2 faces, found: {faces}")
sys.exit(0 if faces != 2 else 1)
