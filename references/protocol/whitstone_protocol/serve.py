"""Serve mode: reads and writes JSON lines (PROTOCOL.md)."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
import time
from typing import Any, Callable, NoReturn

from .errors import DriverError
from .requests import Answer

Answerer = Callable[[Any], Answer]

# Seconds between two looks at the parent process.
INTERVAL = 0.2

# The environment variable with the file descriptor of a pipe. Only the parent process has the other
# end, and nobody writes to it.
PARENT = "WHITSTONE_PARENT"


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
    """Ends this process soon after its parent process has ended, which cannot tell if it was
    killed. If this process leads a process group, as drivers do, the group ends with it.
    """
    pipe = os.environ.pop(PARENT, None)
    if pipe is None or not _signalled(int(pipe)):
        _watched()


def _signalled(pipe: int) -> bool:
    """Lets the kernel send SIGKILL when the other end of the pipe closes; returns whether it can.
    No thread of Python could do that while a library that is being loaded holds the lock of the
    interpreter.
    """
    if sys.platform != "linux":
        return False
    import fcntl

    leads = os.getpgrp() == os.getpid()
    try:
        # A process group has a negative number.
        fcntl.fcntl(pipe, fcntl.F_SETOWN, -os.getpid() if leads else os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    except OSError:
        return False
    poll = select.poll()
    poll.register(pipe, 0)
    if poll.poll(0):
        # It closed before this process started.
        _end()
    return True


def _watched() -> None:
    """Looks for the parent in a thread. Only POSIX systems change the parent's number then."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(INTERVAL)
        _end()

    if os.name == "posix":
        threading.Thread(target=watch, daemon=True).start()


def _end() -> NoReturn:
    """Ends this process and, if it leads a process group, the group."""
    if os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


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
