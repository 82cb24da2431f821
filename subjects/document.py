"""Reads Whitstone's flattened scene documents for the adapters in this folder.

The document is the TOML of docs/whitted-model.md. An adapter asks for what its renderer can
express; everything else ends the program with exit code 77, which `whitstone validate --subject`
reports as a scene that was skipped, with the reason. The module needs Python 3.11 and NumPy.
"""

import math
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

SKIPPED = 77
# The indices of refraction of metals: eta and k.
METALS = {
    "Ag": ([0.15528, 0.11673, 0.13839], [4.82835, 3.12222, 2.14690]),
    "Al": ([1.65750, 0.88040, 0.52124], [9.22381, 6.26950, 4.83700]),
    "Au": ([0.14304, 0.37531, 1.44205], [3.98300, 2.38556, 1.60336]),
    "Be": ([4.18501, 3.18503, 2.78406], [3.83547, 3.01012, 2.86899]),
    "Cr": ([4.36967, 2.91651, 1.65490], [5.20655, 4.23131, 3.75470]),
    "Cu": ([0.20101, 0.92375, 1.10222], [3.91326, 2.45305, 2.14209]),
    "Hg": ([2.39894, 1.44003, 0.90957], [6.32759, 4.37192, 3.42176]),
    "Ir": ([3.08630, 2.08219, 1.61791], [5.59215, 4.06709, 3.26731]),
    "Ni": ([2.36730, 1.66337, 1.46708], [4.49881, 3.05015, 2.34544]),
    "W": ([4.37082, 3.30025, 2.99841], [3.50064, 2.60487, 2.27323]),
}


def skip(reason):
    """Ends the program: the renderer cannot render this scene."""
    print(reason)
    sys.exit(SKIPPED)


def only(table, what, **known):
    """The values of the keys of a table, with defaults; other keys are not supported."""
    for key in table:
        if key not in known and key not in ("type", "id", "transform"):
            skip(f"{what}: the key {key}")
    return {key: table.get(key, default) for key, default in known.items()}


def color(value, what):
    """A number or three numbers as a colour. Textures are not supported."""
    if isinstance(value, (int, float)):
        return np.full(3, float(value))
    if isinstance(value, list):
        return np.array(value, float)
    if isinstance(value, dict) and value.get("type") == "constant":
        return color(value["value"], what)
    return skip(f"{what}: a texture")


@dataclass
class Checker:
    """The texture `checker`: `a` where the floors of the two coordinates have an even sum, else `b`."""

    a: np.ndarray
    b: np.ndarray
    # Takes texture coordinates (u, v, 0), or points of the world where `solid`, to coordinates in cells.
    matrix: np.ndarray
    solid: bool

    def coordinates(self, mesh, matrix):
        """The coordinates in cells at the vertices of a mesh that stands at `matrix`."""
        if self.solid:
            points = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        elif mesh.uvs is None:
            skip("a texture on a shape without texture coordinates")
        else:
            points = np.pad(mesh.uvs, ((0, 0), (0, 1)))
        return points @ self.matrix[:2, :3].T + self.matrix[:2, 3]


def paint(value, what):
    """A number or three numbers as a colour, or a Checker. Other textures are not supported."""
    if not isinstance(value, dict) or value.get("type") != "checker":
        return color(value, what)
    keys = only(value, "checker", a=0.8, b=0.2, scale=1, offset=[0, 0], mapping={})
    mapping = only(keys["mapping"], "a mapping", projection="uv", transform=None)
    if mapping["projection"] not in ("uv", "solid", "planar"):
        skip(f"the projection {mapping['projection']}")
    cells = np.eye(4)
    cells[0, 0], cells[1, 1] = np.broadcast_to(keys["scale"], 2)
    cells[:2, 3] = keys["offset"]
    a, b = (color(keys[key], "checker") for key in "ab")
    return Checker(a, b, cells @ matrix_of(mapping["transform"]), mapping["projection"] != "uv")


def index_of(keys):
    """The complex index of refraction of a conductor, eta and k."""
    if keys["metal"]:
        return tuple(np.array(part) for part in METALS[keys["metal"]])
    return color(keys["eta"], "a metal"), color(keys["k"], "a metal")


def unit(vector):
    return vector / np.linalg.norm(vector)


