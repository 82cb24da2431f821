"""Small glTF models, each with a part of the format that is easy to read wrongly."""

import base64
import json
import math
import struct
import zlib
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

Json = Dict[str, Any]
Rows = Sequence[Sequence[float]]
# Component types: number in the file, and code of `struct`.
BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
CODES = {BYTE: "b", UBYTE: "B", SHORT: "h", USHORT: "H", UINT: "I", FLOAT: "f"}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
NEAREST, LINEAR = 9728, 9729
CLAMP, MIRROR = 33071, 33648


def png(rows: Sequence[Sequence[Sequence[int]]], palette: bytes = b"", gamma: Optional[int] = None) -> bytes:
    """An image of 8 bits, top row first: grey, RGB or RGBA, or numbers of colours of a palette. With
    `gamma`, a chunk gAMA, which readers of glTF ignore.
    """
    height, width, channels = len(rows), len(rows[0]), len(rows[0][0])
    raw = b"".join(b"\0" + bytes(value for texel in row for value in texel) for row in rows)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    kind = 3 if palette else {1: 0, 3: 2, 4: 6}[channels]
    chunks = [(b"IHDR", struct.pack(">2I5B", width, height, 8, kind, 0, 0, 0))]
    if gamma is not None:
        chunks.append((b"gAMA", struct.pack(">I", gamma)))
    if palette:
        chunks.append((b"PLTE", palette))
    chunks += [(b"IDAT", zlib.compress(raw)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(name, data) for name, data in chunks)


# Sixteen different colours: no rotation or reflection of the image equals the image.
COLORS = [[[40 + 50 * x, 60 + 45 * y, (90 * x + 170 * y + 35) % 256] for x in range(4)] for y in range(4)]
IMAGE = png(COLORS)


class Model:
    """A glTF document with one buffer and one image."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.images: List[bytes] = []
        self.root: Json = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }

    def add(self, key: str, item: Json) -> int:
        """Appends to a list of the document; returns the index."""
        items = self.root.setdefault(key, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes, stride: Optional[int] = None, target: Optional[int] = None) -> int:
        self.bytes.extend(b"\0" * (-len(self.bytes) % 4))
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data)}
        if stride is not None:
            view["byteStride"] = stride
        if target is not None:
            view["target"] = target
        self.bytes.extend(data)
        return self.add("bufferViews", view)

    def accessor(
        self, rows: Rows, component: int = FLOAT, normalized: bool = False, bounds: bool = False, indices: bool = False
    ) -> int:
        """An accessor with these rows of numbers, as they are stored."""
        size = len(rows[0])
        packed = [struct.pack(f"<{size}{CODES[component]}", *row) for row in rows]
        if indices or size == 16:
            data, stride = b"".join(packed), None
        else:
            # Each element starts at a multiple of four bytes.
            stride = -(-len(packed[0]) // 4) * 4
            data = b"".join(row.ljust(stride, b"\0") for row in packed)
        target = 34963 if indices else 34962
        item: Json = {
            "bufferView": self.view(data, stride, None if size == 16 else target),
            "componentType": component,
            "count": len(rows),
            "type": KINDS[size],
        }
        if normalized:
            item["normalized"] = True
        if bounds:
            item.update(limits(rows))
        return self.add("accessors", item)

    def positions(self, rows: Rows) -> int:
        return self.accessor(rows, bounds=True)

    def indices(self, numbers: Sequence[int], component: int = USHORT) -> int:
        return self.accessor([[number] for number in numbers], component, indices=True)

    def node(self, parent: Optional[int] = None, **keys: Any) -> int:
        index = self.add("nodes", keys)
        if parent is None:
            self.root["scenes"][0]["nodes"].append(index)
        else:
            self.root["nodes"][parent].setdefault("children", []).append(index)
        return index

    def texture(self, sampler: Optional[Json] = None, image: bytes = IMAGE) -> int:
        """A texture; images that are given twice are stored once."""
        if image not in self.images:
            self.images.append(image)
            self.add("images", {"bufferView": self.view(image), "mimeType": "image/png"})
        texture = {"source": self.images.index(image)}
        if sampler is not None:
            texture["sampler"] = self.add("samplers", sampler)
        return self.add("textures", texture)

    def material(self, factor: Optional[Sequence[float]] = None, texture: Optional[Json] = None) -> int:
        base: Json = {"metallicFactor": 0}
        if factor is not None:
            base["baseColorFactor"] = list(factor)
        if texture is not None:
            base["baseColorTexture"] = texture
        return self.add("materials", {"pbrMetallicRoughness": base})

    def primitive(self, attributes: Json, indices: Optional[int] = None, **keys: Any) -> Json:
        item: Json = {"attributes": attributes, **keys}
        if indices is not None:
            item["indices"] = indices
        return item

    def mesh(self, *primitives: Json, **keys: Any) -> int:
        return self.add("meshes", {"primitives": list(primitives), **keys})

    def uses(self, *extensions: str, required: bool = False) -> None:
        self.root["extensionsUsed"] = list(extensions)
        if required:
            self.root["extensionsRequired"] = list(extensions)

    def write(self, path: Path) -> Path:
        """Writes a .gltf with a data URI, or a .glb."""
        root = dict(self.root)
        if path.suffix == ".glb":
            root["buffers"] = [{"byteLength": len(self.bytes)}]
            text = json.dumps(root).encode()
            text += b" " * (-len(text) % 4)
            data = bytes(self.bytes) + b"\0" * (-len(self.bytes) % 4)
            chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text + struct.pack("<2I", len(data), 0x004E4942) + data
            path.write_bytes(struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks)
        else:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.bytes).decode()
            root["buffers"] = [{"byteLength": len(self.bytes), "uri": uri}]
            path.write_text(json.dumps(root))
        return path


class External(Model):
    """A model whose buffer and images are files of their own, with names that must be escaped."""

    def write(self, path: Path) -> Path:
        root = json.loads(json.dumps(self.root))
        (path.parent / "a buffer ü%.bin").write_bytes(self.bytes)
        root["buffers"] = [{"byteLength": len(self.bytes), "uri": "a%20buffer%20%C3%BC%25.bin"}]
        for number, image in enumerate(self.images):
            (path.parent / f"image {number}.png").write_bytes(image)
            root["images"][number] = {"uri": f"image%20{number}.png"}
        path.write_text(json.dumps(root))
        return path


def limits(rows: Rows) -> Json:
    columns = list(zip(*[[single(value) for value in row] for row in rows]))
    return {"min": [min(column) for column in columns], "max": [max(column) for column in columns]}


def single(value: float) -> float:
    """The number in single precision."""
    return value if isinstance(value, int) else float(struct.unpack("<f", struct.pack("<f", value))[0])


def turn(axis: Sequence[float], degrees: float) -> List[float]:
    """A rotation as x, y, z, w."""
    length = math.sqrt(sum(part * part for part in axis))
    half = math.radians(degrees) / 2
    return [part / length * math.sin(half) for part in axis] + [math.cos(half)]


def unit(x: float, y: float, z: float) -> List[float]:
    length = math.sqrt(x * x + y * y + z * z)
    return [x / length, y / length, z / length]


# A quad that is no rectangle, with normals that differ.
CORNERS = [[-1.0, -0.8, 0.0], [1.1, -0.7, 0.1], [0.9, 0.8, 0.0], [-0.8, 0.9, -0.2]]
NORMALS = [unit(-0.3, -0.2, 1), unit(0.4, -0.1, 1), unit(0.2, 0.3, 1), unit(-0.1, 0.4, 1)]
# The first vertex shows the left bottom of the image: v points down in glTF.
UV = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]
QUAD = [0, 1, 2, 0, 2, 3]


def quad(model: Model, material: Optional[int] = None, uv: Rows = UV, **more: int) -> Json:
    attributes = {
        "POSITION": model.positions(CORNERS),
        "NORMAL": model.accessor(NORMALS),
        "TEXCOORD_0": model.accessor(uv),
        **more,
    }
    keys = {} if material is None else {"material": material}
    return model.primitive(attributes, model.indices(QUAD), **keys)


def hierarchy() -> Model:
    """Rotated, unevenly scaled and mirrored nodes below each other, one as a matrix."""
    model = Model()
    material = model.material([0.9, 0.5, 0.7, 1], {"index": model.texture()})
    one, twice = model.mesh(quad(model, material)), model.mesh(quad(model, material))
    top = model.node(rotation=turn([1, 2, 3], 35), scale=[1.5, 0.7, 1.2], translation=[0.3, -0.2, 0.1])
    middle = model.node(top, rotation=turn([-2, 1, 0.5], 40), scale=[-1, 1.3, 0.8], translation=[-1.2, 0.4, 0])
    model.node(middle, mesh=one)
    # Columns of a rotation, each times a scale, and a translation.
    matrix = [0.6, 0.8, 0, 0, 1.04, -0.78, 0, 0, 0, 0, 0.9, 0, 1.3, 0.2, -0.4, 1]
    model.node(top, mesh=twice, matrix=matrix)
    model.node(mesh=twice, translation=[0.2, -1.9, 0.3], rotation=turn([0, 1, 0], 20), scale=[1, 0.6, -1])
    return model


def nearest() -> Model:
    """The image as it is, with hard borders of its texels."""
    model = Model()
    sampler = {"magFilter": NEAREST, "minFilter": NEAREST}
    material = model.material([1, 0.8, 0.6, 1], {"index": model.texture(sampler)})
    model.node(mesh=model.mesh(quad(model, material)))
    return model


def wraps() -> Model:
    """Clamped along u, mirrored along v, far outside of the image."""
    model = Model()
    sampler = {"magFilter": LINEAR, "minFilter": LINEAR, "wrapS": CLAMP, "wrapT": MIRROR}
    material = model.material(None, {"index": model.texture(sampler)})
    model.node(mesh=model.mesh(quad(model, material, [[-0.5, 2.2], [1.6, 2.4], [1.5, -1.3], [-0.4, -1.2]])))
    return model


def vertex_colors() -> Model:
    """Vertex colours in normalised bytes, with a factor."""
    model = Model()
    colors = model.accessor([[255, 20, 60, 255], [10, 200, 90, 128], [40, 70, 240, 0], [230, 220, 30, 77]], UBYTE, True)
    material = model.material([0.5, 0.9, 0.75, 1])
    model.node(mesh=model.mesh(quad(model, material, COLOR_0=colors)))
    return model


def sparse() -> Model:
    """Sparse positions over a buffer view and sparse texture coordinates over zeros."""
    model = Model()
    material = model.material(None, {"index": model.texture()})
    primitive = quad(model, material)
    accessors = model.root["accessors"]
    places, values = model.view(struct.pack("<2B", 1, 3)), model.view(struct.pack("<6f", 1.5, -1, 0.6, -1.2, 0.5, 0.4))
    position = accessors[primitive["attributes"]["POSITION"]]
    position["sparse"] = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": UBYTE},
        "values": {"bufferView": values},
    }
    position.update(limits([CORNERS[0], [1.5, -1.0, 0.6], CORNERS[2], [-1.2, 0.5, 0.4]]))
    places, values = model.view(struct.pack("<2H", 0, 2)), model.view(struct.pack("<4f", 0.7, 0.9, 0.2, 0.4))
    item: Json = {"componentType": FLOAT, "count": 4, "type": "VEC2"}
    item["sparse"] = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": USHORT},
        "values": {"bufferView": values},
    }
    primitive["attributes"]["TEXCOORD_0"] = model.add("accessors", item)
    model.node(mesh=model.mesh(primitive))
    return model


def strip_vertices() -> Rows:
    return [[0.5 * (i // 2), 0.7 * (i % 2) + 0.1 * (i // 2), 0.12 * (i * i % 5)] for i in range(9)]


def strip(indexed: bool = True) -> Model:
    """A triangle strip: each second triangle is turned."""
    model = Model()
    rows = strip_vertices()
    attributes = {"POSITION": model.positions(rows), "TEXCOORD_0": model.accessor([[x / 2, y] for x, y, _ in rows])}
    order = model.indices([8, 7, 6, 5, 4, 3, 2, 1, 0]) if indexed else None
    primitive = model.primitive(attributes, order, mode=5, material=model.material(None, {"index": model.texture()}))
    model.node(mesh=model.mesh(primitive))
    return model


def fan() -> Model:
    """A triangle fan."""
    model = Model()
    angles = [0.3 + 0.8 * i for i in range(7)]
    ring = [[(1 + 0.05 * i) * math.cos(a), math.sin(a), 0.1 * (i % 3)] for i, a in enumerate(angles)]
    rows = [[0.1, 0.0, 0.5], *ring]
    attributes = {"POSITION": model.positions(rows), "TEXCOORD_0": model.accessor([[x, y] for x, y, _ in rows])}
    primitive = model.primitive(attributes, mode=6, material=model.material(None, {"index": model.texture()}))
    model.node(mesh=model.mesh(primitive))
    return model


def texture_transform(**keys: Any) -> Model:
    """Rotated, moved and scaled texture coordinates."""
    model = Model()
    transform = keys or {"offset": [0.3, -0.15], "rotation": 0.6, "scale": [1.7, 0.6]}
    texture = {"index": model.texture(), "extensions": {"KHR_texture_transform": transform}}
    model.uses("KHR_texture_transform")
    model.node(mesh=model.mesh(quad(model, model.material([0.8, 1, 0.9, 1], texture))))
    return model


def second_set() -> Model:
    """The texture is placed by TEXCOORD_1; another material uses TEXCOORD_0."""
    model = Model()
    other = model.accessor([[0.9, 0.1], [0.2, 0.3], [0.1, 0.8], [0.7, 0.95]])
    texture = model.texture()
    second, first = model.material(None, {"index": texture, "texCoord": 1}), model.material(None, {"index": texture})
    model.node(mesh=model.mesh(quad(model, second, TEXCOORD_1=other)))
    model.node(mesh=model.mesh(quad(model, first, TEXCOORD_1=other)), translation=[0.4, 1.8, 0.2])
    return model


def quantized() -> Model:
    """Integers for positions, normals and texture coordinates."""
    model = Model()
    corners = [[round(10000 * part) for part in corner] for corner in CORNERS]
    normals = [[round(127 * part) for part in normal] for normal in NORMALS]
    position = model.accessor(corners, SHORT, True, bounds=True)
    attributes = {
        "POSITION": position,
        "NORMAL": model.accessor(normals, BYTE, True),
        "TEXCOORD_0": model.accessor([[round(65535 * part) for part in row] for row in UV], USHORT, True),
    }
    model.uses("KHR_mesh_quantization", required=True)
    material = model.material(None, {"index": model.texture()})
    normalised = model.primitive(attributes, model.indices(QUAD), material=material)
    model.node(mesh=model.mesh(normalised), scale=[3.2767] * 3)
    plain: Json = {
        **attributes,
        "POSITION": model.accessor(corners, SHORT, bounds=True),
        "TEXCOORD_0": model.accessor([[3, 1], [-1, 2], [0, -1], [2, 0]], BYTE),
    }
    second = model.primitive(plain, model.indices(QUAD, UINT), material=material)
    model.node(mesh=model.mesh(second), scale=[1e-4] * 3, translation=[1.0, 1.9, 0.0])
    return model


def instancing() -> Model:
    """EXT_mesh_gpu_instancing below a node that is turned and scaled unevenly."""
    model = Model()
    turns = [turn([0, 0, 1], 15), turn([1, 1, 0], 50), turn([0, 1, 1], -35)]
    attributes = {
        "TRANSLATION": model.accessor([[-1.5, 0, 0], [1.2, 0.4, 0.3], [0, -1.7, 0.5]]),
        "ROTATION": model.accessor(turns),
        "SCALE": model.accessor([[1, 1, 1], [0.7, 1.4, -1], [1.2, 0.5, 0.9]]),
    }
    model.uses("EXT_mesh_gpu_instancing")
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    mesh = model.mesh(quad(model, model.material(None, {"index": model.texture()})))
    model.node(mesh=mesh, rotation=turn([1, 0, 2], 25), scale=[1.1, 0.8, 1], extensions=extensions)
    return model


def morph() -> Model:
    """Two morph targets, with weights of the mesh and of a node."""
    model = Model()
    primitive = quad(model, model.material(None, {"index": model.texture()}))
    moves: List[Rows] = [[[0.3, 0, 0.4], [0, 0.5, 0], [-0.2, 0.1, 0.6], [0, 0, 0.2]], [[0, -0.4, 0], [0.4, 0, 0.3], [0] * 3, [-0.5, 0, 0]]]
    turns: List[Rows] = [[[0.2, 0, 0], [0, 0.3, 0], [0, -0.2, 0], [0.1, 0.1, 0]], [[0, 0, 0.2], [0.1, 0, 0], [0.3, 0, 0], [0, 0.4, 0]]]
    primitive["targets"] = [
        {"POSITION": model.positions(move), "NORMAL": model.accessor(normal)} for move, normal in zip(moves, turns)
    ]
    mesh = model.mesh(primitive, weights=[0.75, 0.25])
    model.node(mesh=mesh)
    model.node(mesh=mesh, weights=[-0.3, 0.9], translation=[0.3, 2.1, 0])
    return model


def skin() -> Model:
    """A bar bent by two joints; the transform of its own node has no effect."""
    model = Model()
    heights = [0.0, 0.7, 1.4, 2.1]
    rows = [[x, y, 0.05 * y] for y in heights for x in (-0.5, 0.5)]
    weights = [[1 - k / 3, k / 3, 0, 0] for k in range(4) for _ in range(2)]
    attributes = {
        "POSITION": model.positions(rows),
        "NORMAL": model.accessor([unit(x, 0.1, 1) for x, _, _ in rows]),
        "TEXCOORD_0": model.accessor([[x + 0.5, 1 - y / 2.1] for x, y, _ in rows]),
        "JOINTS_0": model.accessor([[0, 1, 0, 0]] * 8, UBYTE),
        "WEIGHTS_0": model.accessor(weights),
    }
    triangles = [number for k in range(0, 6, 2) for number in (k, k + 1, k + 3, k, k + 3, k + 2)]
    material = model.material(None, {"index": model.texture()})
    mesh = model.mesh(model.primitive(attributes, model.indices(triangles), material=material))
    root = model.node(translation=[0.4, 0.2, -0.3], rotation=turn([0, 1, 0], 30))
    first = model.node(root, rotation=turn([1, 0, 0], 10))
    second = model.node(first, translation=[0, 1, 0], rotation=turn([1, 0.4, 0], 45))
    inverse = [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1]]
    bind = model.accessor(inverse)
    index = model.add("skins", {"joints": [first, second], "inverseBindMatrices": bind, "skeleton": root})
    model.node(mesh=mesh, skin=index, translation=[5, 5, 5])
    return model


def flat() -> Model:
    """A tetrahedron without normals, texture coordinates and material, mirrored."""
    model = Model()
    rows = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2], [0.2, 1.1, 0.1], [0.3, 0.2, 1.2]]
    primitive = model.primitive(
        {"POSITION": model.positions(rows)}, model.indices([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2], UBYTE)
    )
    model.node(mesh=model.mesh(primitive), scale=[-1, 1.5, 1], rotation=turn([1, 1, 1], 40))
    return model


def camera(orthographic: bool = False) -> Model:
    """A camera below a turned node, whose near limit cuts the quad."""
    model = hierarchy()
    lens: Json
    if orthographic:
        lens = {"type": "orthographic", "orthographic": {"xmag": 2.5, "ymag": 1.5, "znear": 5, "zfar": 20}}
    else:
        lens = {"type": "perspective", "perspective": {"yfov": 0.7, "aspectRatio": 1.2, "znear": 5.2, "zfar": 50}}
    index = model.add("cameras", lens)
    parent = model.node(rotation=turn([0, 1, 0], 25))
    model.node(parent, translation=[0.2, 0.1, 5.5], rotation=turn([0.3, 0.2, 1], 18), camera=index)
    return model


def external() -> Model:
    """A buffer and an image in files."""
    model = External()
    model.node(mesh=model.mesh(quad(model, model.material(None, {"index": model.texture()}))))
    return model


def second_scene() -> Model:
    """The second scene is the default; a node of the first one is not shown."""
    model = hierarchy()
    model.root["scenes"].append({"nodes": [model.add("nodes", {"mesh": 0, "translation": [0, 0, -3]})]})
    model.root["scene"] = 1
    return model


def image_kinds() -> Model:
    """Images with alpha, with a palette, in grey, and with a gamma that must be ignored."""
    model = Model()
    alpha = [[[*texel, (70 * x + 40 * y) % 256] for x, texel in enumerate(row)] for y, row in enumerate(COLORS)]
    numbers = [[[4 * y + x] for x in range(4)] for y in range(4)]
    palette = bytes(part for row in COLORS[::-1] for texel in row for part in texel)
    grey = [[[60 * x + 15 * y] for x in range(4)] for y in range(4)]
    images = [png(alpha), png(numbers, palette), png(grey), png(COLORS, gamma=100000)]
    for number, image in enumerate(images):
        material = model.material(None, {"index": model.texture(None, image)})
        model.node(mesh=model.mesh(quad(model, material)), translation=[2.3 * (number % 2), 1.9 * (number // 2), 0])
    return model


def interleaved() -> Model:
    """All attributes in one buffer view, with gaps; two primitives share them."""
    model = Model()
    data = b"".join(
        struct.pack("<3f4x3h2x2H4B", *corner, *[round(32767 * part) for part in normal], *[round(65535 * p) for p in uv], *color)
        for corner, normal, uv, color in zip(
            CORNERS, NORMALS, UV, [[255, 128, 0, 1], [10, 255, 70, 2], [90, 30, 255, 3], [200, 210, 220, 4]]
        )
    )
    view = model.view(data, len(data) // 4, 34962)

    def accessor(offset: int, component: int, kind: str, **keys: Any) -> int:
        item = {"bufferView": view, "byteOffset": offset, "componentType": component, "count": 4, "type": kind}
        return model.add("accessors", {**item, **keys})

    attributes = {
        "POSITION": accessor(0, FLOAT, "VEC3", **limits(CORNERS)),
        "NORMAL": accessor(16, SHORT, "VEC3", normalized=True),
        "TEXCOORD_0": accessor(24, USHORT, "VEC2", normalized=True),
        "COLOR_0": accessor(28, UBYTE, "VEC4", normalized=True),
    }
    model.uses("KHR_mesh_quantization", required=True)
    first = model.material([1, 0.9, 0.8, 1], {"index": model.texture()})
    second = model.material([0.3, 0.7, 0.9, 1])
    primitives = [
        model.primitive(attributes, model.indices([0, 1, 2], UBYTE), material=first),
        model.primitive(attributes, model.indices([0, 2, 3], UINT), material=second),
    ]
    mesh = model.mesh(*primitives)
    model.node(mesh=mesh)
    model.node(mesh=mesh, translation=[0, 2, 0], scale=[1, 1, 2])
    return model


def color_kinds() -> Model:
    """Vertex colours without alpha, in floats and in 16 bits."""
    model = Model()
    material = model.material([0.9, 0.9, 0.5, 1])
    floats = model.accessor([[0.1, 0.9, 0.3], [1, 0, 0.4], [0.3, 0.25, 1], [0.8, 0.7, 0]])
    shorts = model.accessor([[65535, 100, 3000], [0, 40000, 9000], [777, 0, 50000], [30000, 20000, 65535]], USHORT, True)
    model.node(mesh=model.mesh(quad(model, material, COLOR_0=floats)))
    model.node(mesh=model.mesh(quad(model, material, COLOR_0=shorts)), translation=[0, 2, 0])
    return model


def transform_of_set() -> Model:
    """A texture transform that replaces the set of texture coordinates."""
    model = Model()
    other = model.accessor([[0.9, 0.1], [0.2, 0.3], [0.1, 0.8], [0.7, 0.95]])
    transform = {"texCoord": 1, "scale": [1.5, 0.75], "offset": [0.1, 0.2]}
    texture = {"index": model.texture(), "texCoord": 0, "extensions": {"KHR_texture_transform": transform}}
    model.uses("KHR_texture_transform")
    model.node(mesh=model.mesh(quad(model, model.material(None, texture), TEXCOORD_1=other)))
    return model


def instanced_turns() -> Model:
    """Instances with rotations in normalised bytes, and neither translations nor scales."""
    model = Model()
    # Of length 127.
    turns = [[0, 0, 0, 127], [66, 12, -45, 98]]
    model.uses("EXT_mesh_gpu_instancing")
    attributes = {"ROTATION": model.accessor(turns, BYTE, True)}
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    mesh = model.mesh(quad(model, model.material(None, {"index": model.texture()})))
    model.node(mesh=mesh, translation=[0.5, 0.2, 0.1], extensions=extensions)
    return model


def sparse_morph() -> Model:
    """A morph target that moves one vertex, in a sparse accessor over zeros."""
    model = Model()
    primitive = quad(model, model.material(None, {"index": model.texture()}))
    places, values = model.view(struct.pack("<B", 2)), model.view(struct.pack("<3f", 0.4, 0.7, 0.5))
    item: Json = {"componentType": FLOAT, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [single(0.4), single(0.7), 0.5]}
    item["sparse"] = {
        "count": 1,
        "indices": {"bufferView": places, "componentType": UBYTE},
        "values": {"bufferView": values},
    }
    primitive["targets"] = [{"POSITION": model.add("accessors", item)}]
    model.node(mesh=model.mesh(primitive), weights=[0.8])
    return model


def skin_of_bytes() -> Model:
    """Weights in normalised bytes, joints in 16 bits, and no inverse bind matrices."""
    model = skin()
    attributes = model.root["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = model.accessor([[255 - 85 * k, 85 * k, 0, 0] for k in range(4) for _ in range(2)], UBYTE, True)
    attributes["JOINTS_0"] = model.accessor([[0, 1, 0, 0]] * 8, USHORT)
    del model.root["skins"][0]["inverseBindMatrices"]
    return model


MODELS = {
    "hierarchy.gltf": hierarchy,
    "hierarchy.glb": hierarchy,
    "nearest.gltf": nearest,
    "wraps.gltf": wraps,
    "vertex_colors.glb": vertex_colors,
    "sparse.gltf": sparse,
    "strip.gltf": strip,
    "strip_without_indices.gltf": lambda: strip(False),
    "fan.gltf": fan,
    "texture_transform.gltf": texture_transform,
    "texture_rotation.gltf": lambda: texture_transform(rotation=-1.1),
    "texture_offset.gltf": lambda: texture_transform(offset=[0.35, 0.1]),
    "texture_scale.gltf": lambda: texture_transform(scale=[-0.8, 2.5]),
    "second_set.gltf": second_set,
    "quantized.glb": quantized,
    "instancing.gltf": instancing,
    "morph.gltf": morph,
    "skin.gltf": skin,
    "flat.gltf": flat,
    "external.gltf": external,
    "second_scene.glb": second_scene,
    "image_kinds.gltf": image_kinds,
    "interleaved.gltf": interleaved,
    "color_kinds.gltf": color_kinds,
    "transform_of_set.gltf": transform_of_set,
    "instanced_turns.gltf": instanced_turns,
    "sparse_morph.gltf": sparse_morph,
    "skin_of_bytes.gltf": skin_of_bytes,
    "camera.gltf": camera,
    "camera_orthographic.gltf": lambda: camera(True),
}


def write_all(folder: Path) -> List[Path]:
    """Writes all models; returns their paths."""
    return [make().write(folder / name) for name, make in MODELS.items()]
