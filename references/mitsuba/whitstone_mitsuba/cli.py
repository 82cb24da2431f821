"""The operations on the command line: `python -m whitstone_mitsuba render SCENE.toml -o OUT.exr`
and so on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from typing import List, Optional


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whitstone_mitsuba", description="Mitsuba 3 as a deterministic Whitted tracer.")
    commands = parser.add_subparsers(dest="op", required=True)
    serve = commands.add_parser("serve", help="answer JSON requests from standard input, one per line")
    serve.add_argument(
        "--twin", action="append", default=[], metavar="FILE", help="Python file with twins of out-of-tree plugins (see `twins.py`); may be repeated"
    )
    commands.add_parser("hello", help="print versions and a description of the machine")

    def add(name: str, text: str, setting: bool = True) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument("scene", help="a flattened scene document (TOML)")
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


def _pair(text: str) -> List[int]:
    try:
        x, y = (int(part) for part in text.split(","))
    except ValueError:
        raise SystemExit(f"expected a pixel as X,Y, found {text!r}") from None
    return [x, y]


def _request(arguments: argparse.Namespace) -> dict:
    """The protocol request for a command line."""
    request: dict = {"op": arguments.op}
    if arguments.op == "hello":
        return request
    with open(arguments.scene, encoding="utf-8") as file:
        request["scene"] = file.read()
    request["base"] = os.path.dirname(os.path.abspath(arguments.scene))
    request["threads"] = arguments.threads
    setting = {key: getattr(arguments, key) for key in ("k", "dx", "dy", "ulps", "seed")}
    setting["robust"] = not arguments.not_robust
    setting["vertices"] = arguments.vertices
    setting["largest"] = arguments.largest
    request["setting"] = setting
    for key in ("out", "sample", "repeats", "path_depth"):
        if getattr(arguments, key, None) is not None:
            request[key] = getattr(arguments, key)
    if arguments.op == "probe":
        request["pixels"], request["settings"] = [_pair(text) for text in arguments.pixels], [setting]
    if arguments.op == "tree":
        request["pixel"] = _pair(arguments.pixel)
    return request


def main(argv: Optional[List[str]] = None) -> int:
    """Exit codes as everywhere in Whitstone: 0 success, 2 invalid scene or request, 3 this machine
    cannot run the driver.
    """
    arguments = _parser().parse_args(argv)
    if arguments.op == "serve":
        from .serve import run

        return run(arguments.twin)
    try:
        request = _request(arguments)
    except OSError as error:
        print(f"{arguments.scene}: {error.strerror}", file=sys.stderr)
        return 2
    try:
        from .operations import answer
    except Exception as error:
        print(error, file=sys.stderr)
        return 3
    reply = answer(request)
    if not reply["ok"]:
        print(f"{reply['kind']}: {reply['error']}", file=sys.stderr)
        return 3 if reply["kind"] == "internal" else 2
    del reply["ok"]
    print(json.dumps(reply, indent=2))
    return 0
