"""Requests and answers, both plain dictionaries, and the parts that all operations share."""

from __future__ import annotations

import math
import platform
import sys
from typing import Any, Callable, Dict, Mapping

from .errors import DriverError

Request = Dict[str, Any]
Answer = Dict[str, Any]
Operation = Callable[[Request], Answer]


def get(request: Request, key: str, kind: type, default: Any = None) -> Any:
    """A key of the request, with the required type; mandatory if there is no default."""
    value = request.get(key, default)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise DriverError(f"{key}: expected {kind.__name__}, found {value!r}")
    return value


def cpu() -> str:
    """The name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def plain(value: Any) -> Any:
    """Converts an answer for JSON: numpy numbers to Python's, non-finite numbers to strings."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    number = float(value)
    if math.isfinite(number):
        return number
    return "nan" if math.isnan(number) else ("inf" if number > 0 else "-inf")


def answer(program: str, operations: Mapping[str, Operation], request: Any) -> Answer:
    """Executes one request by the operation that it names; never raises. `program` is the name of
    the driver in messages.
    """
    try:
        if not isinstance(request, dict):
            raise DriverError(f"expected a JSON object, found {type(request).__name__}")
        operation = operations.get(request.get("op", ""))
        if operation is None:
            raise DriverError(f"unknown op {request.get('op')!r}; known: {', '.join(operations)}")
        return {"ok": True, **plain(operation(request))}
    except DriverError as error:
        return {"ok": False, "kind": error.kind, "error": str(error)}
    except Exception as error:  # the process must survive whatever the renderer raises
        print(f"{program}: {type(error).__name__}: {error}", file=sys.stderr)
        return {"ok": False, "kind": "internal", "error": f"{type(error).__name__}: {error}"}
