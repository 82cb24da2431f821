"""Mesh files as the model specifies them (§9): OBJ, PLY and STL."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from typing import Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from whitstone_protocol.errors import SceneError, Unsupported

from .settings import Setting
from .transforms import cross, dot

Corner = Optional[Tuple[int, int, int]]


@dataclass(frozen=True)
class Mesh:
    """Vertices, normals and texture coordinates, each with the indices of the corners of all
    triangles (None if a face has none).
    """

    positions: List[Tuple[float, ...]]
    normals: List[Tuple[float, ...]]
    uvs: List[Tuple[float, ...]]
    faces: List[Tuple[int, int, int]]
    normal_faces: List[Corner]
    uv_faces: List[Corner]


def load(path: str) -> Mesh:
    """Reads a file; the extension determines the format."""
    readers: Dict[str, Callable[[bytes], Mesh]] = {".obj": _obj, ".ply": _ply, ".stl": _stl}
    extension = path[path.rfind(".") :].lower()
    if extension in (".gltf", ".glb"):
        raise Unsupported(f"{path}: this driver does not read glTF")
    if extension not in readers:
        raise SceneError(f"{path}: expected a file ending in {', '.join(readers)}, .gltf or .glb")
    try:
        with open(path, "rb") as file:
            data = file.read()
        return readers[extension](data)
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror}") from error
    except (ValueError, IndexError, KeyError, struct.error) as error:
        raise SceneError(f"{path}: {error}") from error


def _fan(ring: Sequence[int]) -> List[Tuple[int, int, int]]:
    return [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]


def _obj(data: bytes) -> Mesh:
    lists: Dict[str, List[Tuple[float, ...]]] = {"v": [], "vt": [], "vn": []}
    most = {name: -1 for name in lists}
    corners: List[List[Corner]] = [[], [], []]
    # A byte order mark is no text.
    text = data.decode("utf-8-sig", "replace").replace("\\\n", " ")
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words and words[0] in lists:
            lists[words[0]].append(tuple(map(float, words[1 : 3 if words[0] == "vt" else 4])))
        elif words and words[0] == "f":
            ring = [(word + "//").split("/")[:3] for word in words[1:]]
            for kind, name in enumerate(("v", "vt", "vn")):
                named = [corner[kind] for corner in ring]
                if not all(named):
                    corners[kind] += [None] * (len(ring) - 2)
                    continue
                count = len(lists[name])
                # Only numbers from the end count from what comes before the face.
                numbers = [int(word) - 1 if int(word) >= 0 else count + int(word) for word in named]
                if min(numbers) < 0:
                    raise ValueError(f"a face refers to a {name} that does not exist")
                most[name] = max(most[name], *numbers)
                corners[kind] += _fan(numbers)
    for name, largest in most.items():
        if largest >= len(lists[name]):
            raise ValueError(f"a face refers to a {name} that does not exist")
    faces = [face for face in corners[0] if face is not None]
    if len(faces) < len(corners[0]):
        raise ValueError("a corner of a face has no vertex")
    return Mesh(lists["v"], lists["vn"], lists["vt"], faces, corners[2], corners[1])


_FORMATS = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip


def _ply(data: bytes) -> Mesh:
    end = data.index(b"end_header")
    header = data[:end].decode("ascii", "replace").split("\n")
    at = data.index(b"\n", end) + 1
    form = ""
    elements: List[Tuple[str, int, List[List[str]]]] = []
    for words in (line.split() for line in header):
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    lines = iter(data[at:].decode("ascii", "replace").splitlines()) if form == "ascii" else iter(())
    order = ">" if form == "binary_big_endian" else "<"
    columns: Dict[str, List[float]] = {}
    faces: List[Tuple[int, int, int]] = []
    for name, count, properties in elements:
        for _ in range(count):
            numbers: Iterator[str] = iter(next(lines).split()) if form == "ascii" else iter(())

            def take(kind: str, numbers: Iterator[str] = numbers) -> float:
                nonlocal at
                if form == "ascii":
                    return float(next(numbers))
                (value,) = struct.unpack_from(order + _FORMATS[kind], data, at)
                at += struct.calcsize(order + _FORMATS[kind])
                return value

            for entry in properties:
                if entry[0] == "list":
                    ring = [int(take(entry[2])) for _ in range(int(take(entry[1])))]
                    if name == "face" and entry[-1] in ("vertex_indices", "vertex_index"):
                        faces += _fan(ring)
                else:
                    value = take(entry[0])
                    if name == "vertex":
                        columns.setdefault(entry[-1], []).append(value)

    def stack(*names: str) -> List[Tuple[float, ...]]:
        return list(zip(*(columns[name] for name in names))) if all(name in columns for name in names) else []

    positions, normals = stack("x", "y", "z"), stack("nx", "ny", "nz")
    uvs = stack("u", "v") or stack("s", "t") or stack("texture_u", "texture_v")
    if not all(0 <= corner < len(positions) for face in faces for corner in face):
        raise ValueError("a face refers to a vertex that does not exist")
    none: List[Corner] = [None] * len(faces)
    return Mesh(positions, normals, uvs, faces, list(faces) if normals else none, list(faces) if uvs else none)


def _stl(data: bytes) -> Mesh:
    points: List[Tuple[float, ...]] = []
    size = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * size:
        for number in range(size):
            corners = struct.unpack_from("<9f", data, 84 + 50 * number + 12)
            points += [corners[0:3], corners[3:6], corners[6:9]]
    else:
        open_ = False
        lines = data.decode("utf-8", "replace").strip().splitlines()
        if len(lines) == 1:
            # In a file of a single line each keyword begins one.
            starts = ("facet", "vertex", "endfacet", "endsolid")
            broken = [("\n" if word.lower() in starts else " ") + word for word in lines[0].split()]
            lines = "".join(broken).splitlines()
        for line in lines:
            words = line.lower().split()
            if words[:1] == ["vertex"] and open_:
                points.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[:1] == ["facet"]:
                open_ = True
            elif words[:1] == ["endfacet"]:
                open_ = False
                if len(points) % 3:
                    raise ValueError("a facet without three vertices")
    if not points or len(points) % 3:
        raise ValueError("expected facets with three vertices each")
    faces = [(k, k + 1, k + 2) for k in range(0, len(points), 3)]
    none: List[Corner] = [None] * len(faces)
    return Mesh(points, [], [], faces, none, list(none))


def closed(mesh: Mesh) -> bool:
    """Whether the mesh is closed and oriented outwards: every edge, identified by the positions of
    its ends, occurs once in each direction.
    """
    places: Dict[Tuple[float, ...], int] = {}
    number = [places.setdefault(position, len(places)) for position in mesh.positions]
    edges: Counter = Counter()
    volume = 0.0
    for face in mesh.faces:
        a, b, c = (number[corner] for corner in face)
        if len({a, b, c}) == 3:
            edges.update([(a, b), (b, c), (c, a)])
        p, q, r = (mesh.positions[corner] for corner in face)
        volume += dot(p, cross(q, r))
    return bool(edges) and volume > 0 and all(count == 1 and edges[b, a] == 1 for (a, b), count in edges.items())


def rounding(setting: Setting) -> Callable[[float], float]:
    """How a number is converted to single precision: unchanged, for POV-Ray to round, or randomly
    down or up (equal numbers to equal results).
    """
    if not setting.vertices:
        return lambda value: value

    def rounded(value: float) -> float:
        (near,) = struct.unpack("<f", struct.pack("<f", value))
        if near == value:
            return value
        (bits,) = struct.unpack("<i", struct.pack("<f", near))
        # The other neighbour: one step of the bits towards the value.
        step = 1 if (value > near) == (near >= 0) else -1
        (other,) = struct.unpack("<f", struct.pack("<i", bits + step))
        return other if hash((setting.seed, value)) & 1 else near

    return rounded
