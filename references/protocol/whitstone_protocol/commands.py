"""The operations on the command line: `python -m DRIVER render SCENE.toml -o OUT.exr` and so on."""

from __future__ import annotations

import argparse
import json
import os
import sys
from typing import Any, Callable, Dict, List, Optional

from . import serve
from .requests import Answer, Request

Arguments = argparse.Namespace


class Parser:
    """Parses the command line of a driver. The driver adds the options of its setting."""

    def __init__(self, program: str, description: str) -> None:
        self._parser = argparse.ArgumentParser(prog=program, description=description)
        self._commands = self._parser.add_subparsers(dest="op", required=True)
        self.serve = self._commands.add_parser("serve", help="answer JSON requests from standard input, one per line")
        self._commands.add_parser("hello", help="print versions and a description of the machine")

    def add(self, name: str, text: str) -> argparse.ArgumentParser:
        """Adds an operation on a scene."""
        command = self._commands.add_parser(name, help=text, description=text)
        command.add_argument("scene", help="a flattened scene document (TOML)")
        return command

    def parse(self, argv: Optional[List[str]]) -> Arguments:
        """Exits with code 2 if the arguments are wrong."""
        return self._parser.parse_args(argv)


def pixel(text: str) -> List[int]:
    """A pixel as X,Y."""
    try:
        x, y = (int(part) for part in text.split(","))
    except ValueError:
        raise SystemExit(f"expected a pixel as X,Y, found {text!r}") from None
    return [x, y]


def as_json(arguments: Arguments, reply: Answer) -> str:
    """The reply without its key `ok`."""
    return json.dumps({key: value for key, value in reply.items() if key != "ok"}, indent=2)


def main(
    arguments: Arguments,
    load: Callable[[], serve.Answerer],
    complete: Callable[[Arguments], Dict[str, Any]],
    show: Callable[[Arguments, Answer], str] = as_json,
) -> int:
    """Runs a command by the function that `load` returns. `complete` returns the keys of the
    request other than `op`, `scene` and `base`; `show` converts the reply to a text.

    Exit codes as everywhere in Whitstone: 0 success, 2 invalid scene or request, 3 this machine
    cannot run the driver.
    """
    if arguments.op == "serve":
        return serve.run(load)
    request: Request = {"op": arguments.op}
    if arguments.op != "hello":
        try:
            with open(arguments.scene, encoding="utf-8") as file:
                request["scene"] = file.read()
        except OSError as error:
            print(f"{arguments.scene}: {error.strerror}", file=sys.stderr)
            return 2
        request["base"] = os.path.dirname(os.path.abspath(arguments.scene))
        request.update(complete(arguments))
    try:
        answer = load()
    except Exception as error:
        print(error, file=sys.stderr)
        return 3
    reply = answer(request)
    if not reply["ok"]:
        print(f"{reply['kind']}: {reply['error']}", file=sys.stderr)
        return 3 if reply["kind"] == "internal" else 2
    print(show(arguments, reply))
    return 0
