"""Path classes (model §11): path expressions, and the radiance by class.

Expressions are matched by their derivatives (Brzozowski 1964). A state of a class is the expression
that the rest of a path must match. The state of a ray is the states of all classes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Dict, List, Sequence, Tuple

import numpy as np

if TYPE_CHECKING:
    from .driver import Tracer

EVENTS = "ESGTDLAOB"
ENDS = ("DL", "DA", "O", "B")

# An upper bound on the states of all classes, for expressions that remember many events.
MOST_STATES = 4096
MOST_COPIES = 100

# Lanes that are traced together.
LANES = 1 << 16

# Expressions are tuples: ("none",), ("empty",), ("one", events), ("sequence", a, b), ("many", a),
# ("either", frozenset of expressions).
Expression = Tuple[Any, ...]
NONE: Expression = ("none",)
EMPTY: Expression = ("empty",)


class ParseError(Exception):
    """A path expression that cannot be read."""


def _either(options: Sequence[Expression]) -> Expression:
    flat: set = set()
    for option in options:
        flat |= option[1] if option[0] == "either" else {option}
    flat.discard(NONE)
    if len(flat) < 2:
        return flat.pop() if flat else NONE
    return ("either", frozenset(flat))


def _sequence(first: Expression, second: Expression) -> Expression:
    if NONE in (first, second):
        return NONE
    if first == EMPTY:
        return second
    if second == EMPTY:
        return first
    if first[0] == "sequence":
        return ("sequence", first[1], _sequence(first[2], second))
    return ("sequence", first, second)


def _many(inner: Expression) -> Expression:
    return inner if inner[0] == "many" else EMPTY if inner in (NONE, EMPTY) else ("many", inner)


def nullable(expression: Expression) -> bool:
    """Whether the expression matches nothing at all: whether a path may end here."""
    kind = expression[0]
    if kind == "sequence":
        return nullable(expression[1]) and nullable(expression[2])
    if kind == "either":
        return any(nullable(option) for option in expression[1])
    return kind in ("empty", "many")


def after(expression: Expression, event: str) -> Expression:
    """What the rest of a path must match after this event."""
    kind = expression[0]
    if kind == "one":
        return EMPTY if event in expression[1] else NONE
    if kind == "many":
        return _sequence(after(expression[1], event), expression)
    if kind == "either":
        return _either([after(option, event) for option in expression[1]])
    if kind == "sequence":
        rest = _sequence(after(expression[1], event), expression[2])
        return _either([rest, after(expression[2], event)]) if nullable(expression[1]) else rest
    return NONE


class _Parser:
    def __init__(self, text: str) -> None:
        self.text = "".join(text.split())
        self.at = 0

    def peek(self) -> str:
        return self.text[self.at : self.at + 1]

    def take(self, expected: str) -> bool:
        found = self.peek() == expected
        self.at += found
        return found

    def fail(self, expected: str) -> ParseError:
        return ParseError(f"expected {expected}, found {self.peek() or 'the end'!r} at character {self.at} of {self.text!r}")

    def options(self) -> Expression:
        found = [self.terms()]
        while self.take("|"):
            found.append(self.terms())
        return _either(found)

    def terms(self) -> Expression:
        found = EMPTY
        while self.peek() not in ("", "|", ")"):
            found = _sequence(found, self.repeated())
        return found

    def repeated(self) -> Expression:
        term = self.term()
        while self.peek() and self.peek() in "*+?{":
            operator = self.text[self.at]
            self.at += 1
            if operator == "{":
                term = self.counted(term)
            elif operator == "?":
                term = _either([EMPTY, term])
            else:
                many = _many(term)
                term = many if operator == "*" else _sequence(term, many)
        return term

    def counted(self, term: Expression) -> Expression:
        least = self.number()
        most = least
        endless = False
        if self.take(","):
            endless = self.peek() == "}"
            most = least if endless else self.number()
        if not self.take("}"):
            raise self.fail("}")
        if most < least or most > MOST_COPIES:
            raise ParseError(f"expected counts in order, at most {MOST_COPIES}, found {{{least},{most}}}")
        found = _many(term) if endless else EMPTY
        for _ in range(most - least):
            found = _either([EMPTY, _sequence(term, found)])
        for _ in range(least):
            found = _sequence(term, found)
        return found

    def number(self) -> int:
        first = self.at
        while self.peek().isdigit():
            self.at += 1
        if first == self.at:
            raise self.fail("a number")
        return int(self.text[first : self.at])

    def term(self) -> Expression:
        if self.take("("):
            found = self.options()
            if not self.take(")"):
                raise self.fail(")")
            return found
        if self.take("["):
            other = self.take("^")
            events = set()
            while self.peek() and self.peek() in EVENTS:
                events.add(self.text[self.at])
                self.at += 1
            if not events or not self.take("]"):
                raise self.fail("events and ]")
            return ("one", frozenset(set(EVENTS) - events if other else events))
        if self.take("."):
            return ("one", frozenset(EVENTS))
        if self.peek() and self.peek() in EVENTS:
            self.at += 1
            return ("one", frozenset(self.text[self.at - 1]))
        raise self.fail(f"one of {EVENTS}")


def parse(text: str) -> Expression:
    """Reads an expression."""
    parser = _Parser(text)
    found = parser.options()
    if parser.peek():
        raise parser.fail("an event")
    return found


@dataclass
class Classes:
    """The classes of a film, and the states found so far; state 0 is that of camera rays."""

    names: Tuple[str, ...]
    expressions: Tuple[Expression, ...]
    states: List[Tuple[Expression, ...]] = field(default_factory=list)
    numbers: Dict[Tuple[Expression, ...], int] = field(default_factory=dict)
    steps: Dict[Tuple[int, str], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._number(tuple(after(expression, "E") for expression in self.expressions))

    def _number(self, state: Tuple[Expression, ...]) -> int:
        if state not in self.numbers:
            if len(self.states) >= MOST_STATES:
                raise ParseError(f"the path classes have more than {MOST_STATES} states")
            self.numbers[state] = len(self.states)
            self.states.append(state)
        return self.numbers[state]

    def after(self, states: np.ndarray, event: str) -> np.ndarray:
        """The states of rays after a branch."""
        present, place = np.unique(states, return_inverse=True)
        for number in present:
            if (number, event) not in self.steps:
                rest = tuple(after(expression, event) for expression in self.states[number])
                self.steps[number, event] = self._number(rest)
        found = np.array([self.steps[number, event] for number in present], dtype=np.int64)
        return found[place]

    def ends(self, states: np.ndarray, end: str) -> np.ndarray:
        """(classes, n): whether paths of these states that end so are in each class."""
        present, place = np.unique(states, return_inverse=True)
        found = np.zeros((len(self.names), len(present)), dtype=bool)
        for column, number in enumerate(present):
            for row, expression in enumerate(self.states[number]):
                for event in end:
                    expression = after(expression, event)
                found[row, column] = nullable(expression)
        return found[:, place]


def read(table: Any, errors: List[str]) -> Tuple[Tuple[str, str], ...]:
    """The names and expressions of `film.paths`."""
    if not isinstance(table, dict) or any(not isinstance(text, str) for text in table.values()):
        errors.append(f"film.paths: expected a table of path expressions, found {table!r}")
        return ()
    for name, text in table.items():
        try:
            parse(text)
        except ParseError as error:
            errors.append(f"film.paths.{name}: {error}")
    return tuple(table.items())


def classes(paths: Sequence[Tuple[str, str]]) -> Classes:
    """The classes of a document."""
    return Classes(tuple(name for name, _ in paths), tuple(parse(text) for _, text in paths))




def render(tracer: "Tracer", x: np.ndarray, y: np.ndarray) -> Dict[str, np.ndarray]:
    """EXR channels, each (n,) float32, of the path classes of the film."""
    wanted = classes(tracer.document.paths)
    samples = tracer.document.samples
    lens = max(samples.lens, 1)
    taken = np.full(len(x), len(samples)) if tracer.taken is None else tracer.taken * lens
    values = np.zeros((len(wanted.names), len(x), 3), dtype=np.float32)
    for count in np.unique(taken):
        pixels = np.flatnonzero(taken == count)
        step = max(1, LANES // (int(count) * tracer.spread))
        for first in range(0, len(pixels), step):
            some = pixels[first : first + step]
            chosen = samples if tracer.taken is None else samples.between(0, int(count))
            values[:, some] = tracer.split(x[some], y[some], chosen, wanted)
    return {
        f"path.{name}.{letter}": values[number, :, channel]
        for number, name in enumerate(wanted.names)
        for channel, letter in enumerate("RGB")
    }
