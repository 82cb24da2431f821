"""Mitsuba 3: spheres whose radius is negative or not a number are accepted without a message.

Exit code 0 if the fault is seen, 1 if not.
"""

import math
import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")

accepted = []
for radius in (-1.0, math.nan):
    try:
        mi.load_dict({"type": "scene", "ball": {"type": "sphere", "radius": radius}})
        accepted.append(radius)
    except RuntimeError as error:
        print(f"radius {radius}: {error}")
print(f"expected: two errors, found: {accepted} accepted")
sys.exit(0 if accepted else 1)