def matrix_of(steps):
    """The matrix of a transform: a step or a list of steps, applied in this order."""
    total = np.eye(4)
    for step in [steps] if isinstance(steps, dict) else steps or []:
        ((kind, value),) = step.items()
        matrix = np.eye(4)
        if kind == "translate":
            matrix[:3, 3] = value
        elif kind == "scale":
            matrix[:3, :3] = np.diag(np.broadcast_to(value, 3))
        elif kind == "rotate":
            x, y, z = unit(np.array(value["axis"], float))
            angle = math.radians(value["degrees"])
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            matrix[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        elif kind == "matrix":
            matrix[:3] = value
        else:
            skip(f"a transform with {kind}")
        total = matrix @ total
    return total


@dataclass
class Camera:
    """A pinhole, or parallel rays. `u`, `v`, `w` point to the right, up and backwards.

    The window of a pinhole is at the distance d; that of parallel rays is where the camera is.
    """

    origin: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    left: float
    right: float
    bottom: float
    top: float
    distance: float
    near: float
    # The distance of the point that it looks at.
    reach: float
    parallel: bool = False

    @property
    def matrix(self):
        """Takes camera space, which looks along -z with y up, to world space."""
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([self.u, self.v, self.w], axis=1)
        matrix[:3, 3] = self.origin
        return matrix


@dataclass
class Mesh:
    """Triangles in object space, with smooth normals where the surface is curved."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None

    def placed(self, matrix):
        """The mesh under a transform. A mirroring one keeps outside outside."""
        linear = matrix[:3, :3]
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        faces = self.faces if np.linalg.det(linear) > 0 else self.faces[:, ::-1]
        if self.normals is None:
            return Mesh(vertices, faces, None, self.uvs)
        normals = self.normals @ np.linalg.inv(linear)
        return Mesh(vertices, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True), self.uvs)


@dataclass
class Shape:
    """A shape: `kind` and `keys` as in the document, and its place in the world."""

    kind: str
    keys: dict
    matrix: np.ndarray
    material: dict
    name: str = ""


@dataclass
class Scene:
    """A scene, with the camera, lights, shapes and materials of the document."""

    width: int
    height: int
    camera: Camera
    max_depth: int
    lights: list = field(default_factory=list)
    background: np.ndarray = field(default_factory=lambda: np.zeros(3))
    ambient: np.ndarray = field(default_factory=lambda: np.zeros(3))
    # What a reflection beyond the depth limit shows.
    beyond: np.ndarray = field(default_factory=lambda: np.zeros(3))
    shapes: list = field(default_factory=list)

    @property
    def aspect(self):
        return self.width / self.height


def read_camera(table, width, height, kinds):
    if table["type"] not in kinds:
        skip(f"a camera of type {table['type']}")
    parallel = table["type"] == "orthographic"
    known = {"width": 2} if parallel else {"fov": 45, "fov_axis": "x", "near_kind": "planar"}
    keys = only(table, "the camera", look_at=None, window=None, near=0, **known)
    view = keys["look_at"]
    origin = np.array(view["origin"], float)
    backwards = origin - np.array(view["target"], float)
    w = unit(backwards)
    u = unit(np.cross(view.get("up", [0, 1, 0]), w))
    if window := keys["window"]:
        sides = [float(window[side]) for side in "lrbt"]
        distance = float(window.get("d", 1))
    elif parallel:
        x = keys["width"] / 2
        sides, distance = [-x, x, -x * height / width, x * height / width], 1.0
    else:
        axis = keys["fov_axis"]
        if axis in ("smaller", "larger"):
            axis = "x" if (width <= height) == (axis == "smaller") or width == height else "y"
        half = math.tan(math.radians(keys["fov"]) / 2)
        x, y = (half, half * height / width) if axis == "x" else (half * width / height, half)
        sides, distance = [-x, x, -y, y], 1.0
    if keys["near"] and keys.get("near_kind", "planar") != "planar":
        skip("a near limit that is not planar")
    if keys["near"] < 0 and not parallel:
        skip("a near limit behind a perspective camera")
    return Camera(origin, u, np.cross(w, u), w, *sides, distance, float(keys["near"]), float(np.linalg.norm(backwards)), parallel)


def read(path, shadows="opaque", cameras=("perspective",)):
    """Reads a document with these shadows and one of these types of cameras.

    Lights and materials stay tables, without defaults.
    """
    document = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    film = document.get("film", {})
    width, height = film.get("width", 512), film.get("height", 512)
    sampler = document.get("sampler", {}).get("type", "center")
    if sampler != "center":
        skip(f"the sampler {sampler}")
    tracing = document.get("integrator", {"type": "whitted"})
    if tracing["type"] not in ("whitted", "appel"):
        skip(f"the integrator {tracing['type']}")
    if (found := tracing.get("shadows", "opaque")) != shadows:
        skip(f"{found} shadows")
    for key in ("light_cutoff", "min_contribution"):
        if tracing.get(key, 0) > 0:
            skip(f"the integrator's {key}")
    depth = 0 if tracing["type"] == "appel" else tracing.get("max_depth", 6)
    scene = Scene(width, height, read_camera(document["camera"], width, height, cameras), depth)
    for light in document.get("light", []):
        if light["type"] == "background":
            scene.background = scene.background + color(light["radiance"], "the background")
        elif light["type"] == "ambient":
            scene.ambient = scene.ambient + color(light["radiance"], "ambient light")
        else:
            scene.lights.append(light)
    # Appel 1968 traces no reflections: they are black.
    if tracing["type"] == "whitted" and tracing.get("at_max_depth", "background") == "background":
        scene.beyond = scene.background
    add_shapes(scene, document, document.get("shape", []), Path(path).parent, np.eye(4), [])
    return scene


def add_shapes(scene, document, tables, folder, matrix, replacements):
    """Adds the shapes of a list, which stands at `matrix`; groups are placed shape by shape."""
    materials = document.get("material", {})
    for table in tables:
        if table.get("casts_shadow", True) is not True:
            skip("a shape without a shadow")
        if "motion" in table:
            skip("a shape that moves")
        keys = {key: value for key, value in table.items() if key not in ("casts_shadow", "material")}
        place = matrix @ matrix_of(table.get("transform"))
        if table["type"] == "instance":
            inner = only({**keys, "id": ""}, "an instance", group=None, materials={})
            shapes = document["group"][inner["group"]]["shape"]
            add_shapes(scene, document, shapes, folder, place, [inner["materials"], *replacements])
            continue
        if "file" in keys:
            keys["file"] = str(folder / keys["file"])
        material = table.get("material", {"type": "matte"})
        for replacement in replacements:
            material = replacement.get(material, material) if isinstance(material, str) else material
        if isinstance(material, str):
            material = materials[material]
        # Shared textures by name.
        textures = document.get("texture", {})
        shared = {key: textures[material[key]] for key in ("reflectance", "radiance") if isinstance(material.get(key), str)}
        material = {**material, **shared}
        name = f"{table.get('id', 'shape')}-{len(scene.shapes)}"
        scene.shapes.append(Shape(table["type"], keys, place, material, name))


def grid(columns, rows):
    """The faces of a grid of (columns + 1) x (rows + 1) vertices, without those that have no area."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    a = (j * (columns + 1) + i).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def revolved(profile, normals, heights, segments):
    """A surface about the z axis: `profile` has rows (radius, z), `normals` rows (radial, z).

    The texture coordinates are the angle over 2 pi and `heights`, which has one number for each row.
    """
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    # Exactly closed.
    ring[-1] = ring[0]

    def turn(rows):
        radial = rows[:, None, :1] * ring[None]
        up = np.broadcast_to(rows[:, None, 1:], radial.shape[:2] + (1,))
        return np.concatenate([radial, up], 2).reshape(-1, 3)

    vertices = turn(profile)
    faces = grid(segments, len(profile) - 1)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-14]
    u, v = np.meshgrid(angle / (2 * np.pi), heights)
    return Mesh(vertices, faces, turn(normals), np.stack([u.ravel(), v.ravel()], 1))


