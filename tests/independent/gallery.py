"""Pictures of models by three.js, lit, for `cargo xtask gallery`.

    gallery.py JOBS.json

JOBS.json is a list of `{"model", "scene", "width", "height", "png"}`: the model, the scene in TOML
that Whitstone has converted it to, and the picture to write. Prints a line for each that fails.
"""

import json
import os
import struct
import sys
import tomllib
import zlib
from pathlib import Path
from typing import Any, List
from urllib.parse import quote

import browser
import support
from support import MODULES, Json

try:
    import numpy as np
except ImportError as missing:
    sys.exit(f"skipped: {missing.name} is not installed")


def lights(scene: Json) -> Json:
    """The lights that Whitstone has added to a model without any."""
    found: Json = {"background": 0.0}
    for light in scene.get("light", []):
        if light["type"] == "directional":
            found["direction"], found["irradiance"] = light["direction"], light["irradiance"]
        elif light["type"] in ("ambient", "background"):
            found[light["type"]] = light["radiance"]
    return found


def job(task: Json, root: Path) -> Json:
    scene = tomllib.loads(Path(task["scene"]).read_text())
    # The shape of the window depends on that of the film.
    support.WIDTH, support.HEIGHT = task["width"], task["height"]
    view = support.view(scene["camera"])
    camera: Json = {key: getattr(view, key).tolist() for key in ("origin", "u", "v", "w")}
    # How far things are is not known here.
    camera.update(window=view.window, orthographic=view.orthographic, shift=0.0)
    return {
        "lit": True,
        "model": "/models/" + quote(str(Path(task["model"]).resolve().relative_to(root))),
        "width": task["width"],
        "height": task["height"],
        "camera": camera,
        "lights": lights(scene),
    }


def write_png(path: str, linear: Any) -> None:
    """Writes linear RGB from 0 to 1, top row first, as sRGB."""
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rows = np.rint(255 * encoded).astype(np.uint8)
    height, width, _ = rows.shape
    raw = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
    Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + data)


def main(tasks: List[Json]) -> int:
    chromium = browser.program()
    if chromium is None or not (MODULES / "three").is_dir():
        print("skipped: three.js or Chromium is not installed; tests/independent/run installs them")
        return 0
    root = Path(os.path.commonpath([Path(task["model"]).resolve().parent for task in tasks]))
    page = browser.Browser(chromium, MODULES, root)
    try:
        for task in tasks:
            try:
                data = page.render(job(task, root))
                image = np.frombuffer(data, "<f4").reshape(task["height"], task["width"], 4)[::-1, :, :3]
                write_png(task["png"], image.astype(float))
            except (RuntimeError, TimeoutError) as error:
                print(f"{task['model']}: {str(error).splitlines()[0]}")
    finally:
        page.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(json.loads(Path(sys.argv[1]).read_text())))
