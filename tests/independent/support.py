"""Shared by all tests: the models, runs of Whitstone, its images and its scenes."""

import contextlib
import os
import resource
import shutil
import sys
import tempfile
import time
import tomllib
import unittest
import zlib
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import models

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "references" / "protocol"))

from whitstone_protocol import exr  # noqa: E402

# What `run` installs.
TOOLS = Path(os.environ.get("WHITSTONE_INDEPENDENT") or ROOT / "target" / "independent")
MODULES = TOOLS / "node_modules"
BINARY = Path(os.environ.get("WHITSTONE") or ROOT / "target" / "release" / "whitstone").resolve()
WIDTH, HEIGHT = 256, 192
ADDRESSES = 8 * 2**30

Json = Dict[str, Any]


def skip(reason: str) -> unittest.SkipTest:
    """Prints why tests are skipped, for they must not be skipped silently."""
    print(f"skipped: {reason}", flush=True)
    return unittest.SkipTest(reason)


def public_models() -> List[Path]:
    """The models below $WHITSTONE_TEST_DATA/gltf; none if that is not set."""
    data = os.environ.get("WHITSTONE_TEST_DATA")
    folder = Path(data or "/nonexistent") / "gltf"
    if not data or not folder.is_dir():
        print("skipped: public models, since WHITSTONE_TEST_DATA is not set")
        return []
    return sorted(path for path in folder.rglob("*") if path.suffix in (".gltf", ".glb"))


def label(path: Path) -> str:
    """A short name of a model: its last two folders and its file."""
    return "/".join(path.parts[-3:]) if "gltf" in path.parts else path.name


