"""The Jinja templates and the style of HTML pages; templates escape all text."""

from __future__ import annotations

from importlib import resources
from typing import Any


def template(name: str) -> Any:
    """A template of ``assets/``, which may import others from there."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(_asset),
    )
    return environment.get_template(name)


def style() -> str:
    """The style sheet of all pages."""
    return _asset("report.css").strip()


def _asset(name: str) -> str:
    return (resources.files("cdrj_ros.report") / "assets" / name).read_text(encoding="utf-8")
