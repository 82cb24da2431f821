"""Serve mode: reads and writes JSON lines (PROTOCOL.md)."""

from __future__ import annotations

import json
import os
import sys
from typing import Any, Callable, Sequence

from .errors import DriverError


def _answerer(twins: Sequence[str]) -> Callable[[Any], dict]:
    """`operations.answer`; or, if Mitsuba or a twin cannot run, a function that answers every
    request with the reason.
    """
    try:
        from .operations import answer
        from .twins import load

        load(twins)
        return answer
    except (DriverError, ImportError) as error:
        text = str(error)
        return lambda request: {"ok": False, "kind": "internal", "error": text}


def run(twins: Sequence[str]) -> int:
    """Answers requests until the end of input. `twins`: files with twins of out-of-tree plugins."""
    # Libraries print to file descriptor 1, which is reserved for answers. So duplicate it for our
    # own use, and redirect it to 2.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)
    answer = _answerer(twins)
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
