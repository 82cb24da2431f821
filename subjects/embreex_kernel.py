"""Embree as a kernel for `whitstone stress --kernel python3 subjects/embreex_kernel.py`.

Needs `embreex` and NumPy. Embree 4 traces in single precision, here with its flag `robust`. The
package gives no lower end of the interval, so rays with one are not supported.
"""

import json
import sys

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh


def load(path):
    """The vertices and the triangles of an OBJ file."""
    vertices, triangles = [], []
    with open(path, encoding="ascii") as file:
        for line in file:
            kind, *words = line.split()
            if kind == "v":
                vertices.append([float(word) for word in words])
            elif kind == "f":
                triangles.append([int(word) - 1 for word in words])
    return np.array(vertices, "f4"), np.array(triangles, "i4")


def intersect(scene, request):
    if max(request["t_min"]) > 0:
        return {"ok": False, "kind": "unsupported", "error": "embreex has no lower end of the interval"}
    origins, directions = (np.array(request[key], "f4") for key in ("origins", "directions"))
    found = scene.run(origins, directions, dists=np.array(request["t_max"], "f4"), query="INTERSECT", output=True)
    columns = {"t": found["tfar"], "primitive": found["primID"], "u": found["u"], "v": found["v"]}
    return {"ok": True, **{key: column.tolist() for key, column in columns.items()}}


def main():
    scene = None
    for line in sys.stdin:
        request = json.loads(line)
        if request["op"] == "load":
            scene = rtcore_scene.EmbreeScene(robust=True)
            TriangleMesh(scene, *load(request["mesh"]))
            answer = {"ok": True}
        else:
            answer = intersect(scene, request)
        print(json.dumps(answer), flush=True)


main()
