"""The ways in which a request can fail (PROTOCOL.md: `kind`)."""

from __future__ import annotations


class DriverError(Exception):
    """A failure with the `kind` that the protocol names."""

    kind = "internal"


class SceneError(DriverError):
    """The document is wrong: the text lists every problem found, one a line."""

    kind = "scene"


class Unsupported(DriverError):
    """The document may be right, but POV-Ray cannot show something in it: one a line, each led by
    its place.
    """

    kind = "unsupported"


class NeedsChannels(Exception):
    """POV-Ray has a number where the model has a colour: the scene must be rendered once for red,
    green and blue each.
    """
