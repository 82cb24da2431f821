"""The operations on the command line: `python -m whitstone_povray render SCENE.toml -o OUT.exr` and
so on.
"""

from __future__ import annotations

import argparse
from typing import List, Optional

from whitstone_protocol import commands
from whitstone_protocol.requests import Answer

from .operations import answer


def _parser() -> commands.Parser:
    parser = commands.Parser("whitstone_povray", "POV-Ray as a deterministic Whitted tracer.")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        command = parser.add(name, text)
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


def _complete(arguments: commands.Arguments) -> dict:
    """The driver's own keys of the request for a command line."""
    setting = {key: getattr(arguments, key) for key in ("k", "dx", "dy", "exposure", "vertices", "seed")}
    request: dict = {"setting": setting}
    if arguments.op == "render":
        request["out"] = arguments.out
    if arguments.op == "probe":
        request["pixels"], request["settings"] = [commands.pixel(text) for text in arguments.pixels], [setting]
    return request


def _show(arguments: commands.Arguments, reply: Answer) -> str:
    return "\n".join(reply["scenes"]) if arguments.op == "write" else commands.as_json(arguments, reply)


def main(argv: Optional[List[str]] = None) -> int:
    """Returns the exit code: see `commands.main`."""
    return commands.main(_parser().parse(argv), lambda: answer, _complete, _show)
