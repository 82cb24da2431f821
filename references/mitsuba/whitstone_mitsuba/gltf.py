"""glTF 2.0 files (model §9, *Mesh files*): JSON, GLB, buffers, accessors, nodes and images.

Numbers from a file are checked before they are used: memory is allocated only for data that the
file contains. (Accessors without a buffer view are the exception; their length is limited.) Errors
name the file and the JSON pointer of the property.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import os
import re
import struct
from typing import Any, Dict, List, NoReturn, Optional, Tuple
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from whitstone_protocol.errors import SceneError

from .files import stamp

# Upper bound on the elements of an accessor without a buffer view.
MAX_ZEROS = 2**27

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
UNSIGNED = (5121, 5123, 5125)
TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

# Required extensions that replace the vertices or indices of primitives.
REPLACING = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")

_JSON, _BIN = 0x4E4F534A, 0x004E4942


def is_file(path: str) -> bool:
    """Whether the extension is one of glTF."""
    return os.path.splitext(path)[1].lower() in (".gltf", ".glb")


def _constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


class Node:
    """A JSON object with its pointer. `fail` raises errors that name the file and the pointer."""

    def __init__(self, path: str, value: Any, pointer: str) -> None:
        self.path, self.pointer = path, pointer
        if not isinstance(value, dict):
            self.fail(None, "expected an object")
        self.value: Dict[str, Any] = value

    def fail(self, key: Optional[str], text: str) -> NoReturn:
        """Raises an error about a property, or about the whole object."""
        pointer = self.pointer + ("" if key is None else f"/{key}")
        raise SceneError(f"{self.path}: {pointer or '/'}: {text}")

    def has(self, key: str) -> bool:
        return key in self.value

    def integer(self, key: str, default: Optional[int] = None, low: int = 0, high: int = 2**53) -> int:
        """An integer in [low, high]. (JSON does not distinguish 1.0 from 1.)"""
        value = self.value.get(key, default)
        if value is None:
            self.fail(key, "is required")
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            self.fail(key, f"expected an integer from {low} to {high}, found {_short(value)}")
        return value

    def numbers(self, key: str, count: Optional[int] = None) -> Optional[List[float]]:
        """A list of finite numbers, of this length if it is given; None if there is none."""
        value = self.value.get(key)
        if value is None:
            return None
        good = isinstance(value, list) and (count is None or len(value) == count)
        if not good or not all(isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) < 1e300 for x in value):
            self.fail(key, f"expected {'' if count is None else f'{count} '}finite numbers")
        return [float(x) for x in value]

    def list(self, key: str) -> List[Any]:
        """A list; empty if there is none."""
        value = self.value.get(key, [])
        if not isinstance(value, list):
            self.fail(key, "expected an array")
        return value

    def child(self, key: str) -> "Node":
        """The object under a key, which is required."""
        if key not in self.value:
            self.fail(key, "is required")
        return Node(self.path, self.value[key], f"{self.pointer}/{key}")

    def item(self, key: str, index: int) -> "Node":
        """An object of a list, which must have it."""
        found = self.list(key)
        if index >= len(found):
            self.fail(key, f"has no entry {index}, only {len(found)}")
        return Node(self.path, found[index], f"{self.pointer}/{key}/{index}")

    def string(self, key: str) -> Optional[str]:
        value = self.value.get(key)
        if value is not None and not isinstance(value, str):
            self.fail(key, f"expected a string, found {_short(value)}")
        return value


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class Gltf:
    """A file with everything that it refers to, which is read when it is needed."""

    def __init__(self, path: str) -> None:
        self.path = path
        # The files that were read, with their state at that time.
        self.stamps: Dict[str, Any] = {}
        data = self._read(path)
        self._bin: Optional[bytes] = None
        self._buffers: Dict[int, bytes] = {}
        if data[:4] == b"glTF":
            data = self._chunks(data)
        elif os.path.splitext(path)[1].lower() == ".glb":
            raise SceneError(f"{path}: is malformed: not a GLB header")
        try:
            # A byte order mark is no text.
            value = json.loads(data.decode("utf-8-sig"), parse_constant=_constant)
        except (ValueError, RecursionError) as error:
            raise SceneError(f"{path}: is malformed: not valid JSON: {str(error)[:200]}") from error
        self.root = Node(path, value, "")
        version = self.root.child("asset").string("version")
        if version is None or not re.fullmatch(r"2\.\d+", version):
            self.root.child("asset").fail("version", f"expected glTF 2.0, found {_short(version)}")

    # ---- files
    # ----------------------------------------------------------------------------------------------

    def _read(self, path: str) -> bytes:
        try:
            self.stamps[path] = stamp(path)
            with open(path, "rb") as file:
                return file.read()
        except OSError as error:
            raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise SceneError(f"{path!r}: cannot be read: {error}") from error

    def _chunks(self, data: bytes) -> bytes:
        """The JSON of a GLB; keeps its binary chunk."""

        def malformed(text: str) -> NoReturn:
            raise SceneError(f"{self.path}: is malformed: {text}")

        if len(data) < 20:
            malformed("the file ends in the GLB header")
        _, version, length = struct.unpack_from("<4sII", data)
        if version != 2:
            malformed(f"expected GLB version 2, found {version}")
        if length > len(data):
            malformed(f"the header gives a length of {length} bytes, the file has {len(data)}")
        at, chunks = 12, []
        while at < length:
            if at + 8 > length:
                malformed("the file ends in the header of a chunk")
            size, kind = struct.unpack_from("<II", data, at)
            if at + 8 + size > length:
                malformed(f"a chunk of {size} bytes reaches beyond the end of the file")
            chunks.append((kind, data[at + 8 : at + 8 + size]))
            at += 8 + size
        if chunks[0][0] != _JSON:
            malformed("the first chunk is not JSON")
        if len(chunks) > 1 and chunks[1][0] == _BIN:
            self._bin = chunks[1][1]
        return chunks[0][1]

    def _uri(self, node: Node, uri: str) -> bytes:
        """The data of a URI: a data URI, or a file relative to this one."""
        if uri[:5].lower() == "data:":
            head, comma, body = uri[5:].partition(",")
            if not comma:
                node.fail("uri", "a data URI without a comma")
            raw = unquote_to_bytes(body)
            if not head.lower().endswith(";base64"):
                return raw
            try:
                return base64.b64decode(raw, validate=True)
            except binascii.Error as error:
                node.fail("uri", f"is not valid base64: {error}")
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", uri) or uri.startswith(("/", "\\")):
            node.fail("uri", f"expected a relative path or a data URI, found {_short(uri)}")
        name = unquote(uri)
        try:
            return self._read(os.path.join(os.path.dirname(self.path), name))
        except SceneError as error:
            node.fail("uri", str(error))

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer."""
        if index not in self._buffers:
            node = self.root.item("buffers", index)
            length = node.integer("byteLength", low=1)
            uri = node.string("uri")
            if uri is not None:
                data = self._uri(node, uri)
            elif index == 0 and self._bin is not None:
                data = self._bin
            else:
                node.fail("uri", "is required")
            if len(data) < length:
                node.fail("byteLength", f"is {length}, but there are {len(data)} bytes")
            self._buffers[index] = data[:length]
        return self._buffers[index]

    def view(self, index: int) -> Tuple[Node, memoryview]:
        """A buffer view, and its bytes."""
        node = self.root.item("bufferViews", index)
        data = self.buffer(node.integer("buffer"))
        offset, length = node.integer("byteOffset", 0), node.integer("byteLength", low=1)
        if offset + length > len(data):
            node.fail("byteLength", f"{offset} + {length} bytes reach beyond the buffer of {len(data)}")
        return node, memoryview(data)[offset : offset + length]

    # ---- accessors
    # ----------------------------------------------------------------------------------------------

    def _elements(self, node: Node, view: int, kind: str, width: int, count: int, tight: bool = False) -> np.ndarray:
        """(count, width) numbers as they are stored in a buffer view."""
        source, data = self.view(view)
        size = np.dtype(kind).itemsize
        stride = size * width
        if not tight and source.has("byteStride"):
            stride = source.integer("byteStride", low=4, high=252)
            if stride < size * width:
                source.fail("byteStride", f"expected at least {size * width}, found {stride}")
        offset = node.integer("byteOffset", 0)
        if offset + stride * (count - 1) + size * width > len(data):
            node.fail("byteOffset" if node.has("byteOffset") else "bufferView", f"{count} elements reach beyond the buffer view of {len(data)} bytes")
        return np.ndarray((count, width), kind, data, offset, (stride, size))

    def accessor(self, index: int, types: Tuple[str, ...], components: Tuple[int, ...] = tuple(COMPONENTS)) -> "Accessor":
        """An accessor of one of these types."""
        node = self.root.item("accessors", index)
        component = node.integer("componentType")
        if component not in components or component not in COMPONENTS:
            node.fail("componentType", f"expected one of {', '.join(map(str, components))}, found {component}")
        type_ = node.string("type")
        if type_ not in types:
            node.fail("type", f"expected {' or '.join(types)}, found {_short(type_)}")
        width, kind = TYPES[str(type_)], COMPONENTS[component]
        count = node.integer("count", low=1)
        normalized = node.value.get("normalized", False)
        if not isinstance(normalized, bool):
            node.fail("normalized", f"expected true or false, found {_short(normalized)}")
        if node.has("bufferView"):
            stored = self._elements(node, node.integer("bufferView"), kind, width, count)
        elif count > MAX_ZEROS:
            node.fail("count", f"expected at most {MAX_ZEROS} elements without a buffer view, found {count}")
        else:
            # All elements are the same one.
            stored = np.broadcast_to(np.zeros((1, width), dtype=kind), (count, width))
        places, values = self._sparse(node, kind, width, count) if node.has("sparse") else (None, None)
        return Accessor(node, stored, places, values, normalized)

    def _sparse(self, node: Node, kind: str, width: int, count: int) -> Tuple[np.ndarray, np.ndarray]:
        """Numbers and values of the elements that a sparse accessor replaces."""
        sparse = node.child("sparse")
        replaced = sparse.integer("count", low=1, high=count)
        indices, values = sparse.child("indices"), sparse.child("values")
        component = indices.integer("componentType")
        if component not in UNSIGNED:
            indices.fail("componentType", f"expected an unsigned integer type, found {component}")
        places = self._elements(indices, indices.integer("bufferView"), COMPONENTS[component], 1, replaced, True)[:, 0].astype(np.int64)
        if places.max() >= count:
            indices.fail(None, f"names the element {places.max()} of {count}")
        if np.any(np.diff(places) <= 0):
            indices.fail(None, "expected increasing numbers of elements")
        return places, self._elements(values, values.integer("bufferView"), kind, width, replaced, True)

    # ---- nodes
    # ----------------------------------------------------------------------------------------------

    def local(self, index: int) -> np.ndarray:
        """The 4x4 matrix of a node."""
        node = self.root.item("nodes", index)
        matrix = node.numbers("matrix", 16)
        if matrix is not None:
            return np.array(matrix).reshape(4, 4).T
        found = np.eye(4)
        scale, rotation, translation = node.numbers("scale", 3), node.numbers("rotation", 4), node.numbers("translation", 3)
        if rotation is not None:
            # A quaternion in single precision has a length of 1 only up to its rounding.
            length = math.sqrt(sum(part * part for part in rotation))
            x, y, z, w = (part / length for part in rotation) if length > 0 else (0.0, 0.0, 0.0, 1.0)
            found[:3, :3] = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        if scale is not None:
            found[:3, :3] *= scale
        if translation is not None:
            found[:3, 3] = translation
        return found

    def worlds(self, indices: List[int]) -> List[np.ndarray]:
        """The product of the matrices of each of these nodes and of all nodes above it."""
        parents: Dict[int, int] = {}
        for number in range(len(self.root.list("nodes"))):
            node = self.root.item("nodes", number)
            for place, child in enumerate(node.list("children")):
                if not isinstance(child, int) or isinstance(child, bool) or not 0 <= child < len(self.root.list("nodes")):
                    node.fail(f"children/{place}", f"expected the number of a node, found {_short(child)}")
                if child in parents:
                    node.fail(f"children/{place}", f"node {child} is already the child of node {parents[child]}")
                parents[child] = number
        known: Dict[int, np.ndarray] = {}
        for index in indices:
            chain = [index]
            while chain[-1] in parents and chain[-1] not in known:
                chain.append(parents[chain[-1]])
                if len(chain) > len(parents) + 1:
                    self.root.item("nodes", index).fail("children", "the node is below itself")
            for number in reversed(chain):
                if number not in known:
                    above = known[parents[number]] if number in parents else np.eye(4)
                    known[number] = above @ self.local(number)
        return [known[index] for index in indices]

    # ---- images
    # ----------------------------------------------------------------------------------------------

    def image(self, index: int) -> Tuple[Node, bytes]:
        """The entry of an image, and the bytes of its file."""
        node = self.root.item("images", index)
        uri = node.string("uri")
        if uri is not None:
            return node, self._uri(node, uri)
        if not node.has("bufferView"):
            node.fail(None, "expected `uri` or `bufferView`")
        return node, bytes(self.view(node.integer("bufferView"))[1])


