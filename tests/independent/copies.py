"""Copies of models in which only geometry and base colours remain to be compared."""

import base64
import json
import shutil
import struct
from pathlib import Path
from typing import Any, Callable, Dict, Optional, Sequence, Tuple
from urllib.parse import quote, unquote

from models import single

Json = Dict[str, Any]
Change = Callable[[Json], None]


def read(path: Path) -> Tuple[Json, bytes]:
    """The JSON of a model, and the binary chunk of a .glb."""
    data = path.read_bytes()
    if not data.startswith(b"glTF"):
        return json.loads(data), b""
    (length,) = struct.unpack_from("<I", data, 12)
    root = json.loads(data[20 : 20 + length])
    at = 20 + length
    if at + 8 > len(data):
        return root, b""
    (length,) = struct.unpack_from("<I", data, at)
    return root, data[at + 8 : at + 8 + length]


def write(path: Path, root: Json, chunk: bytes) -> None:
    if path.suffix == ".gltf":
        path.write_text(json.dumps(root))
        return
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    if chunk:
        chunk += b"\0" * (-len(chunk) % 4)
        chunks += struct.pack("<2I", len(chunk), 0x004E4942) + chunk
    path.write_bytes(struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks)


def has_triangles(path: Path) -> bool:
    """Whether a model has primitives of triangles, strips or fans."""
    root, _ = read(path)
    modes = [primitive.get("mode", 4) for mesh in root.get("meshes", []) for primitive in mesh["primitives"]]
    return any(mode >= 4 for mode in modes)


def shows_triangles(path: Path) -> bool:
    """Whether the scene that is shown by default has a node with such a primitive."""
    root, _ = read(path)
    scenes, nodes, meshes = (root.get(key, []) for key in ("scenes", "nodes", "meshes"))
    scene = root.get("scene", 0)
    waiting = list(scenes[scene].get("nodes", [])) if scenes else []
    while waiting:
        node = nodes[waiting.pop()]
        if 0 in node.get("scale", []):
            # Flattened nodes are left out, which the summary of an import says.
            continue
        waiting += node.get("children", [])
        primitives = meshes[node["mesh"]]["primitives"] if "mesh" in node else []
        for primitive in primitives:
            place = primitive.get("indices", primitive["attributes"].get("POSITION"))
            enough = place is not None and root["accessors"][place]["count"] >= 3
            if enough and primitive.get("mode", 4) >= 4:
                return True
    return False


def companion(path: Path, uri: str) -> Optional[Path]:
    """The file that a URI names. Some models name a folder of images that has another name."""
    named = path.parent / unquote(uri)
    other = path.parent / "Textures" / named.name
    return named if named.is_file() else other if other.is_file() else None


def unlit(root: Json) -> None:
    """All materials: unlit, opaque, visible from both sides, and textures without mip maps."""
    materials = root.setdefault("materials", [])
    for mesh in root.get("meshes", []):
        for primitive in mesh["primitives"]:
            if "material" not in primitive:
                primitive["material"] = len(materials)
                materials.append({})
    for material in materials:
        base = material.get("pbrMetallicRoughness", {})
        kept = {key: base[key] for key in ("baseColorFactor", "baseColorTexture") if key in base}
        name = {"name": material["name"]} if "name" in material else {}
        extensions = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
        material.clear()
        material.update({**name, "pbrMetallicRoughness": kept, **extensions})
    if not materials:
        del root["materials"]
    used = root.setdefault("extensionsUsed", [])
    if "KHR_materials_unlit" not in used:
        used.append("KHR_materials_unlit")
    for sampler in root.get("samplers", []):
        # One filter for both directions.
        magnified = sampler.get("magFilter", 9729)
        sampler["minFilter"] = sampler["magFilter"] = magnified
    if any("sampler" not in texture for texture in root.get("textures", [])):
        sampler = len(root.setdefault("samplers", []))
        root["samplers"].append({"minFilter": 9729, "magFilter": 9729})
        for texture in root["textures"]:
            texture.setdefault("sampler", sampler)


def single_nodes(root: Json) -> None:
    """The numbers of all nodes in single precision, in which ours reads them."""
    for node in root.get("nodes", []):
        for key in ("matrix", "translation", "rotation", "scale"):
            if key in node:
                node[key] = [single(number) for number in node[key]]


def copy(path: Path, folder: Path, *changes: Change) -> Path:
    """Writes a changed copy of a model with the files that it names; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    root, chunk = read(path)
    for item in root.get("buffers", []) + root.get("images", []):
        uri = item.get("uri")
        if uri is None or uri.startswith("data:"):
            continue
        file = companion(path, uri)
        if file is None:
            raise FileNotFoundError(f"{path} names {uri}, which is not there")
        shutil.copyfile(file, folder / file.name)
        item["uri"] = quote(file.name)
    for change in changes:
        change(root)
    target = folder / path.name
    write(target, root, chunk)
    return target


def change_numbers(root: Json, accessor: int, of: Callable[[int, float], float]) -> None:
    """Changes the float numbers of an accessor, by column and value, in a buffer of a data URI."""
    item = root["accessors"][accessor]
    where = root["bufferViews"][item["bufferView"]]
    buffer = root["buffers"][where["buffer"]]
    head, text = buffer["uri"].split(",", 1)
    data = bytearray(base64.b64decode(text))
    columns = {"VEC2": 2, "VEC3": 3}[item["type"]]
    stride = where.get("byteStride", 4 * columns)
    for i in range(item["count"]):
        at = where.get("byteOffset", 0) + item.get("byteOffset", 0) + i * stride
        row = struct.unpack_from(f"<{columns}f", data, at)
        struct.pack_into(f"<{columns}f", data, at, *[of(k, value) for k, value in enumerate(row)])
    buffer["uri"] = head + "," + base64.b64encode(data).decode()


def change_indices(root: Json, accessor: int, numbers: Sequence[int]) -> None:
    """Replaces the indices of an accessor of 16 bits, in a buffer of a data URI."""
    where = root["bufferViews"][root["accessors"][accessor]["bufferView"]]
    buffer = root["buffers"][where["buffer"]]
    head, text = buffer["uri"].split(",", 1)
    data = bytearray(base64.b64decode(text))
    struct.pack_into(f"<{len(numbers)}H", data, where.get("byteOffset", 0), *numbers)
    buffer["uri"] = head + "," + base64.b64encode(data).decode()


def transposed(root: Json) -> None:
    """The linear parts of all matrices transposed."""
    for node in root["nodes"]:
        if "matrix" in node:
            rows = [node["matrix"][i::4] for i in range(3)]
            linear = [[rows[j][i] for j in range(3)] + [rows[i][3]] for i in range(3)] + [[0, 0, 0, 1]]
            node["matrix"] = [linear[i][j] for j in range(4) for i in range(4)]


def unmirrored(root: Json) -> None:
    """All scales without their signs."""
    for node in root["nodes"]:
        if "scale" in node:
            node["scale"] = [abs(part) for part in node["scale"]]
