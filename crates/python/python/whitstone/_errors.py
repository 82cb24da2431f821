"""Exceptions."""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Sequence, Tuple


class Problem(NamedTuple):
    """A fault of a scene at its place."""

    file: Optional[str]
    #: From 1.
    line: Optional[int]
    #: From 1, in characters.
    column: Optional[int]
    message: str
    help: Optional[str]


class SceneError(ValueError):
    """A scene cannot be built. The text shows all problems with their lines."""

    def __init__(
        self,
        report: str,
        problems: Sequence[Tuple[Optional[str], Optional[int], Optional[int], str, Optional[str]]] = (),
    ) -> None:
        super().__init__(report)
        #: All problems.
        self.problems: List[Problem] = [Problem(*problem) for problem in problems]
