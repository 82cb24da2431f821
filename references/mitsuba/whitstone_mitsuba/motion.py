"""Moving shapes and the shutter (model §3 and §9): the document at each time of the film, without
motion.

A moving shape gets the steps of its motion behind its own steps, with interpolated numbers. The
rest of the driver reads documents without motion.
"""

from __future__ import annotations

from typing import Any, List, Tuple

from .fields import REQUIRED, Fields, is_number

MOST_TIMES = 256


def times(film: Any, errors: List[str]) -> List[float]:
    """The times of the `[film]` table."""
    value = film.get("time", 0) if isinstance(film, dict) else 0
    if is_number(value):
        return [float(value)]
    if not isinstance(value, dict):
        errors.append(f"film.time: expected a finite number or a table of open, close and count, found {value!r}")
        return [0.0]
    fields = Fields(value, "film.time", errors)
    opened, closed = fields.number("open", REQUIRED), fields.number("close", REQUIRED)
    count = fields.integer("count", REQUIRED, 1, MOST_TIMES)
    fields.close()
    if closed < opened:
        fields.error("close", f"expected at least the value of open, {opened}, found {closed}")
    return [opened + (closed - opened) * (k + 0.5) / count for k in range(count)]


def still(root: Any, moment: int, errors: List[str]) -> Tuple[Any, int]:
    """The document at the time with this number, and the number of times."""
    found = times(root.get("film", {}), errors)
    if not any_moves(root):
        # The images of all times are the same.
        return root, 1
    changed = dict(root)
    if isinstance(root.get("shape"), list):
        changed["shape"] = [_stopped(shape, f"shape[{index}]", found[moment], errors) for index, shape in enumerate(root["shape"])]
    if isinstance(root.get("group"), dict):
        changed["group"] = {name: _group(group, f"group.{name}", found[moment], errors) for name, group in root["group"].items()}
    return changed, len(found)


def any_moves(root: Any) -> bool:
    """Whether any shape moves."""
    groups = root["group"].values() if isinstance(root.get("group"), dict) else []
    lists = [table.get("shape") for table in (root, *groups) if isinstance(table, dict)]
    return any(isinstance(shape, dict) and "motion" in shape for shapes in lists if isinstance(shapes, list) for shape in shapes)


def _group(group: Any, where: str, time: float, errors: List[str]) -> Any:
    if not isinstance(group, dict) or not isinstance(group.get("shape"), list):
        return group
    shapes = [_stopped(shape, f"{where}.shape[{index}]", time, errors) for index, shape in enumerate(group["shape"])]
    return {**group, "shape": shapes}


def _as_list(steps: Any) -> List[Any]:
    return list(steps) if isinstance(steps, list) else [steps]


def _stopped(shape: Any, where: str, time: float, errors: List[str]) -> Any:
    """The shape with its transform at a time, without motion."""
    if not isinstance(shape, dict) or "motion" not in shape:
        return shape
    rest = {key: value for key, value in shape.items() if key != "motion"}
    keyframes = _keyframes(shape["motion"], f"{where}.motion", errors)
    if keyframes:
        own = _as_list(shape["transform"]) if "transform" in shape else []
        rest["transform"] = own + _steps(keyframes, time)
    return rest


def _keyframes(value: Any, where: str, errors: List[str]) -> List[Tuple[float, List[Any]]]:
    """Times and steps; empty if they are not valid."""
    if not isinstance(value, list) or len(value) < 2:
        errors.append(f"{where}: expected a list of at least two keyframes, found {value!r}")
        return []
    before = len(errors)
    found: List[Tuple[float, List[Any]]] = []
    for index, table in enumerate(value):
        fields = Fields(table, f"{where}[{index}]", errors)
        time, steps = fields.number("time", REQUIRED), _as_list(fields.take("transform", REQUIRED))
        fields.close()
        if found and time <= found[-1][0]:
            fields.error("time", f"expected more than {found[-1][0]}, that of the keyframe before, found {time}")
        if found and [_kind(step) for step in steps] != [_kind(step) for step in found[-1][1]]:
            fields.error("transform", "expected the kinds of steps and axes of the keyframe before")
        found.append((time, steps))
    return found if len(errors) == before else []


def _kind(step: Any) -> Any:
    """What two keyframes must have in common."""
    if not isinstance(step, dict):
        return None
    turn = step.get("rotate")
    return sorted(step), turn.get("axis") if isinstance(turn, dict) else None


def _steps(keyframes: List[Tuple[float, List[Any]]], time: float) -> List[Any]:
    """The steps at a time."""
    if time <= keyframes[0][0]:
        return keyframes[0][1]
    for (start, first), (end, second) in zip(keyframes, keyframes[1:]):
        if start <= time < end:
            share = (time - start) / (end - start)
            return [_between(a, b, share) for a, b in zip(first, second)]
    return keyframes[-1][1]


def _between(first: Any, second: Any, share: float) -> Any:
    """Two values with interpolated numbers. Values that are not of one form are invalid: the reader
    of transforms reports the first.
    """
    if is_number(first) and is_number(second):
        return first + share * (second - first)
    if isinstance(first, dict) and isinstance(second, dict):
        return {key: _mixed(key, first[key], second.get(key), share) for key in first}
    if isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        return [_between(a, b, share) for a, b in zip(first, second)]
    return first


def _mixed(key: str, first: Any, second: Any, share: float) -> Any:
    if key == "scale":
        # One number is three equal factors.
        first, second = ([value] * 3 if is_number(value) else value for value in (first, second))
    return _between(first, second, share)