def disk(radius, z, up, segments):
    """A disk across the z axis, with the texture coordinates (r/radius, phi/2pi)."""
    # In rings, because the angle is not linear in a triangle of the whole radius.
    rings = np.linspace(0, 1, 65)[:: -1 if up else 1]
    profile = np.stack([radius * rings, np.full(65, float(z))], 1)
    result = revolved(profile, profile, rings, segments)
    result.normals, result.uvs = None, result.uvs[:, ::-1]
    return result


def plane():
    """A plane, as squares that are larger at larger distances: up to the horizon in a few pixels."""
    steps = 4.0 ** np.arange(10)
    x = np.concatenate([-steps[::-1], [0], steps])
    vertices = np.stack([*np.meshgrid(x, x), np.zeros((len(x), len(x)))], 2).reshape(-1, 3)
    return Mesh(vertices, grid(len(x) - 1, len(x) - 1), uvs=vertices[:, :2])


def box():
    """The faces of a box, each with its own vertices."""
    parts = []
    for axis in range(3):
        for side in (-1, 1):
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
            vertices = np.empty((4, 3))
            vertices[:, axis] = side
            vertices[:, [(axis + 1) % 3, (axis + 2) % 3]] = corners
            faces = np.array([[0, 1, 2], [0, 2, 3]])
            parts.append(Mesh(vertices, faces if side > 0 else faces[:, ::-1], uvs=(corners + 1) / 2))
    faces = np.vstack([part.faces + 4 * index for index, part in enumerate(parts)])
    return Mesh(np.vstack([part.vertices for part in parts]), faces, uvs=np.vstack([part.uvs for part in parts]))


