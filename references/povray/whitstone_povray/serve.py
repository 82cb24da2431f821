"""Serve mode: reads and writes JSON lines (PROTOCOL.md)."""

from __future__ import annotations

import json
import sys

from .operations import answer


def run() -> int:
    """Answers requests until the end of input."""
    for line in sys.stdin:
        if not line.strip():
            continue
        try:
            request = json.loads(line)
        except ValueError as error:
            reply = {"ok": False, "kind": "internal", "error": f"the request is not JSON: {error}"}
        else:
            reply = answer(request)
        sys.stdout.write(json.dumps(reply, allow_nan=False) + "\n")
        sys.stdout.flush()
    return 0
