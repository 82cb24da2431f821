"""glTF and STL files (model §9, *Mesh files*), compared with values computed by hand."""

import base64
import json
import os
import struct
import tempfile
import unittest
import unittest.mock

import numpy as np

from support import Case
from whitstone_mitsuba import gltf, images, meshes
from whitstone_mitsuba.files import Folder
from whitstone_mitsuba.runtime import mi
from whitstone_protocol.errors import SceneError, Unsupported

COMPONENTS = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """Collects buffer views and accessors of a file with one buffer."""

    def __init__(self):
        self.data = bytearray()
        self.views, self.accessors = [], []
        self.attributes, self.primitive = {}, {}
        self.document = {}

    def view(self, data, **more):
        self.data += bytes(-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.views) - 1

    def accessor(self, rows, code="f", **more):
        rows = [row if isinstance(row, (list, tuple)) else [row] for row in rows]
        data = b"".join(struct.pack(f"<{len(row)}{code}", *row) for row in rows)
        entry = {"bufferView": self.view(data), "componentType": COMPONENTS[code], "count": len(rows), "type": TYPES[len(rows[0])]}
        self.accessors.append({**entry, **more})
        return len(self.accessors) - 1

    def attribute(self, name, rows, code="f", **more):
        self.attributes[name] = self.accessor(rows, code, **more)
        return self.accessors[self.attributes[name]]

    def json(self, **buffer):
        primitive = {"attributes": self.attributes, **self.primitive}
        document = {"asset": {"version": "2.0"}, "bufferViews": self.views, "accessors": self.accessors}
        document["buffers"] = [{"byteLength": len(self.data), **buffer}]
        document["meshes"] = [{"primitives": [primitive]}]
        return {**document, **self.document}

    def embedded(self):
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.data)).decode()
        return json.dumps(self.json(uri=uri)).encode()

    def binary(self):
        text, data = json.dumps(self.json()).encode(), bytes(self.data)
        text, data = text + b" " * (-len(text) % 4), data + bytes(-len(data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


SQUARE = [[0, 0, 0], [2, 0, 0], [2, 4, 0], [0, 4, 0]]


class Files(Case):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.base = folder.name

    def write(self, name, data):
        path = os.path.join(self.base, name)
        with open(path, "wb") as file:
            file.write(data)
        return path

    def load(self, builder, name="m.gltf", base=None, **wanted):
        return meshes.load(self.write(name, builder.embedded()), meshes.Wanted(**wanted), base)

    def square(self):
        builder = Builder()
        builder.attribute("POSITION", SQUARE)
        builder.primitive["indices"] = builder.accessor([0, 1, 2, 0, 2, 3], "B")
        return builder

    def fails(self, builder, *words, **wanted):
        with self.assertRaises(SceneError) as caught:
            self.load(builder, **wanted)
        for word in ("m.gltf", *words):
            self.assertIn(word, str(caught.exception))


class Containers(Files):
    def test_embedded_external_and_binary(self):
        builder = self.square()
        self.write("a b.bin", bytes(builder.data))
        external = json.dumps(builder.json(uri="a%20b.bin")).encode()
        marked = b"\xef\xbb\xbf" + external
        for name, data in (("e.gltf", builder.embedded()), ("x.gltf", external), ("m.gltf", marked), ("b.glb", builder.binary())):
            found = meshes.load(self.write(name, data))
            self.assertEqual(found.positions.tolist(), SQUARE)
            self.assertEqual(found.faces.tolist(), [[0, 1, 2], [0, 2, 3]])
            self.assertIsNone(found.normals)
            self.assertIsNone(found.uvs)

    def test_changed_buffers_are_read_again(self):
        builder = self.square()
        path = self.write("x.gltf", json.dumps(builder.json(uri="x.bin")).encode())
        self.write("x.bin", bytes(builder.data))
        folder = Folder(self.base)
        meshes.load(folder.path("x.gltf"), None, folder)
        self.assertTrue(folder.unchanged())
        self.write("x.bin", struct.pack("<f", 7) + bytes(builder.data[4:]) + bytes(4))
        self.assertFalse(folder.unchanged())
        self.assertEqual(meshes.load(path).positions[0, 0], 7)

    def test_malformed(self):
        good = self.square().binary()
        cases = {
            "a.glb": (b"glTG" + good[4:], "GLB header"),
            "b.glb": (good[:4] + struct.pack("<I", 1) + good[8:], "version 2"),
            "c.glb": (good[:-1], "length"),
            "d.glb": (good[:12] + struct.pack("<I", 2**32 - 1) + good[16:], "beyond the end"),
            "e.glb": (good[:16] + b"BIN\0" + good[20:], "not JSON"),
            "f.gltf": (b"{", "not valid JSON"),
            "g.gltf": (b"[" * 100000, "not valid JSON"),
            "h.gltf": (b'{"asset": {"version": "1.0"}}', "/asset/version"),
            "i.gltf": (b'{"asset": {"version": "2.0"}}', "/meshes"),
            "j.gltf": (b"[]", "expected an object"),
            "k.gltf": (b'{"asset": NaN}', "NaN"),
            "l.gltf": (b"\xff", "not valid JSON"),
        }
        for name, (data, word) in cases.items():
            with self.subTest(name), self.assertRaises(SceneError) as caught:
                meshes.load(self.write(name, data))
            self.assertIn(word, str(caught.exception))
            self.assertIn(name, str(caught.exception))

    def test_buffers_are_checked(self):
        for change, *words in (
            ({"uri": "none.bin"}, "/buffers/0/uri", "No such file"),
            ({"uri": "http://127.0.0.1/x.bin"}, "/buffers/0/uri", "relative"),
            ({"uri": "/etc/hostname"}, "/buffers/0/uri", "relative"),
            ({"uri": "data:;base64,A?=="}, "/buffers/0/uri", "base64"),
            ({"uri": "data:base64"}, "/buffers/0/uri", "comma"),
            ({"uri": "data:,abc"}, "/buffers/0/byteLength", "3 bytes"),
            ({}, "/buffers/0/uri", "required"),
            ({"byteLength": 2**40}, "/buffers/0/byteLength"),
            ({"byteLength": -1}, "/buffers/0/byteLength"),
        ):
            builder = self.square()
            builder.document["buffers"] = [{"byteLength": len(builder.data), **change}]
            if "byteLength" in change:
                builder.document["buffers"][0]["uri"] = "data:,abc"
            with self.subTest(change):
                self.fails(builder, *words)


class Accessors(Files):
    def numbers(self, rows, code, **more):
        builder = self.square()
        builder.attribute("COLOR_0", rows, code, **more)
        file = gltf.load(self.write("m.gltf", builder.embedded()))
        return gltf.Primitive(file, 0, 0, 2).read("COLOR_0", "VEC3", "VEC4")

    def test_component_types(self):
        """Each as it is, and as a fraction of the largest number."""
        for code, largest, least in (("b", 127, -128), ("B", 255, 0), ("h", 32767, -32768), ("H", 65535, 0), ("I", 2**32 - 1, 0)):
            rows = [[0, 1, least], [largest, 2, 3], [4, 5, 6], [7, 8, 9]]
            self.assertEqual(self.numbers(rows, code).tolist(), rows)
            quotients = self.numbers(rows, code, normalized=True)
            self.assertEqual(quotients[0].tolist(), [0, 1 / largest, max(least / largest, -1)])
            self.assertEqual(quotients[1].tolist(), [1, 2 / largest, 3 / largest])
        self.assertEqual(self.numbers([[0.5, 0.25, 2, 0.75]] * 4, "f").tolist(), [[0.5, 0.25, 2, 0.75]] * 4)

    def test_colors_are_limited(self):
        for row, expected in (([-1, 0.5, 2], [0, 0.5, 1, 1]), ([0.5, 0.25, 2, 1.5], [0.5, 0.25, 1, 1])):
            builder = self.square()
            builder.attribute("COLOR_0", [row] * 4)
            self.assertEqual(self.load(builder, colors=True).colors.tolist(), [expected] * 4)

    def test_indices_of_all_types(self):
        for code in "BHI":
            builder = self.square()
            builder.primitive["indices"] = builder.accessor([3, 1, 0], code)
            found = self.load(builder)
            self.assertEqual(found.positions[found.faces].tolist(), [[SQUARE[3], SQUARE[1], SQUARE[0]]])

    def test_interleaved(self):
        """Positions and normalised colours in one view, behind an offset."""
        builder = self.square()
        rows = [struct.pack("<3f4B", *point, 255, 0, 51, 102 + k) for k, point in enumerate(SQUARE)]
        view = builder.view(b"????" + b"".join(rows), byteStride=16)
        builder.accessors += [
            {"bufferView": view, "byteOffset": 4, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": view, "byteOffset": 16, "componentType": 5121, "count": 4, "type": "VEC4", "normalized": True},
        ]
        builder.attributes.update({"POSITION": len(builder.accessors) - 2, "COLOR_0": len(builder.accessors) - 1})
        found = self.load(builder, colors=True)
        self.assertEqual(found.positions.tolist(), SQUARE)
        self.assertEqual(found.colors.tolist(), [[1, 0, 0.2, (102 + k) / 255] for k in range(4)])

    def test_sparse_and_zero(self):
        def sparse(builder, places, values):
            indices = {"bufferView": builder.view(bytes(places)), "componentType": 5121}
            stored = {"bufferView": builder.view(b"".join(struct.pack("<3f", *value) for value in values))}
            return {"count": len(places), "indices": indices, "values": stored}

        builder = self.square()
        builder.accessors[0]["sparse"] = sparse(builder, [1, 3], [[5, 6, 7], [8, 9, 1]])
        expected = [SQUARE[0], [5, 6, 7], SQUARE[2], [8, 9, 1]]
        self.assertEqual(self.load(builder).positions.tolist(), expected)
        # Only vertices in use are read: not the first one.
        builder.primitive["indices"] = builder.accessor([1, 2, 3], "H")
        self.assertEqual(self.load(builder).positions.tolist(), expected[1:])
        builder = self.square()
        del builder.accessors[0]["bufferView"]
        self.assertEqual(self.load(builder).positions.tolist(), [[0, 0, 0]] * 4)
        builder.accessors[0]["sparse"] = sparse(builder, [0, 2], [[5, 6, 7], [8, 9, 1]])
        self.assertEqual(self.load(builder).positions.tolist(), [[5, 6, 7], [0, 0, 0], [8, 9, 1], [0, 0, 0]])
        builder.accessors[0]["sparse"] = sparse(builder, [0, 4], [[5, 6, 7], [8, 9, 1]])
        self.fails(builder, "/accessors/0/sparse/indices", "4 of 4")
        builder.accessors[0]["sparse"]["count"] = 5
        self.fails(builder, "/accessors/0/sparse/count", "from 1 to 4")

    def test_out_of_range(self):
        for change, *words in (
            ({"count": 5}, "/accessors/0/bufferView", "5 elements"),
            ({"count": 2**31}, "/accessors/0/bufferView"),
            ({"count": 2**60}, "/accessors/0/count"),
            ({"count": 0}, "/accessors/0/count"),
            ({"count": "4"}, "/accessors/0/count"),
            ({"count": True}, "/accessors/0/count"),
            ({"byteOffset": 4}, "/accessors/0/byteOffset"),
            ({"byteOffset": -4}, "/accessors/0/byteOffset"),
            ({"bufferView": 9}, "/bufferViews", "9"),
            ({"bufferView": -1}, "/accessors/0/bufferView"),
            ({"componentType": 5124}, "/accessors/0/componentType"),
            ({"type": "VEC4"}, "/accessors/0/type", "VEC3"),
            ({"normalized": 1}, "/accessors/0/normalized"),
        ):
            builder = self.square()
            builder.accessors[0].update(change)
            with self.subTest(change):
                self.fails(builder, *words)
        builder = self.square()
        del builder.accessors[0]["bufferView"]
        builder.accessors[0]["count"] = 2**27 + 1
        self.fails(builder, "/accessors/0/count", str(2**27))
        # The memory for unused elements is not needed.
        builder.accessors[0]["count"] = 2**27
        self.assertEqual(self.load(builder).positions.tolist(), [[0, 0, 0]] * 4)
        del builder.primitive["indices"]
        builder.accessors[0]["count"] = 2**27 - 2
        with self.assertRaises(Unsupported):
            self.load(builder)
        for change, *words in (
            ({"byteOffset": 1000}, "/bufferViews/0/byteLength"),
            ({"byteLength": 0}, "/bufferViews/0/byteLength"),
            ({"byteStride": 8}, "/bufferViews/0/byteStride"),
            ({"byteStride": 2**20}, "/bufferViews/0/byteStride"),
            ({"buffer": 1}, "/buffers"),
        ):
            builder = self.square()
            builder.views[0].update(change)
            with self.subTest(change):
                self.fails(builder, *words)
        builder = self.square()
        builder.attribute("POSITION", [[0, 0, float("nan")]] * 4)
        self.fails(builder, "/accessors/2", "not finite")

    def test_attributes_are_checked(self):
        builder = self.square()
        builder.attribute("NORMAL", [[0, 0, 1]] * 3)
        self.fails(builder, "/meshes/0/primitives/0/attributes/NORMAL", "3 elements")
        builder = self.square()
        builder.primitive["indices"] = builder.accessor([0, 1, 4], "B")
        self.fails(builder, "/meshes/0/primitives/0/indices", "4 of 4")
        builder.primitive["indices"] = builder.accessor([0, 1], "B")
        self.fails(builder, "/meshes/0/primitives/0/indices", "multiple of 3")
        builder.primitive["indices"] = builder.accessor([0, 1, 2], "b")
        self.fails(builder, "/accessors/4/componentType")
        builder = self.square()
        builder.attributes = {}
        self.fails(builder, "/meshes/0/primitives/0/attributes/POSITION", "required")
        self.fails(self.square(), "/meshes/0/primitives", "has no entry 1", primitive=1)
        self.fails(self.square(), "/meshes", "has no entry 3", mesh=3)
        builder = self.square()
        builder.document["extensionsRequired"] = ["KHR_mesh_quantization", "KHR_draco_mesh_compression"]
        self.fails(builder, "/extensionsRequired/1", "draco")
        builder.document["extensionsRequired"] = ["KHR_mesh_quantization"]
        self.load(builder)


class Triangles(Files):
    def test_modes(self):
        points = [[k, k * k, 0] for k in range(6)]
        for mode, expected in (
            (4, [[0, 1, 2], [3, 4, 5]]),
            (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]),
            (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0], [4, 5, 0]]),
        ):
            builder = Builder()
            builder.attribute("POSITION", points)
            builder.primitive["mode"] = mode
            found = self.load(builder)
            self.assertEqual(found.positions[found.faces][:, :, 0].tolist(), expected)
            # Backwards.
            builder.primitive["indices"] = builder.accessor([5, 4, 3, 2, 1, 0], "H")
            found = self.load(builder)
            self.assertEqual((5 - found.positions[found.faces][:, :, 0]).tolist(), expected)
        builder.primitive["mode"] = 1
        self.fails(builder, "/meshes/0/primitives/0/mode", "found 1")
        builder.primitive["mode"] = 7
        self.fails(builder, "/meshes/0/primitives/0/mode")

    def test_texture_coordinates(self):
        builder = self.square()
        builder.attribute("TEXCOORD_0", [[0, 0], [1, 0], [1, 1], [0.25, 0.75]])
        builder.attribute("TEXCOORD_3", [[0, 255], [51, 0], [0, 0], [0, 0]], "B", normalized=True)
        first, third = [[0, 1], [1, 1], [1, 0], [0.25, 0.25]], [[0, 0], [0.2, 1], [0, 1], [0, 1]]
        self.assertEqual(self.load(builder).uvs.tolist(), first)
        found = self.load(builder, uv_sets=(3, 0))
        self.assertEqual((found.uvs.tolist(), found.second.tolist()), (third, first))
        found = self.load(builder, uv_sets=())
        self.assertIsNone(found.uvs)
        found = self.load(builder, uv_sets=(1, 3))
        self.assertIsNone(found.uvs)
        self.assertEqual(found.second.tolist(), third)

    def test_morph_targets(self):
        builder = self.square()
        builder.attribute("NORMAL", [[0, 0, 1]] * 4)
        builder.attribute("TANGENT", [[1, 0, 0, -1]] * 4)
        first = {"POSITION": builder.accessor([[1, 0, 0]] * 4), "NORMAL": builder.accessor([[0, 4, 0]] * 4)}
        second = {"POSITION": builder.accessor([[0, 0, 8]] * 4), "TANGENT": builder.accessor([[0, 2, 0]] * 4)}
        builder.primitive["targets"] = [first, second]
        self.assertEqual(self.load(builder).positions.tolist(), SQUARE)
        found = self.load(builder, weights=(0.5, 0.25), tangents=True)
        self.near(found.positions, np.array(SQUARE) + [0.5, 0, 2])
        self.near(found.normals, [[0, 2, 1]] * 4)
        self.near(found.tangents, [[1, 0.5, 0]] * 4)
        self.assertEqual(found.signs.tolist(), [-1, -1])
        # Without normals there are no tangents either; those of the texture coordinates are zero.
        normal = builder.attributes.pop("NORMAL")
        self.near(self.load(builder, tangents=True).tangents, [[0, 0, 0]] * 4)
        builder.attributes["NORMAL"] = normal
        self.near(self.load(builder, weights=(2.0,)).positions, np.array(SQUARE) + [2, 0, 0])
        builder.document["meshes"] = [{"primitives": [{"attributes": builder.attributes, **builder.primitive}], "weights": [0, 1]}]
        self.near(self.load(builder).positions, np.array(SQUARE) + [0, 0, 8])
        self.near(self.load(builder, weights=()).positions, SQUARE)
        builder.document["meshes"][0]["weights"] = ["a"]
        self.fails(builder, "/meshes/0/weights")

    def skinned(self):
        """Two joints below a root: the first turns x to y, the second is a shift below it."""
        builder = self.square()
        builder.attribute("NORMAL", [[1, 0, 0]] * 4)
        builder.attribute("JOINTS_0", [[0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]], "B")
        builder.attribute("WEIGHTS_0", [[0.5, 0.5, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
        half = 0.5**0.5
        builder.document["nodes"] = [
            {"children": [1], "translation": [0, 0, 10]},
            {"children": [2], "rotation": [0, 0, half, half]},
            {"matrix": [1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]},
        ]
        builder.document["skins"] = [{"joints": [1, 2]}]
        return builder

    def test_skins(self):
        builder = self.skinned()
        found = self.load(builder, skin=0)
        # The first joint maps (x, y, z) to (-y, x, z + 10), the second to (-2y, x + 3, z + 10).
        expected = [[0, 1.5, 10], [0, 5, 10], [-8, 5, 10], [-4, 0, 10]]
        self.near(found.positions, expected, atol=1e-12)
        normals = found.normals / np.linalg.norm(found.normals, axis=1)[:, None]
        self.near(normals, [[0, 1, 0]] * 4, atol=1e-12)
        # Inverse bind matrices, stored by columns: a shift by -3 along x.
        shift = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -3, 0, 0, 1]
        builder.document["skins"][0]["inverseBindMatrices"] = builder.accessor([shift, shift])
        self.near(self.load(builder, skin=0).positions, np.array(expected) - [0, 3, 0], atol=1e-12)
        # A joint without extent.
        builder.document["nodes"][2] = {"scale": [1, 0, 1]}
        self.assertEqual(self.load(builder, skin=0).normals[1].tolist(), [0, 0, 0])

    def test_rotations_of_any_length(self):
        builder = self.skinned()
        expected = self.load(builder, skin=0)
        for node in builder.document["nodes"]:
            if "rotation" in node:
                node["rotation"] = [part * 3 for part in node["rotation"]]
        found = self.load(builder, skin=0)
        self.near(found.positions, expected.positions, atol=1e-12)
        self.near(found.normals, expected.normals, atol=1e-12)

    def test_more_than_four_joints(self):
        builder = self.skinned()
        builder.attribute("WEIGHTS_0", [[0.25, 0.25, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
        builder.attribute("JOINTS_1", [[0, 1, 0, 0]] * 4, "H")
        builder.attribute("WEIGHTS_1", [[51, 204, 0, 0]] + [[0, 0, 0, 0]] * 3, "B", normalized=True)
        found = self.load(builder, skin=0)
        # 0.45 of the first, 1.05 of the second.
        self.near(found.positions[0], [0, 1.05 * 3, 15], atol=1e-12)

    def test_skins_are_checked(self):
        builder = self.square()
        builder.document["nodes"] = [{}]
        builder.document["skins"] = [{"joints": [0]}]
        self.fails(builder, "attributes/JOINTS_0", skin=0)
        self.fails(builder, "/skins", skin=1)
        for change, *words in (
            ({"nodes": [{"children": [1]}, {"children": [0]}, {}]}, "/nodes/1", "below itself"),
            ({"nodes": [{"children": [2]}, {"children": [2]}, {}]}, "/nodes/1/children/0", "already"),
            ({"nodes": [{"children": [9]}, {}, {}]}, "/nodes/0/children/0"),
            ({"nodes": [{}, {"matrix": [1] * 15}, {}]}, "/nodes/1/matrix", "16"),
            ({"skins": [{"joints": [1]}]}, "attributes/JOINTS_0", "1 of 1"),
            ({"skins": [{"joints": []}]}, "/skins/0/joints"),
            ({"skins": [{"joints": [7]}]}, "/skins/0/joints/0"),
            ({"skins": [{"joints": [1, 2], "inverseBindMatrices": 0}]}, "/accessors/0/type"),
        ):
            builder = self.skinned()
            builder.document.update(change)
            with self.subTest(change):
                self.fails(builder, *words, skin=0)
        builder = self.skinned()
        del builder.attributes["WEIGHTS_0"]
        self.fails(builder, "attributes/WEIGHTS_0", "JOINTS_0", skin=0)


class Tangents(Files):
    def test_computed(self):
        """A square of two triangles, the second of which has mirrored coordinates."""
        builder = self.square()
        builder.attribute("TEXCOORD_0", [[0, 1], [1, 1], [1, 0], [0, 2]])
        # In the model's coordinates: (0, 0), (1, 0), (1, 1), (0, -1).
        found = self.load(builder, tangents=True)
        self.assertEqual(found.signs.tolist(), [1, -1])
        # D = 1 and T = 1 (2, 0, 0) - 0; then D = -1 and T = -(-1 (2, 4, 0) - 1 (0, 4, 0)).
        one, two = np.array([1, 0, 0]), np.array([2, 8, 0]) / 68**0.5
        self.near(found.tangents, [one + two, one, one + two, two])
        self.near(self.load(builder, tangents=True, uv_sets=()).tangents, np.zeros((4, 3)))

    def test_missing_normals_do_not_split_vertices(self):
        text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
        faces = "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
        whole = meshes.load(self.write("a.obj", (text + faces).encode()), meshes.Wanted(tangents=True))
        mixed = meshes.load(self.write("b.obj", (text + faces + "f 1/1/1 2/2/1 4/4/1\n").encode()), meshes.Wanted(tangents=True))
        for mesh in (whole, mixed):
            self.near(mesh.tangents[mesh.faces[0]], [[2, 0, 0], [1, 0, 0], [2, 0, 0]])
        self.near(mixed.tangents[mixed.faces[2]], [[1, 0, 0]] * 3)

    def test_degenerate(self):
        text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nf 1/1 2/2 3/2\nf 1/1 1/1 2/2\n"
        found = meshes.load(self.write("a.obj", text.encode()), meshes.Wanted(tangents=True))
        self.assertEqual(found.signs.tolist(), [1, 1])
        self.near(found.tangents, np.zeros((3, 3)))


class OtherColors(Files):
    def test_ply(self):
        head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{}"
        tail = "element face 1\nproperty list uchar int vertex_indices\nend_header\n{}3 0 1 2\n"
        kinds = "property uchar red\nproperty short green\nproperty float alpha\n"
        lines = "0 0 0 255 32767 0.5\n1 0 0 51 0 2\n0 1 0 0 0 0\n"
        path = self.write("a.ply", (head.format(kinds) + tail.format(lines)).encode())
        expected = [[1, 1, 1, 0.5], [0.2, 0, 1, 2], [0, 0, 1, 0]]
        self.near(meshes.load(path, meshes.Wanted(colors=True)).colors, expected)
        self.assertIsNone(meshes.load(path).colors)
        plain = self.write("b.ply", (head.format("") + tail.format("0 0 0\n1 0 0\n0 1 0\n")).encode())
        self.near(meshes.load(plain, meshes.Wanted(colors=True)).colors, np.ones((3, 4)))
        large = plain.replace("b.ply", "c.ply")
        with open(plain, "rb") as file:
            self.write("c.ply", file.read().replace(b"vertex 3", b"vertex 99999999999999"))
        with self.assertRaises(SceneError):
            meshes.load(large)

    def test_obj(self):
        text = "v 0 0 0 1 0.5 0.25\nv 1 0 0\nv 0 1 0 0 0 0\nvt 0 0\n"
        for face in ("f 1 2 3\n", "f 1/1 2/1 3/1\n"):
            found = meshes.load(self.write("a.obj", (text + face).encode()), meshes.Wanted(colors=True))
            self.near(found.colors, [[1, 0.5, 0.25, 1], [1, 1, 1, 1], [0, 0, 0, 1]])
        with self.assertRaises(SceneError):
            meshes.load(self.write("a.obj", (text + face).encode()), meshes.Wanted(uv_sets=(1,)))

    def test_parts_of_obj(self):
        text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nusemtl a b \nf 1 3 2\nf 2 3 4\nusemtl c\nf 1 2 4\n"
        path = self.write("parts.obj", text.encode())
        for part, faces in (("", [[0, 1, 2]]), ("a b", [[0, 2, 1], [1, 2, 3]]), ("c", [[0, 1, 3]])):
            self.assertEqual(meshes.load(path, meshes.Wanted(part=part)).faces.tolist(), faces)
        self.assertEqual(len(meshes.load(path).faces), 4)
        with self.assertRaises(SceneError):
            meshes.load(path, meshes.Wanted(part="a"))


class Stl(Files):
    POINTS = [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 2.5], [1e-3, 0, 2], [0, 1, 2]]]

    def binary(self, head=b"solid is not text"):
        rows = b"".join(struct.pack("<12fH", 9, 9, 9, *np.ravel(facet), 7) for facet in self.POINTS)
        return head.ljust(80, b"\0") + struct.pack("<I", len(self.POINTS)) + rows

    def text(self):
        lines = ["solid vertex facet"]
        for facet in self.POINTS:
            lines += ["  FACET normal 0 0 1", "outer loop"]
            lines += [f"vertex {x} {y} {z}" for x, y, z in facet] + ["endloop", "endfacet"]
        return "\r\n".join([*lines, "endsolid vertex"]).encode()

    def test_both_forms(self):
        for name, data in (("b.stl", self.binary()), ("t.STL", self.text())):
            found = meshes.load(self.write(name, data))
            self.near(found.positions[found.faces], self.POINTS)
            self.assertEqual(found.faces.tolist(), [[0, 1, 2], [3, 4, 5]])
            self.assertIsNone(found.normals)
            self.assertIsNone(found.uvs)

    def test_malformed(self):
        for data in (self.binary()[:-1], self.text().replace(b"endloop", b"vertex 0 0 0", 1), b"", b"solid\nfacet normal 0 0",
                     self.text().replace(b"2.5", b"two"), b"solid\nendsolid", self.binary()[:80] + bytes(4)):
            with self.subTest(data[:200]), self.assertRaises(SceneError):
                meshes.load(self.write("m.stl", data))


class Images(Files):
    def setUp(self):
        Files.setUp(self)
        self.texels = np.random.default_rng(3).integers(0, 256, (2, 3, 4), dtype=np.uint8)
        mi.Bitmap(self.texels, mi.Bitmap.PixelFormat.RGBA).write(os.path.join(self.base, "t.png"))
        with open(os.path.join(self.base, "t.png"), "rb") as file:
            self.png = file.read()

    def file(self, *entries):
        builder = self.square()
        view = builder.view(self.png)
        builder.document["images"] = [*entries, {"bufferView": view, "mimeType": "image/png"}]
        return self.write("i.gltf", builder.embedded()), len(entries)

    def test_where_they_are(self):
        uri = "data:image/png;base64," + base64.b64encode(self.png).decode()
        path, last = self.file({"uri": "t.png"}, {"uri": uri})
        for index in range(last + 1):
            found = images.inside(path, index, "linear", "color", Folder(self.base))
            self.near(found, self.texels[:, :, :3] / 255)

    def test_channels(self):
        path, last = self.file()
        for number, channel in enumerate(("red", "green", "blue", "alpha")):
            expected = np.repeat(self.texels[:, :, [number]], 3, axis=2) / 255
            space = "auto" if channel == "alpha" else "linear"
            self.near(images.inside(path, last, space, channel, Folder(self.base)), expected)
            self.near(images.load(os.path.join(self.base, "t.png"), space, channel), expected)
        decoded = images.srgb_to_linear(self.texels[:, :, 1] / 255)
        self.near(images.inside(path, last, "auto", "green", Folder(self.base))[:, :, 2], decoded)
        mi.Bitmap(self.texels[:, :, :3].copy()).write(os.path.join(self.base, "o.jpg"))
        path, _ = self.file({"uri": "o.jpg"})
        self.near(images.inside(path, 0, "auto", "alpha", Folder(self.base)), np.ones((2, 3, 3)))
        with self.assertRaises(SceneError):
            images.load(os.path.join(self.base, "o.jpg"), "auto", "alpha")

    def test_errors(self):
        self.write("x.webp", b"RIFF\x20\0\0\0WEBPVP8L")
        path, _ = self.file({"uri": "x.webp"}, {"uri": "none.png"}, {}, {"uri": "data:,text"}, {"uri": "data:;base64,iVBORw0KGgo="})
        with self.assertRaises(Unsupported):
            images.inside(path, 0, "auto", "color", Folder(self.base))
        for name in ("h.png", "h.jpg"):
            mi.Bitmap(self.texels[:, :, :3].copy()).write(os.path.join(self.base, name))
            with open(os.path.join(self.base, name), "rb") as file:
                data = file.read()
            self.assertEqual(images._size(data), (3, 2))
            self.assertEqual(images._size(data[:12]), (0, 0))
        # A header that gives the largest size.
        self.write("h.png", self.png[:16] + b"\x7f\xff\xff\xff" * 2 + self.png[24:])
        with self.assertRaises(Unsupported):
            images.inside(self.file({"uri": "h.png"})[0], 0, "auto", "color", Folder(self.base))
        path, _ = self.file({"uri": "x.webp"}, {"uri": "none.png"}, {}, {"uri": "data:,text"}, {"uri": "data:;base64,iVBORw0KGgo="})
        for index, word in ((1, "/images/1/uri"), (2, "/images/2"), (3, "/images/3"), (4, "/images/4"), (6, "/images")):
            with self.subTest(index), self.assertRaises(SceneError) as caught:
                images.inside(path, index, "auto", "color", Folder(self.base))
            self.assertIn(word, str(caught.exception))


class Nodes(unittest.TestCase):
    def test_directions(self):
        linear = np.array([np.diag([2.0, 1, 1]), np.diag([1.0, 0, 1]), np.diag([-1.0, 1, 1])])
        values = np.array([[1.0, 1, 0]] * 3)
        np.testing.assert_allclose(gltf.directions(values, linear, True), [[0.5, 1, 0], [0, 0, 0], [-1, 1, 0]])
        np.testing.assert_allclose(gltf.directions(values, linear, False), [[2, 1, 0], [0, 0, 0], [-1, 1, 0]])


if __name__ == "__main__":
    unittest.main()
