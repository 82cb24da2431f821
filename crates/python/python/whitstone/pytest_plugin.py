"""Options of pytest for :mod:`whitstone.testing`."""

from __future__ import annotations

import html
from typing import Any

import pytest


def pytest_addoption(parser: "pytest.Parser") -> None:
    group = parser.getgroup("whitstone", "comparison of images")
    group.addoption("--whitstone-accept", action="store_true", help="write the reference images, and compare nothing")
    group.addoption("--whitstone-report", metavar="FILE", help="write a page with the images that differ")


def pytest_configure(config: "pytest.Config") -> None:
    if config.getoption("--whitstone-accept"):
        from . import testing

        testing.accept = True


def pytest_sessionfinish(session: "pytest.Session", exitstatus: Any) -> None:
    path = session.config.getoption("--whitstone-report")
    if not path:
        return
    from . import testing

    parts = [f"<h2>{html.escape(name)}</h2>{comparison.html()}" for name, comparison in testing.failures]
    body = "\n".join(parts) or "<p>No image differs.</p>"
    with open(path, "w", encoding="utf-8") as file:
        file.write(f'<!doctype html><meta charset="utf-8"><title>Images that differ</title><h1>Images that differ</h1>{body}\n')
