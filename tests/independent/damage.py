"""Damaged copies of models, the same in each run."""

import base64
import json
import random
import struct
from pathlib import Path
from typing import Any, Iterator, List, Tuple

import copies

Json = Any
# Values that take the place of others.
NUMBERS: List[Json] = [-1, 0, 1, 3, 255, 65535, 2**31, 2**53, 1e30, -0.5, None, "1"]
OTHERS: List[Json] = [None, [], {}, "", "x", 7, True]


def places(value: Json, path: Tuple[Any, ...] = ()) -> Iterator[Tuple[Any, ...]]:
    """The path of each value of a document."""
    if path:
        yield path
    items: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def changed(root: Json, path: Tuple[Any, ...], value: Json, remove: bool) -> Json:
    """The document with another value at a place, or without it."""
    result = json.loads(json.dumps(root))
    at = result
    for key in path[:-1]:
        at = at[key]
    if remove:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return result


def documents(path: Path, folder: Path, count: int) -> List[Path]:
    """Copies with one value of the JSON removed or replaced."""
    root, chunk = copies.read(path)
    chance = random.Random(f"{path.name} documents")
    everywhere = [place for place in places(root) if place[-1] not in ("uri", "asset", "extras")]
    written = []
    for number in range(count):
        place = chance.choice(everywhere)
        old: Json = root
        for key in place:
            old = old[key]
        is_number = isinstance(old, (int, float)) and not isinstance(old, bool)
        value = chance.choice(NUMBERS if is_number else OTHERS)
        target = folder / f"{path.stem}_{number}{path.suffix}"
        copies.write(target, changed(root, place, value, chance.random() < 0.25), chunk)
        written.append(target)
    return written


def containers(path: Path, folder: Path, count: int) -> List[Path]:
    """Copies of a .glb that are cut, or have a changed byte or length."""
    data = path.read_bytes()
    chance = random.Random(f"{path.name} containers")
    (length,) = struct.unpack_from("<I", data, 12)
    headers = [*range(20), *range(20 + length, 28 + length)]
    written = []
    for number in range(count):
        kind = number % 3
        result = bytearray(data)
        if kind == 0:
            del result[chance.choice([chance.randrange(40), chance.randrange(len(data))]) :]
        elif kind == 1:
            result[chance.choice(headers)] ^= 1 << chance.randrange(8)
        else:
            result[chance.randrange(len(data))] = chance.randrange(256)
        target = folder / f"{path.stem}_{number}.glb"
        target.write_bytes(result)
        written.append(target)
    return written


def buffers(path: Path, folder: Path, count: int) -> List[Path]:
    """Copies whose data have random bytes in places: indices, numbers and images."""
    root, chunk = copies.read(path)
    chance = random.Random(f"{path.name} buffers")
    written = []
    for number in range(count):
        result = json.loads(json.dumps(root))
        head, text = result["buffers"][0]["uri"].split(",", 1)
        data = bytearray(base64.b64decode(text))
        for _ in range(4):
            data[chance.randrange(len(data))] = chance.choice([0, 127, 128, 255, chance.randrange(256)])
        result["buffers"][0]["uri"] = head + "," + base64.b64encode(data).decode()
        target = folder / f"{path.stem}_data_{number}.gltf"
        copies.write(target, result, chunk)
        written.append(target)
    return written
