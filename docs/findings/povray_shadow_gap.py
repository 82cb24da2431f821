"""POV-Ray 3.7: a blocker closer than 0.001 units to a surface casts no shadow.

A disc a metre wide lies above a white floor, and is invisible for the camera, which looks at the
floor below it. Shadow rays ignore what they meet within 0.001 units.

Exit code 0 if the fault is seen, 1 if not. Needs the command `povray`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

SCENE = """
#version 3.7;
global_settings {{ assumed_gamma 1 }}
camera {{ orthographic location <0, 1, 0> direction <0, -1, 0> up <0, 0, 0.001> right <0.001, 0, 0> }}
plane {{ y, 0 pigment {{ rgb 1 }} finish {{ ambient 0 diffuse 1 }} }}
disc {{ <0, {gap}, 0>, y, 0.5 no_image }}
light_source {{ <0, 10, 0> rgb 1 }}
"""


def is_lit(gap):
    """Whether the only pixel is bright."""
    with tempfile.TemporaryDirectory() as folder:
        scene, image = Path(folder, "scene.pov"), Path(folder, "image.ppm")
        scene.write_text(SCENE.format(gap=gap), encoding="ascii")
        command = ["povray", f"+I{scene}", f"+O{image}", "+FP", "+W1", "+H1", "-D", "-GA"]
        subprocess.run(command, check=True, capture_output=True)
        return image.read_bytes()[-1] > 0


answers = {gap: is_lit(gap) for gap in (2e-3, 5e-4)}
for gap, lit in answers.items():
    print(f"gap {gap:g} m: expected: in shadow, found: {'lit' if lit else 'in shadow'}")
sys.exit(0 if answers == {2e-3: False, 5e-4: True} else 1)
