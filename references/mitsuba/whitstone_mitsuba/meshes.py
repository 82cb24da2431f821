"""Reads triangles from mesh files exactly as the model specifies (§9): in file order, polygons as
fans, nothing dropped or merged. `gltf` decodes glTF.

Mitsuba's own loaders are not used, because triangle numbers and missing normals must follow the
model: these loaders add smooth normals to files without any, flip v in OBJ files and split groups.
A test compares both on files where they must agree.
"""

from __future__ import annotations

import functools
import os
import re
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from whitstone_protocol.errors import SceneError, Unsupported

from . import gltf
from .files import Folder

# Upper bound on the triangles of a mesh of glTF, whose accessors need no data.
MAX_TRIANGLES = 2**23


@dataclass
class Triangles:
    """Vertices (n, 3) float64, triangles (m, 3), and normals and uv per vertex if the file has
    them.
    """

    positions: np.ndarray
    faces: np.ndarray
    normals: Optional[np.ndarray] = None
    uvs: Optional[np.ndarray] = None
    # Vertex colours, RGBA; the second set of texture coordinates; tangents X, all per vertex.
    colors: Optional[np.ndarray] = None
    second: Optional[np.ndarray] = None
    tangents: Optional[np.ndarray] = None
    # The sign h of the bitangent, per triangle.
    signs: Optional[np.ndarray] = None
    # The vertex of the file, per vertex, if several vertices here are one in the file.
    origin: Optional[np.ndarray] = None


@dataclass(frozen=True)
class Wanted:
    """The parts of a file that are read, in addition to positions and normals."""

    uv_sets: Tuple[int, ...] = (0,)
    colors: bool = False
    tangents: bool = False
    # For OBJ: only the faces of this material.
    part: Optional[str] = None
    # The rest is for glTF.
    mesh: int = 0
    primitive: int = 0
    skin: Optional[int] = None
    weights: Optional[Tuple[float, ...]] = None


EXTENSIONS = (".obj", ".ply", ".stl", ".gltf", ".glb")


def load(path: str, wanted: Optional[Wanted] = None, base: Optional[Folder] = None) -> Triangles:
    """The triangles of a mesh file. The last few files are cached until they change. `base` records
    the files that it refers to.
    """
    wanted = wanted or Wanted()
    if os.path.splitext(path)[1].lower() not in EXTENSIONS:
        raise SceneError(f"{path}: expected a file ending in {', '.join(EXTENSIONS)}")
    if gltf.is_file(path):
        return _gltf(path, wanted, base)
    try:
        status = os.stat(path)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if wanted.uv_sets not in ((), (0,)):
        raise SceneError(f"{path}: has no sets of texture coordinates except 0; only glTF has others")
    found = _load(path, status.st_mtime_ns, status.st_size, wanted.part)
    found = replace(found, uvs=found.uvs if wanted.uv_sets else None, colors=found.colors if wanted.colors else None)
    if wanted.colors and found.colors is None:
        found.colors = np.ones((len(found.positions), 4))
    if found.colors is not None and not np.all(np.isfinite(found.colors)):
        raise SceneError(f"{path}: has colours that are not finite")
    if wanted.tangents:
        found.tangents, found.signs = tangents(found)
    return found


def _checked(path: str, triangles: Triangles) -> Triangles:
    if not np.all(np.isfinite(triangles.positions)):
        raise SceneError(f"{path}: has vertices that are not finite")
    return triangles


