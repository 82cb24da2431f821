"""The operations on the command line: `python -m whitstone_povray render SCENE.toml -o OUT.exr` and
so on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from typing import List, Optional

from .operations import answer
from .serve import run


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="whitstone_povray", description="POV-Ray as a deterministic Whitted tracer.")
    commands = parser.add_subparsers(dest="op", required=True)
    commands.add_parser("serve", help="answer JSON requests from standard input, one per line")
    commands.add_parser("hello", help="print versions and a description of the machine")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument("scene", help="a flattened scene document (TOML)")
        command.add_argument("--k", type=float, default=4.0, help="POV-Ray's self-intersection thresholds, in units of 1e-3/4096 m")
        command.add_argument("--dx", type=float, default=0.0, help="shift of every sample, in pixels")
        command.add_argument("--dy", type=float, default=0.0, help="shift of every sample, in pixels, downward")
        command.add_argument("--exposure", type=float, default=1.0, help="factor on all light, divided out of the image again")
        command.add_argument("--vertices", action="store_true", help="round mesh vertices stochastically, by the seed")
        command.add_argument("--seed", type=int, default=0, help="seed of the rounding")
        return command

    add("render", "render the scene to an EXR file").add_argument("-o", "--out", required=True)
    add("write", "print the scene in POV-Ray's language")
    add("probe", "print the values of some pixels").add_argument("pixels", nargs="+", metavar="X,Y")
    return parser


def main(argv: Optional[List[str]] = None) -> int:
    """Exit codes as everywhere in Whitstone: 0 success, 2 invalid scene or request, 3 this machine
    cannot run it.
    """
    arguments = _parser().parse_args(argv)
    if arguments.op == "serve":
        return run()
    request: dict = {"op": arguments.op}
    if arguments.op != "hello":
        try:
            with open(arguments.scene, encoding="utf-8") as file:
                request["scene"] = file.read()
        except OSError as error:
            print(f"{arguments.scene}: {error.strerror}", file=sys.stderr)
            return 2
        request["base"] = os.path.dirname(os.path.abspath(arguments.scene))
        request["setting"] = {key: getattr(arguments, key) for key in ("k", "dx", "dy", "exposure", "vertices", "seed")}
    if arguments.op == "render":
        request["out"] = arguments.out
    if arguments.op == "probe":
        request["pixels"] = [[int(number) for number in text.split(",")] for text in arguments.pixels]
        request["settings"] = [request["setting"]]
    reply = answer(request)
    if not reply["ok"]:
        print(f"{reply['kind']}: {reply['error']}", file=sys.stderr)
        return 3 if reply["kind"] == "internal" else 2
    if arguments.op == "write":
        print("\n".join(reply["scenes"]))
        return 0
    del reply["ok"]
    print(json.dumps(reply, indent=2))
    return 0