class Accessor:
    """The elements of an accessor, which are converted when they are used."""

    def __init__(self, node: Node, stored: np.ndarray, places: Optional[np.ndarray], values: Optional[np.ndarray], normalized: bool) -> None:
        self.node, self.stored, self.places, self.values = node, stored, places, values
        self.normalized = normalized

    def __len__(self) -> int:
        return len(self.stored)

    def raw(self, which: Optional[np.ndarray] = None) -> np.ndarray:
        """(n, width) numbers in the type of the file: of all elements, or of some, whose numbers
        ascend.
        """
        found = np.array(self.stored if which is None else self.stored[which])
        if self.places is not None and self.values is not None:
            if which is None:
                found[self.places] = self.values
            else:
                at = np.minimum(np.searchsorted(which, self.places), len(which) - 1)
                there = which[at] == self.places
                found[at[there]] = self.values[there]
        return found

    def read(self, which: Optional[np.ndarray] = None) -> np.ndarray:
        """(n, width) float64."""
        raw = self.raw(which)
        found = raw.astype(np.float64)
        if np.issubdtype(raw.dtype, np.integer):
            if self.normalized:
                found = np.maximum(found / np.iinfo(raw.dtype).max, -1.0)
        elif not np.all(np.isfinite(found)):
            self.node.fail(None, "has numbers that are not finite")
        return found


