"""Mitsuba 3: a blocker closer to a surface than the spawn offset casts no shadow.

A square metre lies 5e-5 m above a floor at the origin. The floor below its middle is in shadow, but
`spawn_ray_to` starts above the blocker: its offset is 1500 times the unit roundoff of the hit
point's coordinates, plus 1.

Exit code 0 if the fault is seen, 1 if not.
"""

import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")

GAP = 5e-5

scene = mi.load_dict(
    {
        "type": "scene",
        "floor": {"type": "rectangle"},
        "blocker": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().translate([0, 0, GAP]).scale(0.5),
        },
    }
)
# From the side, below the blocker.
hit = scene.ray_intersect(mi.Ray3f([-0.9, 0, 2e-5], mi.ScalarVector3f(0.9, 0, -2e-5)))
assert hit.is_valid() and abs(hit.p.z) < 1e-9, "the ray meets the floor"
blocked = scene.ray_test(hit.spawn_ray_to(mi.Point3f(0, 0, 1)))
print(f"gap {GAP:g} m: expected: blocked, found: {'blocked' if blocked else 'lit'}")
sys.exit(0 if not blocked else 1)
