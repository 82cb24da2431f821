"""The three ways in which a request can fail (PROTOCOL.md: `kind`)."""

from __future__ import annotations


class DriverError(Exception):
    """A failure with the `kind` that the protocol names."""

    kind = "internal"


class SceneError(DriverError):
    """The document is wrong: the text lists every problem found, one a line."""

    kind = "scene"


class Unsupported(DriverError):
    """The document may be right, but something in it has no Mitsuba twin here."""

    kind = "unsupported"


class EnvironmentFailure(DriverError):
    """This machine cannot run the driver; the text says what to do."""

    kind = "internal"