class Case(unittest.TestCase):
    """A test with a temporary folder, in which the models of this folder stand in `own`."""

    folder: Path
    own: List[Path]

    @classmethod
    def setUpClass(cls) -> None:
        if not BINARY.is_file():
            raise FileNotFoundError(f"no binary at {BINARY}: set WHITSTONE")
        cls.folder = Path(tempfile.mkdtemp(prefix="whitstone-independent-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        (cls.folder / "own").mkdir()
        cls.own = models.write_all(cls.folder / "own")


class Run(NamedTuple):
    """How a process ended: exit code (negative for a signal), seconds of processor time, MiB and its
    messages.
    """

    code: int
    seconds: float
    mebibytes: float
    messages: str


def whitstone(*arguments: str, limit: float = 60.0) -> Run:
    """Runs Whitstone; kills it after `limit` seconds, and gives it 8 GiB of addresses at most, so
    that a fault does not take the memory of other programs.
    """
    with tempfile.TemporaryFile("w+", errors="replace") as log:
        start = time.monotonic()
        process = Popen([str(BINARY), *arguments], cwd=ROOT, stdin=DEVNULL, stdout=DEVNULL, stderr=log)
        with contextlib.suppress(ProcessLookupError):
            resource.prlimit(process.pid, resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        while True:
            # wait4 has the memory of this process alone. It is an upper bound: Linux counts what
            # this interpreter had in memory when it started the process.
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - start > limit:
                process.kill()
            time.sleep(0.001)
        process.returncode = os.waitstatus_to_exitcode(status)
        log.seek(0)
        return Run(process.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, log.read())


def size(width: int, height: int) -> List[str]:
    return ["--set", f"film.width={width}", "--set", f"film.height={height}"]


class View(NamedTuple):
    """Camera of a scene: origin, axes to the right, up and backwards, and its window."""

    origin: Any
    u: Any
    v: Any
    w: Any
    window: Tuple[float, float, float, float]
    orthographic: bool
    near: float


class Shape(NamedTuple):
    """A shape of a scene: where it is in the file, and whether instances place it."""

    mesh: int
    primitive: int
    first_set: Optional[int]
    grouped: bool


class Scene(NamedTuple):
    """What the tests need to know of a converted scene: its camera, its shapes by number, the group
    of each instance, its image by channels, and whether a texture has the filter "nearest".
    """

    view: View
    shapes: List[Shape]
    instances: List[str]
    channels: Dict[str, Any]
    nearest: bool


def view(camera: Json) -> View:
    """The camera of a scene, by section 4 of docs/whitted-model.md."""
    import numpy as np

    place = camera["look_at"]
    origin = np.array(place["origin"], float)
    w = origin - np.array(place["target"], float)
    w /= np.linalg.norm(w)
    u = np.cross(np.array(place.get("up", [0, 1, 0]), float), w)
    u /= np.linalg.norm(u)
    orthographic = camera["type"] == "orthographic"
    given = camera.get("window")
    if given is not None:
        distance = given.get("d", 1.0)
        left, right, bottom, top = (given[key] / distance for key in "lrbt")
    elif orthographic:
        right = camera.get("width", 2.0) / 2
        left, top, bottom = -right, right * HEIGHT / WIDTH, -right * HEIGHT / WIDTH
    else:
        half = np.tan(np.radians(camera.get("fov", 45.0)) / 2)
        axis = camera.get("fov_axis", "x")
        along_x = axis == "x" or axis == ("smaller" if WIDTH <= HEIGHT else "larger")
        right = half if along_x else half * WIDTH / HEIGHT
        top = right * HEIGHT / WIDTH
        left, bottom = -right, -top
    window = (float(left), float(right), float(bottom), float(top))
    return View(origin, u, np.cross(w, u), w, window, orthographic, camera.get("near", 0.0))


def shapes(scene: Json) -> List[Shape]:
    """The shapes by their numbers (docs/whitted-model.md, section 9)."""

    def of(item: Json, grouped: bool) -> Shape:
        sets = item.get("uv_sets", [0])
        return Shape(item.get("mesh", -1), item.get("primitive", 0), sets[0] if sets else None, grouped)

    found = [of(item, False) for item in scene["shape"]]
    for _, group in sorted(scene.get("group", {}).items()):
        found += [of(item, True) for item in group["shape"]]
    return found


def render(path: Path, folder: Path, *settings: str) -> Scene:
    """Renders a model with all layers, and converts it to see its camera."""
    image, converted = folder / "image.exr", folder / "scene.toml"
    layers = 'film.aovs=["depth","normal","uv","shape_id","primitive_id"]'
    arguments = [*size(WIDTH, HEIGHT), "--set", layers, *settings]
    for command in (["render", str(path), "-o", str(image), *arguments], ["convert", str(path), str(converted)]):
        ended = whitstone(*command)
        if ended.code:
            raise AssertionError(f"{path}: {command[0]} ended with {ended.code}: {ended.messages}")
    scene = tomllib.loads(converted.read_text())
    instances = [shape["group"] for shape in scene["shape"] if shape["type"] == "instance"]
    nearest = any(texture.get("filter") == "nearest" for texture in scene.get("texture", {}).values())
    return Scene(view(scene["camera"]), shapes(scene), instances, read_exr(image), nearest)


def read_exr(path: Path) -> Dict[str, Any]:
    """The channels of an image of float32 with ZIP compression, top row first."""
    import numpy as np

    data = path.read_bytes()
    attributes, at = exr.header(data)
    names = exr.channel_types(attributes["channels"])
    if {kind for _, kind in names} != {exr.FLOAT} or attributes["compression"] != bytes([exr.ZIP]):
        raise AssertionError(f"{path}: expected float32 channels with ZIP compression")
    left, top, right, bottom = np.frombuffer(attributes["dataWindow"], "<i4")
    width, height = int(right - left + 1), int(bottom - top + 1)
    rows = np.empty((height, len(names), width), "<f4")
    for offset in np.frombuffer(data, "<u8", -(-height // exr.LINES_PER_BLOCK), at):
        first, stored = (int(number) for number in np.frombuffer(data, "<i4", 2, int(offset)))
        packed = data[int(offset) + 8 : int(offset) + 8 + stored]
        count = min(exr.LINES_PER_BLOCK, height - (first - int(top)))
        expected = count * len(names) * width * 4
        if stored < expected:
            differences = np.frombuffer(zlib.decompress(packed), np.uint8).astype(np.int64)
            differences[1:] -= 128
            halves = np.cumsum(differences).astype(np.uint8)
            raw = np.empty(expected, np.uint8)
            raw[0::2], raw[1::2] = halves[: (expected + 1) // 2], halves[(expected + 1) // 2 :]
            packed = raw.tobytes()
        rows[first - int(top) : first - int(top) + count] = np.frombuffer(packed, "<f4").reshape(count, len(names), width)
    return {name: rows[:, k, :].astype(np.float64) for k, (name, _) in enumerate(names)}
