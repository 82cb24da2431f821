"""Serve mode: reads and writes JSON lines (PROTOCOL.md)."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from typing import Any, Callable

from .errors import DriverError
from .requests import Answer

Answerer = Callable[[Any], Answer]

# Seconds between two looks at the parent process.
INTERVAL = 0.2


def _loaded(load: Callable[[], Answerer]) -> Answerer:
    """The result of `load`; or, if the renderer cannot run, a function that answers every request
    with the reason.
    """
    try:
        return load()
    except (DriverError, ImportError) as error:
        text = str(error)
        return lambda request: {"ok": False, "kind": "internal", "error": text}


def end_with_the_parent() -> None:
    """Ends this process and its children soon after its parent process has ended, which cannot tell
    if it was killed. Only POSIX systems change the parent's number then.
    """
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(INTERVAL)
        if os.getpgrp() == os.getpid():
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    if os.name == "posix":
        threading.Thread(target=watch, daemon=True).start()


def run(load: Callable[[], Answerer]) -> int:
    """Answers requests until the end of input, by the function that `load` returns."""
    # Libraries print to file descriptor 1, which is reserved for answers. So duplicate it for our
    # own use, and redirect it to 2.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)
    end_with_the_parent()
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
