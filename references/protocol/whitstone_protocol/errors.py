"""The ways in which a request can fail (PROTOCOL.md: `kind`)."""

from __future__ import annotations


class DriverError(Exception):
    """A failure with the `kind` that the protocol names."""

    kind = "internal"


class SceneError(DriverError):
    """The document is invalid: the text lists every problem, one per line."""

    kind = "scene"


class Unsupported(DriverError):
    """The document may be valid, but the reference renderer cannot render something in it: one
    problem per line.
    """

    kind = "unsupported"


class EnvironmentFailure(DriverError):
    """This machine cannot run the driver; the text explains how to fix this."""

    kind = "internal"