def _gltf(path: str, wanted: Wanted, base: Optional[Folder]) -> Triangles:
    """A primitive of a glTF file, morphed and skinned."""
    file = gltf.load(path)
    try:
        part = gltf.Primitive(file, wanted.mesh, wanted.primitive, MAX_TRIANGLES)
        weights = part.weights(None if wanted.weights is None else list(wanted.weights))
        positions = part.morphed("POSITION", part.read("POSITION", "VEC3"), weights)
        assert positions is not None, "a primitive has positions"
        found = Triangles(positions, part.faces, part.morphed("NORMAL", part.read("NORMAL", "VEC3"), weights))
        sets = [part.read(f"TEXCOORD_{number}", "VEC2") for number in wanted.uv_sets]
        # Here v points up.
        flipped = [None if uv is None else np.column_stack([uv[:, 0], 1 - uv[:, 1]]) for uv in sets]
        found.uvs = flipped[0] if flipped else None
        found.second = flipped[1] if len(flipped) > 1 else None
        if wanted.colors:
            colors = part.read("COLOR_0", "VEC3", "VEC4")
            found.colors = np.ones((len(positions), 4))
            if colors is not None:
                found.colors[:, : colors.shape[1]] = np.clip(colors, 0.0, 1.0)
        if wanted.tangents:
            # TANGENT counts only next to NORMAL.
            stored = None if found.normals is None else part.read("TANGENT", "VEC4")
            if stored is None:
                found.tangents, found.signs = tangents(found)
            else:
                found.tangents = part.morphed("TANGENT", stored, weights)
                found.signs = _sign(stored[part.faces[:, 0], 3])
        if wanted.skin is not None:
            matrices = part.skinning(wanted.skin)
            found.positions = np.einsum("nij,nj->ni", matrices[:, :, :3], positions) + matrices[:, :, 3]
            for name in ("normals", "tangents"):
                values = getattr(found, name)
                if values is not None:
                    setattr(found, name, gltf.directions(values, matrices[:, :, :3], name == "normals"))
    except gltf.TooMany as error:
        raise Unsupported(f"{path}: no twin for more than {MAX_TRIANGLES} triangles, found {error.triangles}") from error
    finally:
        if base is not None:
            base.note(file.stamps)
    return _checked(path, found)


def _sign(values: np.ndarray) -> np.ndarray:
    """1 or -1; 1 for 0."""
    return np.where(values < 0, -1.0, 1.0)


def tangents(triangles: Triangles) -> Tuple[np.ndarray, np.ndarray]:
    """The model's mesh tangents (§8): (n, 3) X of the vertices, not normalised, and (m,) h of the
    triangles.
    """
    count = len(triangles.positions)
    if triangles.uvs is None:
        return np.zeros((count, 3)), np.ones(len(triangles.faces))
    a, b, c = np.moveaxis(triangles.positions[triangles.faces], 1, 0)
    uv_a, uv_b, uv_c = np.moveaxis(triangles.uvs[triangles.faces], 1, 0)
    (u1, v1), (u2, v2) = (uv_b - uv_a).T, (uv_c - uv_a).T
    d = u1 * v2 - u2 * v1
    along = (v2[:, None] * (b - a) - v1[:, None] * (c - a)) * np.sign(d)[:, None]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    # Vertices that are one in the file have one tangent.
    origin = np.arange(count) if triangles.origin is None else triangles.origin
    total = np.zeros((int(origin.max()) + 1, 3))
    for corner in range(3):
        np.add.at(total, origin[triangles.faces[:, corner]], along)
    return total[origin], _sign(d)


