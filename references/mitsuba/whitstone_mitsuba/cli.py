"""The operations on the command line: `python -m whitstone_mitsuba render SCENE.toml -o OUT.exr`
and so on.
"""

from __future__ import annotations

import argparse
from typing import List, Optional, Sequence

from whitstone_protocol import commands
from whitstone_protocol.serve import Answerer


def _parser() -> commands.Parser:
    parser = commands.Parser("whitstone_mitsuba", "Mitsuba 3 as a deterministic Whitted tracer.")
    parser.serve.add_argument(
        "--twin", action="append", default=[], metavar="FILE", help="Python file with twins of out-of-tree plugins (see `twins.py`); may be repeated"
    )

    def add(name: str, text: str) -> argparse.ArgumentParser:
        command = parser.add(name, text)
        command.add_argument("--threads", type=int, default=0, help="number of threads; 0 means all (default)")
        unit = "2^-24 (s + max abs of p), where s is the largest coordinate of the shape, at most 1 m"
        command.add_argument("--k", type=float, default=4.0, help=f"spawn offset, in units of {unit}")
        command.add_argument("--not-robust", action="store_true", help="disable Mitsuba's `embree_use_robust_intersections`")
        command.add_argument("--dx", type=float, default=0.0, help="shift of every sample, in pixels")
        command.add_argument("--dy", type=float, default=0.0, help="shift of every sample, in pixels, downward")
        command.add_argument("--ulps", type=float, default=0.0, help="perturbation of every ray, in units of 2^-24")
        command.add_argument("--largest", action="store_true", help="perturb relative to the largest component of each vector")
        command.add_argument("--vertices", action="store_true", help="round mesh vertices stochastically, by the seed")
        command.add_argument("--seed", type=int, default=0, help="seed of the perturbation and of the rounding")
        return command

    add("render", "render the scene to an EXR file").add_argument("-o", "--out", required=True)
    stock = add("stock", "render with Mitsuba's own `direct` or `path` integrator to an EXR file, with layers for the variance")
    stock.add_argument("-o", "--out", required=True)
    stock.add_argument("--repeats", type=int, default=64, help="number of samples per camera ray")
    add("probe", "print the values of some pixels").add_argument("pixels", nargs="+", metavar="X,Y")
    tree = add("tree", "print the ray tree of one sample of a pixel")
    tree.add_argument("pixel", metavar="X,Y")
    tree.add_argument("--sample", type=int, default=0)
    add("check", "compare the driver with Mitsuba's own `direct` and `path` integrators")
    timing = add("time", "measure run times of the driver and of Mitsuba's `path`, after warm-up")
    timing.add_argument("--repeats", type=int, default=3)
    timing.add_argument("--path-depth", type=int)
    return parser


def _complete(arguments: commands.Arguments) -> dict:
    """The driver's own keys of the request for a command line."""
    setting = {key: getattr(arguments, key) for key in ("k", "dx", "dy", "ulps", "seed")}
    setting["robust"] = not arguments.not_robust
    setting["vertices"] = arguments.vertices
    setting["largest"] = arguments.largest
    request: dict = {"threads": arguments.threads, "setting": setting}
    for key in ("out", "sample", "repeats", "path_depth"):
        if getattr(arguments, key, None) is not None:
            request[key] = getattr(arguments, key)
    if arguments.op == "probe":
        request["pixels"], request["settings"] = [commands.pixel(text) for text in arguments.pixels], [setting]
    if arguments.op == "tree":
        request["pixel"] = commands.pixel(arguments.pixel)
    return request


def _load(twins: Sequence[str]) -> Answerer:
    """Imports Mitsuba, which may be impossible. `twins`: files with twins of out-of-tree plugins.
    """
    from .operations import answer

    if twins:
        from .twins import load

        load(twins)
    return answer


def main(argv: Optional[List[str]] = None) -> int:
    """Returns the exit code: see `commands.main`."""
    arguments = _parser().parse(argv)
    twins = arguments.twin if arguments.op == "serve" else ()
    return commands.main(arguments, lambda: _load(twins), _complete)
