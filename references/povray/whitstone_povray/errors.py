"""The ways in which a request can fail (PROTOCOL.md: `kind`)."""

from __future__ import annotations


class DriverError(Exception):
    """A failure with the `kind` that the protocol names."""

    kind = "internal"


class SceneError(DriverError):
    """The document is invalid: the text lists every problem, one per line."""

    kind = "scene"


class Unsupported(DriverError):
    """The document may be valid, but POV-Ray cannot render something in it: one problem per line,
    each preceded by its position.
    """

    kind = "unsupported"


class NeedsChannels(Exception):
    """POV-Ray has a number where the model has a colour: red, green and blue must be rendered
    separately.
    """