_CACHE: Dict[str, Gltf] = {}
_CACHED = 4


def load(path: str) -> Gltf:
    """The file at a path. The last few files are cached until they or their buffers change."""
    found = _CACHE.pop(path, None)
    if found is None or any(stamp(name) != state for name, state in found.stamps.items()):
        found = Gltf(path)
    _CACHE[path] = found
    while len(_CACHE) > _CACHED:
        _CACHE.pop(next(iter(_CACHE)))
    return found


# ---- primitives
# --------------------------------------------------------------------------------------------------


class Primitive:
    """The triangles of a primitive, and the attributes of the vertices that they use."""

    def __init__(self, file: Gltf, mesh: int, primitive: int, most: int) -> None:
        """`most` is the largest number of triangles that can be rendered."""
        self.file = file
        for number, name in enumerate(file.root.list("extensionsRequired")):
            if name in REPLACING:
                file.root.fail(f"extensionsRequired/{number}", f"the extension {name} cannot be read")
        self.mesh = file.root.item("meshes", mesh)
        self.node = self.mesh.item("primitives", primitive)
        self.attributes = self.node.child("attributes")
        self.count = len(file.accessor(self.attributes.integer("POSITION"), ("VEC3",)))
        self.faces = self._faces(most)
        # Only the vertices that triangles use are read.
        self.used, numbers = np.unique(self.faces, return_inverse=True)
        self.faces = np.asarray(numbers).reshape(-1, 3)

    def _accessor(self, owner: Node, name: str, types: Tuple[str, ...], components: Tuple[int, ...] = tuple(COMPONENTS)) -> Optional[Accessor]:
        """The accessor of an attribute; None if there is none."""
        if not owner.has(name):
            return None
        found = self.file.accessor(owner.integer(name), types, components)
        if len(found) != self.count:
            owner.fail(name, f"has {len(found)} elements, POSITION has {self.count}")
        return found

    def _faces(self, most: int) -> np.ndarray:
        mode = self.node.integer("mode", 4, 0, 6)
        if mode < 4:
            self.node.fail("mode", f"expected triangles (4, 5 or 6), found {mode}")
        indices = None
        if self.node.has("indices"):
            indices = self.file.accessor(self.node.integer("indices"), ("SCALAR",), UNSIGNED)
        count = self.count if indices is None else len(indices)
        if count < 3 or (mode == 4 and count % 3):
            self.node.fail("indices" if indices is not None else "mode", f"expected {'a multiple of 3' if mode == 4 else 'at least 3'} vertices, found {count}")
        triangles = count // 3 if mode == 4 else count - 2
        if triangles > most:
            raise TooMany(triangles)
        if mode == 4:
            places = np.arange(count).reshape(-1, 3)
        else:
            i = np.arange(triangles)
            places = np.column_stack([i, i + 1 + i % 2, i + 2 - i % 2] if mode == 5 else [i + 1, i + 2, 0 * i])
        if indices is None:
            return places
        numbers = indices.raw()[:, 0].astype(np.int64)
        if numbers.max() >= self.count:
            self.node.fail("indices", f"names the vertex {numbers.max()} of {self.count}")
        return numbers[places]

    def read(self, name: str, *types: str) -> Optional[np.ndarray]:
        """(n, width) values of an attribute; None if the primitive lacks it."""
        found = self._accessor(self.attributes, name, types)
        return None if found is None else found.read(self.used)

    def weights(self, given: Optional[List[float]]) -> List[float]:
        """The weights of the morph targets."""
        return given if given is not None else self.mesh.numbers("weights") or []

    def morphed(self, name: str, base: Optional[np.ndarray], weights: List[float]) -> Optional[np.ndarray]:
        """The first three numbers of an attribute with the morph targets added."""
        if base is None:
            return None
        found = base[:, :3]
        for number in range(len(self.node.list("targets"))):
            target = self.node.item("targets", number)
            if number < len(weights) and weights[number] != 0:
                change = self._accessor(target, name, ("VEC3",))
                if change is not None:
                    found = found + weights[number] * change.read(self.used)
        return found

    def skinning(self, skin: int) -> np.ndarray:
        """(n, 3, 4): the upper rows of the matrix M of each vertex."""
        node = self.file.root.item("skins", skin)
        joints = node.list("joints")
        nodes = len(self.file.root.list("nodes"))
        for place, joint in enumerate(joints):
            if not isinstance(joint, int) or isinstance(joint, bool) or not 0 <= joint < nodes:
                node.fail(f"joints/{place}", f"expected the number of a node, found {_short(joint)}")
        if not joints:
            node.fail("joints", "expected at least one")
        matrices = np.array(self.file.worlds(joints))
        if node.has("inverseBindMatrices"):
            inverse = self.file.accessor(node.integer("inverseBindMatrices"), ("MAT4",), (5126,))
            if len(inverse) < len(joints):
                node.fail("inverseBindMatrices", f"has {len(inverse)} elements for {len(joints)} joints")
            read = inverse.read(np.arange(len(joints))).reshape(-1, 4, 4)
            matrices = matrices @ np.swapaxes(read, 1, 2)
        if not self.attributes.has("JOINTS_0"):
            self.attributes.fail("JOINTS_0", "is required: `skin` is given")
        total = np.zeros((len(self.used), 3, 4))
        for number in (0, 1):
            names, shares = f"JOINTS_{number}", f"WEIGHTS_{number}"
            which = self._accessor(self.attributes, names, ("VEC4",), (5121, 5123))
            weight = self._accessor(self.attributes, shares, ("VEC4",))
            if which is None and weight is None:
                continue
            if which is None or weight is None:
                self.attributes.fail(names if which is None else shares, f"is required next to {shares if which is None else names}")
            numbers, values = which.raw(self.used).astype(np.int64), weight.read(self.used)
            if numbers.max() >= len(joints):
                self.attributes.fail(names, f"names the joint {numbers.max()} of {len(joints)}")
            for entry in range(4):
                total += values[:, entry, None, None] * matrices[numbers[:, entry], :3]
        return total


class TooMany(Exception):
    """The primitive has this number of triangles, more than can be rendered."""

    def __init__(self, triangles: int) -> None:
        Exception.__init__(self, triangles)
        self.triangles = triangles


def directions(values: np.ndarray, linear: np.ndarray, normal: bool) -> np.ndarray:
    """(n, 3) directions transformed by (n, 3, 3) matrices, normals by their inverse transposes;
    zero where a matrix is singular.
    """
    columns = np.moveaxis(linear, 2, 0)
    # The columns of the transposed inverse, times the determinant.
    cofactors = np.stack([np.cross(columns[1], columns[2]), np.cross(columns[2], columns[0]), np.cross(columns[0], columns[1])], axis=2)
    determinant = np.einsum("ni,ni->n", columns[0], cofactors[:, :, 0])
    size = np.prod(np.linalg.norm(linear, axis=1), axis=1)
    good = np.abs(determinant) > 1e-15 * size
    if normal:
        cofactors = cofactors / np.where(good, determinant, 1.0)[:, None, None]
    found = np.einsum("nij,nj->ni", cofactors if normal else linear, values)
    return np.where(good[:, None], found, 0.0)
