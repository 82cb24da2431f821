"""Renders a scene with POV-Ray: all channels, all samples, and several exposures to recover what
half floats round away.

POV-Ray writes half floats, which are rounded by up to 2^-11 of the value. The image is linear in
the brightness of the lights. So the same scene with brighter lights is the same image with
different rounding, and each rendering gives a range that contains the value. With n = EXPOSURES
renderings, each brighter by 1/n of a unit in the last place, the range shrinks to 1/n.
"""

from __future__ import annotations

import functools
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

from . import halves, povray
from .document import Document, parse
from .materials import NeedsChannels
from .settings import Setting

# Exposures per sample. The mean of many samples needs fewer, because their rounding errors are
# independent.
EXPOSURES = 8
# Binary digits of an image: two more than the exposures resolve.
DIGITS = 16

Image = List[List[halves.Color]]


@dataclass(frozen=True)
class Scene:
    """The scene to render."""

    text: str
    base: str


def documents(scene: Scene, setting: Setting) -> List[Document]:
    """One document for all channels, or one for each of the three."""
    try:
        return [parse(scene.text, scene.base, setting)]
    except NeedsChannels:
        return [parse(scene.text, scene.base, setting, channel) for channel in range(3)]


@functools.lru_cache(16)
def _check(program: str) -> None:
    """Refuses a scene that fails the checks of POV-Ray's own program."""
    if program:
        povray.render(program, 1, 1, (0, 0, 1, 1))


# Bounds on the brightest pixel of an image, both powers of two: between them, half floats are
# precise and do not overflow. The step is their ratio.
DIMMEST, BRIGHTEST = 2.0**-6, 2.0**14
STEP = BRIGHTEST / DIMMEST


@functools.lru_cache(16)
def _brightening(scene: Scene) -> float:
    """A power of two by which all light is multiplied, so that the image is in the range of half
    floats.
    """
    factor = 1.0
    # A black image stays black at any brightness: try a few times only.
    for _ in range(6):
        image = images(scene, [Setting(exposure=factor)], 1, None, 1.0)[0]
        brightest = max(abs(component) for row in image for color in row for component in color) * factor
        if DIMMEST <= brightest <= BRIGHTEST:
            return factor
        if brightest < DIMMEST and factor >= STEP**3:
            return 1.0
        factor *= STEP if brightest < DIMMEST else 1 / STEP
    return factor


def _workers() -> int:
    # For small images, POV-Ray spends most of its time waiting.
    return 4 * (os.cpu_count() or 1)


def brightness(exposures: int) -> List[float]:
    """Factors on the light: a unit in the last place is between 2^-11 and 2^-10 of the value.

    Values that are exact half floats, as those of backgrounds often are, come to lie in the middle
    of their range.
    """
    return [1.0] if exposures == 1 else [1.0 + (step + 0.5) * 2.0**-10 / exposures for step in range(exposures)]


def images(
    scene: Scene,
    settings: Sequence[Setting],
    exposures: int = 1,
    window: Optional[halves.Window] = None,
    brighter: Optional[float] = None,
) -> List[Image]:
    """The mean over the samples of every pixel of a window, one image per setting. Equal scenes are
    rendered once.

    All light is multiplied by `brighter`, or by the factor that the scene needs if it is None; this
    does not change the image.
    """
    brighter = _brightening(scene) if brighter is None else brighter
    factors = [brighter * factor for factor in brightness(exposures)]
    found = [[documents(scene, replace(setting, exposure=setting.exposure * f)) for f in factors] for setting in settings]
    _check(found[0][0][0].check)
    jobs: Dict[str, Tuple[str, int, int, halves.Window]] = {}
    for document in (document for brackets in found for channels in brackets for document in channels):
        whole = (0, 0, document.width, document.height)
        for sample in document.samples:
            text = document.write(sample)
            jobs[text] = (text, document.width, document.height, window or whole)
    with ThreadPoolExecutor(_workers()) as pool:
        rendered = dict(zip(jobs, pool.map(lambda job: povray.render(*job), jobs.values())))
    return [_image(brackets, rendered) for brackets in found]


def _image(brackets: List[List[Document]], rendered: Dict[str, Image]) -> Image:
    """Combines all exposures, channels and samples of one setting."""
    exposures = [channels[0].setting.exposure for channels in brackets]
    samples = brackets[0][0].samples
    total: Image = []
    for sample in samples:
        planes = [[rendered[document.write(sample)] for document in channels] for channels in brackets]
        # Channel c of colour renderings is in the only image; with separate channels, in the image
        # of that channel.
        sources = [[images[c if len(images) > 1 else 0] for images in planes] for c in range(3)]
        values = [[[_bracketed(colors, exposures, c) for colors in zip(*rows)] for rows in zip(*sources[c])] for c in range(3)]
        image = [list(zip(*rows)) for rows in zip(*values)]
        total = image if not total else [[_sum(a, b) for a, b in zip(*rows)] for rows in zip(total, image)]
    share = 1.0 / len(samples)
    return [[(share * r, share * g, share * b) for r, g, b in row] for row in total]


def _sum(a: halves.Color, b: halves.Color) -> halves.Color:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _bracketed(colors: Sequence[halves.Color], exposures: Sequence[float], channel: int) -> float:
    """The middle of the intersection of all ranges."""
    if len(colors) == 1:
        return colors[0][channel] / exposures[0]
    low, high = -math.inf, math.inf
    for color, exposure in zip(colors, exposures):
        half = color[channel]
        if half == 0.0:
            return 0.0
        bottom, top = halves.bracket(half)
        low, high = max(low, bottom / exposure), min(high, top / exposure)
    # POV-Ray's colours are single precision, so the ranges may just miss each other.
    return 0.5 * (low + high)


def render(scene: Scene, setting: Setting) -> Tuple[Image, Document]:
    """The image with the highest precision that POV-Ray allows."""
    document = documents(scene, setting)[0]
    count = max(4, min(EXPOSURES, 4 * EXPOSURES // len(document.samples)))
    rows = images(scene, [setting], count)[0]
    return [[(_short(r), _short(g), _short(b)) for r, g, b in row] for row in rows], document


def _short(value: float) -> float:
    """Rounds off meaningless digits, which makes stored images smaller."""
    mantissa, exponent = math.frexp(value)
    return math.ldexp(round(math.ldexp(mantissa, DIGITS)), exponent - DIGITS)
