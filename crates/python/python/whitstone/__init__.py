"""Whitstone: a Whitted ray tracer that is validated against Mitsuba 3, pixel by pixel.

>>> import whitstone
>>> scene = whitstone.Scene('''
... film = { width = 32, height = 24 }
... camera = { type = "perspective", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }
... light = [{ type = "ambient", radiance = 1 }]
... shape = [{ type = "sphere" }]
... ''')
>>> image = scene.render()
>>> image.rgb.shape
(24, 32, 3)
>>> wide = scene.with_({"camera.fov": 90}).render()
>>> whitstone.compare(image, wide).rmse > 0
True

Images are NumPy arrays of linear radiance, row by row from the top. The documentation of scenes is
that of the command line: ``python -m whitstone list``.
"""

from __future__ import annotations

from ._errors import Problem, SceneError
from ._image import Comparison, Image, compare
from ._native import __version__
from ._scene import Hits, Scene, render
from ._tools import CommandError, Validation, convert, explain, validate

__all__ = [
    "CommandError",
    "Comparison",
    "Hits",
    "Image",
    "Problem",
    "Scene",
    "SceneError",
    "Validation",
    "__version__",
    "compare",
    "convert",
    "explain",
    "render",
    "validate",
]