def fans(polygons):
    """The triangles of polygons, each a fan from its first corner."""
    return [[one[0], one[k], one[k + 1]] for one in polygons for k in range(1, len(one) - 1)]


def read_mesh(path):
    """A mesh of a PLY or OBJ file; those with normals or coordinates of some faces are not supported."""
    if path.suffix == ".ply":
        return read_ply(path)
    if path.suffix != ".obj":
        skip(f"a mesh of a file {path.suffix}")
    lists = {"v": [], "vt": [], "vn": []}
    polygons = []
    for line in path.read_text(encoding="utf-8").splitlines():
        kind, *words = line.split() or ["#"]
        if kind in lists:
            lists[kind].append([float(word) for word in words])
        elif kind == "f":
            polygons.append([tuple(int(part or 0) for part in (word + "//").split("/")[:3]) for word in words])
    corners = np.array(fans(polygons)).reshape(-1, 3)
    if (corners < 0).any():
        skip("a mesh with indices from the end")
    unique, faces = np.unique(corners, axis=0, return_inverse=True)

    def values(column, kind, size):
        used = unique[:, column]
        if not used.any():
            return None
        if not used.all():
            skip("a mesh in which only some faces have normals or texture coordinates")
        return np.array(lists[kind])[used - 1, :size]

    normals, uvs = values(2, "vn", 3), values(1, "vt", 2)
    return Mesh(values(0, "v", 3), faces.reshape(-1, 3), normals, np.zeros((len(unique), 2)) if uvs is None else uvs)


