"""POV-Ray 3.7: a hit farther than ten million units from the start of the ray is missed.

A sphere whose radius is half of the distance of its centre fills the view at every size.

Exit code 0 if the fault is seen, 1 if not. Needs the command `povray`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

SCENE = """
#version 3.7;
global_settings {{ assumed_gamma 1 }}
camera {{ location <0, 0, 0> look_at <0, 0, 1> angle 10 }}
sphere {{ <0, 0, {distance}>, {distance} / 2 pigment {{ rgb 1 }} finish {{ ambient 0 emission 1 }} }}
"""


def is_seen(distance):
    """Whether the only pixel is bright."""
    with tempfile.TemporaryDirectory() as folder:
        scene, image = Path(folder, "scene.pov"), Path(folder, "image.ppm")
        scene.write_text(SCENE.format(distance=distance), encoding="ascii")
        command = ["povray", f"+I{scene}", f"+O{image}", "+FP", "+W1", "+H1", "-D", "-GA"]
        subprocess.run(command, check=True, capture_output=True)
        return image.read_bytes()[-1] > 0


answers = {distance: is_seen(distance) for distance in (1.8e7, 2.2e7)}
for distance, seen in answers.items():
    print(f"centre at {distance:g} m: expected: a sphere, found: {'a sphere' if seen else 'nothing'}")
sys.exit(0 if answers == {1.8e7: True, 2.2e7: False} else 1)
