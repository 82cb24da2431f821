"""Constructive solid geometry (model §9, csg) by merging the sorted crossings of the operands along
a line.

A line starts outside of all operands. Each crossing enters or leaves one operand. If this changes
whether the line is inside the result, it is a crossing of the result.
"""

from __future__ import annotations

from typing import List, Sequence, Tuple

import numpy as np

from .surfaces import Crossings, Points, Start, Surface, Vector

# Crossings this close, relative to their distance, count as equal: no solid is thinner.
SAME = 1e-13

UNION, INTERSECTION, DIFFERENCE = "union", "intersection", "difference"


class Solid(Surface):
    """The result of one operation. The codes of its parts are those of the operands, one operand
    after the other.
    """

    def __init__(self, operation: str, operands: Sequence[Surface]) -> None:
        # The operands are in world space already.
        Surface.__init__(self, np.eye(4))
        self.operation, self.operands = operation, operands
        self.first = np.concatenate([[0], np.cumsum([operand.codes for operand in operands])])
        self.codes = int(self.first[-1])

    def bounds(self) -> Tuple[np.ndarray, float]:
        balls = [operand.bounds() for operand in self.operands]
        if self.operation == DIFFERENCE:
            return balls[0]
        if self.operation == INTERSECTION:
            return min(balls, key=lambda ball: ball[1])
        centre = np.mean([ball[0] for ball in balls], axis=0)
        return centre, float(max(np.linalg.norm(ball[0] - centre) + ball[1] for ball in balls))

    def turned(self, operand: int) -> bool:
        """Whether the inside of the operand is outside of the result."""
        return self.operation == DIFFERENCE and operand > 0

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        t, step, code, first = [], [], [], []
        for number, operand in enumerate(self.operands):
            base = self.first[number]
            here = (start.code >= base) & (start.code < self.first[number + 1])
            found = operand.crossings(o, d, Start(np.where(here, start.code - base, -1), start.outward ^ self.turned(number)))
            t.append(found.t)
            step.append(found.step)
            code.append(found.code + base)
            first.append(np.full(found.t.shape[1], number == 0))
        every_t, every_step, every_code = np.hstack(t), np.hstack(step), np.hstack(code)
        of_first = np.broadcast_to(np.concatenate(first), every_t.shape)
        order = np.argsort(every_t, axis=1, kind="stable")
        every_t, every_step, every_code, of_first = (
            np.take_along_axis(values, order, axis=1) for values in (every_t, every_step, every_code, of_first)
        )
        return self._merge(every_t, every_step, every_code, of_first)

    def _merge(self, t: np.ndarray, step: np.ndarray, code: np.ndarray, of_first: np.ndarray) -> Crossings:
        """Crossings of the result, from those of the operands in ascending order."""
        count, events = t.shape
        own = np.where(of_first, step, 0).cumsum(axis=1)
        others = np.where(of_first, 0, step).cumsum(axis=1)
        if self.operation == UNION:
            inside = own + others > 0
        elif self.operation == INTERSECTION:
            inside = own + others == len(self.operands)
        else:
            inside = (own > 0) & (others == 0)
        before = np.zeros(count, dtype=bool)
        name, at = np.full(count, self.codes), np.full(count, np.inf)
        result_t, result_step, result_code = np.full(t.shape, np.inf), np.zeros(t.shape, dtype=np.int64), np.zeros(t.shape, dtype=np.int64)
        for number in range(events):
            here = t[:, number]
            # Of several crossings at one point, the first operand determines the surface.
            there = here < np.inf
            better = there & (code[:, number] < name)
            name, at = np.where(better, code[:, number], name), np.where(better, here, at)
            if number + 1 < events:
                with np.errstate(invalid="ignore"):
                    end = ~(t[:, number + 1] - here <= SAME * np.abs(here)) | np.isinf(here)
            else:
                end = np.full(count, True)
            now = inside[:, number]
            crossed = end & there & (now != before)
            result_t[:, number] = np.where(crossed, at, np.inf)
            result_step[:, number] = np.where(crossed, np.where(now, 1, -1), 0)
            result_code[:, number] = np.where(crossed, name, 0)
            before = np.where(end, now, before)
            name, at = np.where(end, self.codes, name), np.where(end, np.inf, at)
        return _shortened(Crossings(result_t, result_step, result_code))

    def points(self, p: Vector, code: np.ndarray) -> Points:
        count = len(code)
        n_g, n_s = np.zeros((3, count)), np.zeros((3, count))
        u, v, primitive = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
        which = np.searchsorted(self.first, code, side="right") - 1
        for number, operand in enumerate(self.operands):
            lanes = np.flatnonzero(which == number)
            if len(lanes) == 0:
                continue
            found = operand.points(tuple(axis[lanes] for axis in p), code[lanes] - self.first[number])
            sign = -1.0 if self.turned(number) else 1.0
            n_g[:, lanes], n_s[:, lanes] = sign * np.array(found.n_g), sign * np.array(found.n_s)
            u[lanes], v[lanes] = found.u, found.v
            primitive[lanes] = found.primitive * len(self.operands) + number
        return Points(tuple(n_g), tuple(n_s), u, v, primitive)


def _shortened(crossings: Crossings) -> Crossings:
    """Drops the columns that no line uses; crossings come first."""
    order: np.ndarray = np.argsort(crossings.t, axis=1, kind="stable")
    # Crossings at -inf mark lines that come from inside.
    used = max(int((crossings.step != 0).sum(axis=1).max(initial=0)), 1)
    parts: List[np.ndarray] = [
        np.take_along_axis(values, order, axis=1)[:, :used] for values in (crossings.t, crossings.step, crossings.code)
    ]
    return Crossings(*parts)