def read_ply(path):
    """A PLY file of vertices, all of whose properties are floats, and lists of indices."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    lines = [line.split() for line in header.decode().splitlines()]
    counts = {line[1]: int(line[2]) for line in lines if line[0] == "element"}
    names = [line[2] for line in lines if line[0] == "property" and line[1] in ("float", "float32")]
    others = [line for line in lines if line[0] == "property" and line[1] not in ("float", "float32")]
    if list(counts) != ["vertex", "face"] or [line[1:4] for line in others] != [["list", "uchar", "int"]]:
        skip("a PLY file with other elements or properties")
    count = counts["vertex"]
    if ["format", "ascii", "1.0"] in lines:
        rows = body.decode().splitlines()
        data = np.array([row.split() for row in rows[:count]], float)
        polygons = [[int(word) for word in row.split()[1:]] for row in rows[count : count + counts["face"]]]
    else:
        data = np.frombuffer(body, "<f4", count * len(names)).reshape(count, -1).astype(float)
        polygons, at = [], 4 * data.size
        for _ in range(counts["face"]):
            polygons.append(np.frombuffer(body, "<i4", body[at], at + 1).tolist())
            at += 1 + 4 * body[at]

    def values(*wanted):
        return data[:, [names.index(name) for name in wanted]] if set(wanted) <= set(names) else None

    uvs = next((found for pair in ("uv", "st") if (found := values(*pair)) is not None), np.zeros((count, 2)))
    return Mesh(values("x", "y", "z"), np.array(fans(polygons)), values("nx", "ny", "nz"), uvs)


def tessellate(shape, segments):
    """The meshes of a shape in object space. Curved shapes have `segments` parts around."""
    kind, table = shape.kind, shape.keys
    parts = np.linspace(0, 1, segments // 2 + 1)
    if kind in ("sphere", "ellipsoid"):
        circle = np.stack([np.sin(np.pi * parts), -np.cos(np.pi * parts)], 1)
        circle[[0, -1], 0] = 0
        mesh = revolved(circle, circle, parts, segments)
        keys = only(table, kind, center=[0, 0, 0], radius=1, radii=[1, 1, 1])
        radii = np.array(keys["radii"], float) * keys["radius"]
        mesh.normals = mesh.normals / radii
        mesh.normals /= np.linalg.norm(mesh.normals, axis=1, keepdims=True)
        mesh.vertices = mesh.vertices * radii + np.array(keys["center"], float)
        return [mesh]
    if kind == "rectangle":
        only(table, kind)
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
        return [Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uvs=(corners[:, :2] + 1) / 2)]
    if kind == "plane":
        only(table, kind)
        return [plane()]
    if kind == "disk":
        only(table, kind)
        return [disk(1, 0, True, segments)]
    if kind == "triangle":
        keys = only(table, kind, vertices=None, normals=None, uvs=[[0, 0], [1, 0], [0, 1]])
        if keys["normals"]:
            skip("a triangle with normals")
        return [Mesh(np.array(keys["vertices"], float), np.array([[0, 1, 2]]), uvs=np.array(keys["uvs"], float))]
    if kind == "box":
        only(table, kind)
        return [box()]
    if kind == "mesh":
        keys = only(table, kind, file=None, shading="smooth")
        mesh = read_mesh(Path(keys["file"]))
        if keys["shading"] == "flat":
            mesh.normals = None
        return [mesh]
    if kind == "torus":
        keys = only(table, kind, major_radius=1, minor_radius=0.25)
        circle = np.stack([np.cos(2 * np.pi * parts), np.sin(2 * np.pi * parts)], 1)
        circle[-1] = circle[0]
        return [revolved(circle * keys["minor_radius"] + [keys["major_radius"], 0], circle, parts, segments)]
    if kind in ("cylinder", "cone", "paraboloid", "hyperboloid"):
        return revolved_solid(kind, table, parts, segments)
    return skip(f"a shape of type {kind}")


def revolved_solid(kind, table, parts, segments):
    """The side of a cylinder, cone, paraboloid or hyperboloid, and its caps."""
    if kind == "paraboloid":
        keys = only(table, kind, radius=1, z=[0, 1], caps=True)
        low, high = keys["z"]
        # Even steps of the radius.
        z = (math.sqrt(low) + (math.sqrt(high) - math.sqrt(low)) * parts) ** 2
        radius = keys["radius"] * np.sqrt(z)
        normals = np.stack([2 * radius, np.full(len(z), -float(keys["radius"]) ** 2)], 1)
    elif kind == "hyperboloid":
        keys = only(table, kind, radius=0.5, slope=1, z=[-1, 1], caps=True)
        low, high = keys["z"]
        z = low + (high - low) * parts
        radius = np.hypot(keys["radius"], keys["slope"] * z)
        normals = np.stack([radius, -keys["slope"] ** 2 * z], 1)
    else:
        keys = only(table, kind, radius=1, radii=[1, 0], z=[-1, 1] if kind == "cylinder" else [0, 1], caps=True)
        low, high = keys["z"]
        start, end = [keys["radius"]] * 2 if kind == "cylinder" else keys["radii"]
        # In rows, because the angle is not linear in a triangle of the whole height.
        parts = parts if start != end else parts[[0, -1]]
        z, radius = low + (high - low) * parts, start + (end - start) * parts
        normals = np.array([[high - low, start - end]] * len(parts), float)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    side = revolved(np.stack([radius, z], 1), normals, (z - z[0]) / (z[-1] - z[0]), segments)
    caps = [(radius[0], z[0], False), (radius[-1], z[-1], True)] if keys["caps"] else []
    return [side] + [disk(r, height, up, segments) for r, height, up in caps if r > 0]


def write_pfm(path, pixels):
    """Writes an image, top row first, as a portable float map."""
    pixels = np.asarray(pixels, "<f4")
    with open(path, "wb") as file:
        file.write(f"PF\n{pixels.shape[1]} {pixels.shape[0]}\n-1.0\n".encode())
        file.write(pixels[::-1].tobytes())