@functools.lru_cache(maxsize=8)
def _load(path: str, modified: int, size: int, part: Optional[str]) -> Triangles:
    """Reads the file; `modified` and `size` are only part of the cache key."""
    reader = _READERS[os.path.splitext(path)[1].lower()]
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        triangles = reader(data) if part is None else _obj(data, part)
    except (ValueError, IndexError, KeyError, TypeError, OverflowError, MemoryError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: is malformed: {error}") from error
    if len(triangles.faces) == 0:
        raise SceneError(f"{path}: has no faces" + ("" if part is None else f" of the part {part!r}"))
    if triangles.faces.min() < 0 or triangles.faces.max() >= len(triangles.positions):
        raise SceneError(f"{path}: a face refers to a vertex that does not exist")
    return _checked(path, triangles)


def _decoded(name: bytes) -> str:
    """A name, which may be in any encoding: UTF-8, else each byte is a character of Latin-1."""
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")


def _obj(data: bytes, part: Optional[str] = None) -> Triangles:
    """Wavefront OBJ: v, vt, vn, f; everything else is ignored. With `part` only the faces after
    `usemtl` with this name, or before any for an empty one.
    """
    material = ""
    points: List[List[float]] = []
    texcoords: List[List[float]] = []
    normals: List[List[float]] = []
    corners: List[Tuple[int, int, int]] = []
    colors: Dict[int, List[float]] = {}
    most = [-1, -1, -1]

    def corner(text: bytes) -> List[int]:
        """Indices into v, vt, vn, counted from 0; -1 if missing. Negative numbers in the file count
        back from the line of the face. Positive ones count from the start of the file, and their
        lines may come after the face.
        """
        found = [-1, -1, -1]
        for place, (part, pool) in enumerate(zip(text.split(b"/"), (points, texcoords, normals))):
            if part:
                number = int(part)
                found[place] = number - 1 if number > 0 else len(pool) + number
                if number == 0 or found[place] < 0:
                    raise ValueError(f"index {number} in a face is out of range")
                most[place] = max(most[place], found[place])
        if found[0] < 0:
            raise ValueError("a corner of a face has no vertex index")
        return found

    # A byte order mark is no text.
    data = data[3:] if data[:3] == b"\xef\xbb\xbf" else data
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.split(b"#", 1)[0].split()
        if not words:
            continue
        if words[0] == b"usemtl":
            material = _decoded(line.strip()[len("usemtl") :].strip())
        elif words[0] == b"v":
            if len(words) >= 7:
                colors[len(points)] = [float(word) for word in words[4:7]]
            points.append([float(word) for word in words[1:4]])
        elif words[0] == b"vt":
            texcoords.append([float(word) for word in (words[1:3] + [b"0"])[:2]])
        elif words[0] == b"vn":
            normals.append([float(word) for word in words[1:4]])
        elif words[0] == b"f":
            ring = [corner(word) for word in words[1:]]
            if len(ring) < 3:
                raise ValueError("a face has fewer than three corners")
            if part is not None and part != material:
                continue
            # A face has normals or texture coordinates only if all its corners do.
            for place in (1, 2):
                if any(found[place] < 0 for found in ring):
                    for found in ring:
                        found[place] = -1
            whole = [(found[0], found[1], found[2]) for found in ring]
            for second in range(1, len(whole) - 1):
                corners += [whole[0], whole[second], whole[second + 1]]
    for largest, pool in zip(most, (points, texcoords, normals)):
        if largest >= len(pool):
            raise ValueError(f"index {largest + 1} in a face is out of range")
    indices = np.array(corners, dtype=np.int64).reshape(-1, 3)
    has_uv, has_normals = bool((indices[:, 1] >= 0).any()), bool((indices[:, 2] >= 0).any())
    colored = None
    if colors:
        colored = np.ones((len(points), 4))
        colored[list(colors), :3] = list(colors.values())
    if not has_uv and not has_normals:
        return Triangles(np.array(points), indices[:, 0].reshape(-1, 3), colors=colored)
    named = len(normals)
    if has_normals and (indices[:, 2] < 0).any():
        # In a file with normals, a triangle without them gets its geometric normal, as a new entry.
        flat = np.flatnonzero((indices[:, 2].reshape(-1, 3) < 0).any(axis=1))
        a, b, c = (np.array(points)[indices[:, 0].reshape(-1, 3)[flat, k]] for k in range(3))
        new = np.cross(b - a, c - a)
        for place, triangle in enumerate(flat):
            indices[3 * triangle : 3 * triangle + 3, 2] = len(normals) + place
        normals += new.tolist()
    # One vertex for each combination of indices that occurs.
    unique, inverse = np.unique(indices, axis=0, return_inverse=True)
    result = Triangles(np.array(points)[unique[:, 0]], np.asarray(inverse).reshape(-1, 3))
    if has_uv:
        pool = np.vstack([np.array(texcoords), [[0.0, 0.0]]])  # index -1: (0, 0)
        result.uvs = pool[unique[:, 1]]
    if has_normals:
        result.normals = np.array(normals)[unique[:, 2]]
    if colored is not None:
        result.colors = colored[unique[:, 0]]
    if len(normals) > named:
        # For the file, missing normals are the same index.
        missing = np.where(unique[:, 2:] < named, unique[:, 2:], -1)
        result.origin = np.unique(np.hstack([unique[:, :2], missing]), axis=0, return_inverse=True)[1].reshape(-1)
    return result


_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip


_CHANNELS = ("red", "green", "blue", "alpha")


def _ply_header(data: bytes) -> Tuple[str, List[Tuple[str, int, List[Tuple[str, ...]]]], int]:
    """Format, elements (name, count, properties) and the offset of the body."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("not a PLY header")
    body = data.index(b"\n", end) + 1
    form = ""
    elements: List[Tuple[str, int, List[Tuple[str, ...]]]] = []
    # Comments may be in any encoding.
    for line in data[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            if any(name == words[1] for name, _, _ in elements):
                raise ValueError(f"the header declares the element {words[1]} twice")
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            if any(entry[-1] == words[-1] for entry in elements[-1][2]):
                raise ValueError(f"the header declares the property {words[-1]} of {elements[-1][0]} twice")
            elements[-1][2].append(tuple(words[1:]))
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise ValueError(f"unknown PLY format {form!r}")
    return form, elements, body


def _ply(data: bytes) -> Triangles:
    """Stanford PLY: elements `vertex` and `face`; others are skipped."""
    form, elements, offset = _ply_header(data)
    words = data[offset:].split() if form == "ascii" else None
    order = ">" if form == "binary_big_endian" else "<"
    position = 0 if words is not None else offset
    columns: Dict[str, np.ndarray] = {}
    faces: List[List[int]] = []
    triangles: Optional[np.ndarray] = None

    kinds: Dict[str, str] = {}
    for name, count, properties in elements:
        if not 0 <= count <= len(data) and properties:
            raise ValueError(f"the header gives {count} elements {name}, more than the file has bytes")
        if name == "vertex":
            kinds = {entry[-1]: _PLY_TYPES[entry[0]] for entry in properties if entry[0] != "list"}
        lists = [entry for entry in properties if entry[0] == "list"]
        if not lists:
            if words is not None:
                size = count * len(properties)
                table = np.array(words[position : position + size], dtype=np.float64).reshape(count, len(properties))
                position += size
                read = {entry[-1]: table[:, column] for column, entry in enumerate(properties)}
            else:
                kind = np.dtype([(entry[-1], order + _PLY_TYPES[entry[0]]) for entry in properties])
                rows = np.frombuffer(data, kind, count, position)
                position += kind.itemsize * count
                read = {entry[-1]: rows[entry[-1]].astype(np.float64) for entry in properties}
            if name == "vertex":
                columns = read
            continue
        if words is None and len(lists) == 1 and name == "face":
            # Fast path for the common case: every face is a triangle.
            kind = np.dtype(
                [
                    item
                    for entry in properties
                    for item in (
                        [("count", order + _PLY_TYPES[entry[1]]), ("corners", order + _PLY_TYPES[entry[2]], 3)]
                        if entry[0] == "list"
                        else [(entry[-1], order + _PLY_TYPES[entry[0]])]
                    )
                ]
            )
            if position + kind.itemsize * count <= len(data):
                rows = np.frombuffer(data, kind, count, position)
                if (rows["count"] == 3).all():
                    triangles = rows["corners"].astype(np.int64)
                    position += kind.itemsize * count
                    continue
        read = {entry[-1]: np.empty(count) for entry in properties if entry[0] != "list"}
        for row in range(count):
            for entry in properties:
                length = 1
                if entry[0] == "list":
                    (length,), position = _ply_values(data, words, position, order, entry[1], 1)
                values, position = _ply_values(data, words, position, order, entry[-2], int(length))
                if entry[0] != "list":
                    read[entry[-1]][row] = values[0]
                elif name == "face" and entry[-1] in ("vertex_indices", "vertex_index"):
                    faces.append([int(value) for value in values])
        if name == "vertex":
            columns = read
    if triangles is None:
        if any(len(ring) < 3 for ring in faces):
            raise ValueError("a face has fewer than three corners")
        fans = [(ring[0], ring[k], ring[k + 1]) for ring in faces for k in range(1, len(ring) - 1)]
        triangles = np.array(fans, dtype=np.int64).reshape(-1, 3)

    def stack(*names: str) -> Optional[np.ndarray]:
        return np.column_stack([columns[name] for name in names]) if all(name in columns for name in names) else None

    positions = stack("x", "y", "z")
    if positions is None:
        raise ValueError("the vertices have no x, y, z")
    uvs = None
    for pair in (("u", "v"), ("s", "t"), ("texture_u", "texture_v")):
        uvs = stack(*pair) if uvs is None else uvs
    colors = None
    if any(name in columns for name in _CHANNELS):
        colors = np.ones((len(positions), 4))
        for channel, name in enumerate(_CHANNELS):
            if name in columns:
                largest = np.iinfo(kinds[name]).max if kinds[name][0] in "iu" else 1
                colors[:, channel] = columns[name] / largest
    return Triangles(positions, triangles, stack("nx", "ny", "nz"), uvs, colors)


def _ply_values(
    data: bytes, words: Optional[List[bytes]], position: int, order: str, kind: str, count: int
) -> Tuple[np.ndarray, int]:
    """The next `count` numbers, and the offset after them."""
    if words is not None:
        if position + count > len(words):
            raise ValueError("the file ends too early")
        return np.array(words[position : position + count], dtype=np.float64), position + count
    dtype = np.dtype(order + _PLY_TYPES[kind])
    return np.frombuffer(data, dtype, count, position), position + count * dtype.itemsize


def _stl(data: bytes) -> Triangles:
    """STL, binary or text: every facet has three vertices of its own."""
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            rows = np.frombuffer(data, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]), count, 84)
            corners = rows["corners"].astype(np.float64)
            return Triangles(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    lines = data.decode("utf-8", "replace").strip().splitlines()
    if len(lines) == 1:
        # In a file of a single line each keyword begins one.
        lines = re.sub(r"\s(facet|outer|vertex|endloop|endfacet|endsolid)(?!\S)", r"\n\1", lines[0], flags=re.IGNORECASE).splitlines()
    if not any(line.split()[:1] and line.split()[0].lower() == "solid" for line in lines[:100]):
        raise ValueError("neither binary STL of the length that its header gives, nor text")
    words: List[str] = []
    for line in lines:
        found = line.lower().split()
        # Names may contain any word.
        if found and found[0] not in ("solid", "endsolid"):
            words += found
    points: List[List[float]] = []
    before, after = ["outer", "loop"], ["endloop", "endfacet"]
    for at in range(0, len(words), 21):
        facet = words[at : at + 21]
        marks = [facet[7 + 4 * corner : 8 + 4 * corner] for corner in range(3)]
        if facet[:2] != ["facet", "normal"] or facet[5:7] != before or marks != [["vertex"]] * 3 or facet[19:] != after:
            raise ValueError(f"facet {at // 21}: expected a normal and a loop of three vertices")
        points += [[float(word) for word in facet[8 + 4 * corner : 11 + 4 * corner]] for corner in range(3)]
    return Triangles(np.array(points).reshape(-1, 3), np.arange(len(points)).reshape(-1, 3))


def _lowbias(x: np.ndarray) -> np.ndarray:
    """The hash m of the model."""
    x = x ^ (x >> np.uint32(16))
    x = x * np.uint32(0x7FEB352D)
    x = x ^ (x >> np.uint32(15))
    x = x * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def _words(values: np.ndarray) -> np.ndarray:
    """Modulo 2^32."""
    return (np.asarray(values, dtype=np.uint64) & np.uint64(0xFFFFFFFF)).astype(np.uint32)


def _lattice(octave: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Pseudo-random values in [-1, 1) at the points of a lattice."""
    line = _lowbias(_words(octave + rows.astype(np.uint64)))
    return _lowbias(_words(line[:, None].astype(np.uint64) + columns.astype(np.uint64)[None, :])) / 2.0**31 - 1.0


def noise_heights(columns: int, rows: int, amplitude: float, hills: int, octaves: int, seed: int) -> np.ndarray:
    """The heights of the model's procedural height field: (rows + 1, columns + 1)."""
    i, j = np.arange(columns + 1), np.arange(rows + 1)
    z = np.zeros((rows + 1, columns + 1))
    for k in range(octaves):
        count = hills * 2**k
        p, q = i * count / columns, j * count / rows
        left, low = np.floor(p), np.floor(q)
        u, v = (t * t * (3.0 - 2.0 * t) for t in (p - left, q - low))
        octave = _lowbias(_words(np.array([seed], dtype=np.uint64) + _lowbias(_words(np.array([k])))))

        # The values at the four corners of each cell, named by row and column.
        v00, v01, v10, v11 = (_lattice(octave, low + up, left + right) for up in (0, 1) for right in (0, 1))
        near = v00 + u[None, :] * (v01 - v00)
        far = v10 + u[None, :] * (v11 - v10)
        z += amplitude * 0.5**k * (near + v[:, None] * (far - near))
    return z


def heightfield_points(columns: int, rows: int) -> Tuple[np.ndarray, np.ndarray]:
    """The vertices of a height field row by row: (n, 3) points with z = 0 and (n, 2) coordinates.
    """
    i, j = np.arange(columns + 1), np.arange(rows + 1)
    x, y = np.meshgrid(2.0 * i / columns - 1.0, 2.0 * j / rows - 1.0)
    u, v = np.meshgrid(i / columns, j / rows)
    return np.stack([x, y, 0 * x], axis=2).reshape(-1, 3), np.stack([u, v], axis=2).reshape(-1, 2)


def heightfield(z: np.ndarray) -> Triangles:
    """The model's height field with these heights: (rows + 1, columns + 1)."""
    rows, columns = z.shape[0] - 1, z.shape[1] - 1
    positions = heightfield_points(columns, rows)[0]
    positions[:, 2] = z.reshape(-1)
    positions = positions.astype(np.float32).astype(np.float64)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    faces = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    return Triangles(positions, faces)


_READERS = {".obj": _obj, ".ply": _ply, ".stl": _stl}
