"""The driver of the reference, in this process. Needs ``pip install whitstone[mitsuba]``."""

from __future__ import annotations

import os
import sys
from typing import Any, Union

from . import _native
from ._scene import Scene, Source


def load(scene: Union[Source, Scene]) -> Any:
    """The Mitsuba scene (``mi.Scene``) that the driver builds: its shapes, without lights or camera.

    The driver computes lights, materials and the camera itself; ``whitstone.convert(scene,
    "scene.xml")`` writes a scene that Mitsuba can render alone.
    """
    if not isinstance(scene, Scene):
        scene = Scene(scene)
    folder = _native.drivers()
    for package in ("mitsuba", "protocol"):
        path = os.path.join(folder, package)
        if path not in sys.path:
            sys.path.append(path)
    try:
        from whitstone_mitsuba import document, settings  # type: ignore[import-not-found]
        from whitstone_mitsuba import scene as builder
    except ImportError as error:
        raise ImportError(f"Mitsuba is not installed in this Python: pip install 'whitstone[mitsuba]' ({error})") from error
    text, base = scene._native.flattened()
    parsed = document.parse(text, base)
    return builder.Built(parsed, settings.Setting()).scene
