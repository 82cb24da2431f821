"""Reads triangles from OBJ and PLY files exactly as the model specifies (§9): in file order,
polygons as fans, nothing dropped or merged.

Mitsuba's own loaders are not used, because triangle numbers and missing normals must follow the
model: these loaders add smooth normals to files without any, flip v in OBJ files and split groups.
A test compares both on files where they must agree.
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np

from .errors import SceneError


@dataclass
class Triangles:
    """Vertices (n, 3) float64, triangles (m, 3), and normals and uv per vertex if the file has
    them.
    """

    positions: np.ndarray
    faces: np.ndarray
    normals: Optional[np.ndarray] = None
    uvs: Optional[np.ndarray] = None


def load(path: str) -> Triangles:
    """The triangles of an .obj or .ply file. The last few files are cached until they change."""
    if os.path.splitext(path)[1].lower() not in _READERS:
        raise SceneError(f"{path}: expected a file ending in .obj or .ply")
    try:
        status = os.stat(path)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    return _load(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=8)
def _load(path: str, modified: int, size: int) -> Triangles:
    """Reads the file; `modified` and `size` are only part of the cache key."""
    reader = _READERS[os.path.splitext(path)[1].lower()]
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        triangles = reader(data)
    except (ValueError, IndexError, KeyError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: is malformed: {error}") from error
    if len(triangles.faces) == 0:
        raise SceneError(f"{path}: has no faces")
    if triangles.faces.min() < 0 or triangles.faces.max() >= len(triangles.positions):
        raise SceneError(f"{path}: a face refers to a vertex that does not exist")
    if not np.all(np.isfinite(triangles.positions)):
        raise SceneError(f"{path}: has vertices that are not finite")
    return triangles


def _obj(data: bytes) -> Triangles:
    """Wavefront OBJ: v, vt, vn, f; everything else is ignored."""
    points: List[List[float]] = []
    texcoords: List[List[float]] = []
    normals: List[List[float]] = []
    corners: List[Tuple[int, int, int]] = []

    def corner(text: str) -> Tuple[int, int, int]:
        """Indices into v, vt, vn, counted from 0; -1 if missing. Negative ones in the file count
        from the end.
        """
        found = [-1, -1, -1]
        for place, (part, pool) in enumerate(zip(text.split("/"), (points, texcoords, normals))):
            if part:
                number = int(part)
                found[place] = number - 1 if number > 0 else len(pool) + number
                if not 0 <= found[place] < len(pool):
                    raise ValueError(f"index {number} in a face is out of range")
        if found[0] < 0:
            raise ValueError("a corner of a face has no vertex index")
        return found[0], found[1], found[2]

    for line in data.decode("utf-8", "replace").replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            points.append([float(word) for word in words[1:4]])
        elif words[0] == "vt":
            texcoords.append([float(word) for word in (words[1:3] + ["0"])[:2]])
        elif words[0] == "vn":
            normals.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            ring = [corner(word) for word in words[1:]]
            if len(ring) < 3:
                raise ValueError("a face has fewer than three corners")
            for second in range(1, len(ring) - 1):
                corners += [ring[0], ring[second], ring[second + 1]]
    indices = np.array(corners, dtype=np.int64).reshape(-1, 3)
    has_uv, has_normals = bool((indices[:, 1] >= 0).any()), bool((indices[:, 2] >= 0).any())
    if not has_uv and not has_normals:
        return Triangles(np.array(points), indices[:, 0].reshape(-1, 3))
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
    return result


_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip


def _ply_header(data: bytes) -> Tuple[str, List[Tuple[str, int, List[Tuple[str, ...]]]], int]:
    """Format, elements (name, count, properties) and the offset of the body."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("not a PLY header")
    body = data.index(b"\n", end) + 1
    form, elements = "", []
    for line in data[:end].decode("ascii").splitlines():
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

    for name, count, properties in elements:
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
    return Triangles(positions, triangles, stack("nx", "ny", "nz"), uvs)


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


def heightfield(columns: int, rows: int, amplitude: float, hills: int, octaves: int, seed: int) -> Triangles:
    """The model's procedural height field."""
    i, j = np.arange(columns + 1), np.arange(rows + 1)
    z = np.zeros((rows + 1, columns + 1))
    for k in range(octaves):
        count = hills * 2**k
        p, q = i * count / columns, j * count / rows
        left, low = np.floor(p), np.floor(q)
        u, v = (t * t * (3.0 - 2.0 * t) for t in (p - left, q - low))
        octave = _lowbias(_words(np.array([seed], dtype=np.uint64) + _lowbias(_words(np.array([k])))))

        def value(right: int, up: int) -> np.ndarray:
            line = _lowbias(_words(octave + (low + up).astype(np.uint64)))
            return _lowbias(_words(line[:, None].astype(np.uint64) + (left + right).astype(np.uint64)[None, :])) / 2.0**31 - 1.0

        near = value(0, 0) + u[None, :] * (value(1, 0) - value(0, 0))
        far = value(0, 1) + u[None, :] * (value(1, 1) - value(0, 1))
        z += amplitude * 0.5**k * (near + v[:, None] * (far - near))
    x, y = np.meshgrid(2.0 * i / columns - 1.0, 2.0 * j / rows - 1.0)
    positions = np.stack([x, y, z], axis=2).reshape(-1, 3).astype(np.float32).astype(np.float64)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    faces = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
    return Triangles(positions, faces)


_READERS = {".obj": _obj, ".ply": _ply}
