"""Serve mode: reads and writes JSON lines (PROTOCOL.md)."""

from __future__ import annotations

import json
import os
import sys
from typing import Any, Callable

from .errors import DriverError
from .requests import Answer

Answerer = Callable[[Any], Answer]


def _loaded(load: Callable[[], Answerer]) -> Answerer:
    """The result of `load`; or, if the renderer cannot run, a function that answers every request
    with the reason.
    """
    try:
        return load()
    except (DriverError, ImportError) as error:
        text = str(error)
        return lambda request: {"ok": False, "kind": "internal", "error": text}


def run(load: Callable[[], Answerer]) -> int:
    """Answers requests until the end of input, by the function that `load` returns."""
    # Libraries print to file descriptor 1, which is reserved for answers. So duplicate it for our
    # own use, and redirect it to 2.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)
    answer = _loaded(load)
    for line in sys.stdin:
        if not line.strip():
            continue
        try:
            request = json.loads(line)
        except ValueError as error:
            reply = {"ok": False, "kind": "internal", "error": f"the request is not JSON: {error}"}
        else:
            reply = answer(request)
        out.write(json.dumps(reply, allow_nan=False) + "\n")
        out.flush()
    return 0
