"""Real roots of many polynomials at once in intervals, in float64.

The roots of the derivative split the interval into pieces in which the polynomial is monotonic. A
piece whose ends have different signs holds one root, which Newton's method finds inside its
bracket. So a root is found exactly if the polynomial changes its sign there. Each polynomial is
treated separately: its roots do not depend on the others in the arrays.
"""

from __future__ import annotations

from typing import List, Sequence, Tuple

import numpy as np

# Newton's method converges in fewer steps; the bracket is bisected if a step would leave it.
MOST_STEPS = 100


def value(coefficients: Sequence[np.ndarray], x: np.ndarray) -> np.ndarray:
    """The values at x; coefficients in ascending order."""
    found = coefficients[-1] + np.zeros_like(x)
    for coefficient in reversed(coefficients[:-1]):
        found = found * x + coefficient
    return found


def derivative(coefficients: Sequence[np.ndarray]) -> List[np.ndarray]:
    """Coefficients of the derivatives."""
    return [power * coefficient for power, coefficient in enumerate(coefficients)][1:]


def _bracketed(coefficients: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """The root in each [low, high], at whose ends the signs differ."""
    slope = derivative(coefficients)
    low, high = low.copy(), high.copy()
    # Points closer than the first bound differ by rounding; below the second one, steps that do not
    # shrink are rounding.
    far = np.maximum(np.abs(low), np.abs(high))
    close, near, last = 2e-16 * far, 1e-7 * far, high - low
    x = 0.5 * (low + high)
    active = np.arange(len(x))
    for _ in range(MOST_STEPS):
        if len(active) == 0:
            break
        some, at = [coefficient[active] for coefficient in coefficients], x[active]
        f = value(some, at)
        below = (f < 0) == rising[active]
        low[active], high[active] = np.where(below, at, low[active]), np.where(below, high[active], at)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = at - f / value([coefficient[active] for coefficient in slope], at)
        inside = (step >= low[active]) & (step <= high[active])
        following = np.where(inside, step, 0.5 * (low[active] + high[active]))
        moved = np.abs(following - at)
        done = (moved <= close[active]) | (f == 0) | (inside & (last[active] < near[active]) & (moved > 0.9 * last[active]))
        last[active] = moved
        x[active] = np.where(f == 0, at, following)
        active = active[~done]
    return x


def real_roots(
    coefficients: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """(roots, rising), both (n, degree): roots in ascending order, padded with infinity, and
    whether the value rises there.
    """
    degree = len(coefficients) - 1
    shape = (len(low), degree)
    roots, rising = np.full(shape, np.inf), np.zeros(shape, dtype=bool)
    ends = [low]
    if degree > 1:
        turns = real_roots(derivative(coefficients), low, high)[0]
        ends += [np.minimum(turns[:, number], high) for number in range(degree - 1)]
    ends.append(high)
    values = [value(coefficients, end) for end in ends]
    for number in range(degree):
        lanes = np.flatnonzero((values[number] < 0) != (values[number + 1] < 0))
        up = values[number][lanes] < 0
        some = [coefficient[lanes] for coefficient in coefficients]
        roots[lanes, number] = _bracketed(some, ends[number][lanes], ends[number + 1][lanes], up)
        rising[lanes, number] = up
    order = np.argsort(roots, axis=1, kind="stable")
    return np.take_along_axis(roots, order, axis=1), np.take_along_axis(rising, order, axis=1)
