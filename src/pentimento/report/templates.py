"""Rendering of the HTML pages from the Jinja2 templates in ``templates/``.

A template that extends ``base.html`` is a whole page; ``macros.html`` holds the shared elements (table, row, bar).
"""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pentimento.report import wording


def render(template_name: str, **values: Any) -> Markup:
    """Return the HTML of a template, whose variables are `values`.

    Strings among the values are escaped; `markupsafe.Markup`, such as the result of `render`, is inserted as it is.
    The formatters of `pentimento.report.wording` are filters: ``{{ share | percent }}``.

    Raises:
        jinja2.TemplateNotFound: no such file in ``templates/``.
        jinja2.UndefinedError: the template uses a variable that `values` lacks.
    """
    return Markup(_environment().get_template(template_name).render(**values))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("pentimento.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    formatters = (
        wording.count,
        wording.decimal,
        wording.lowered,
        wording.percent,
        wording.signed_mm,
        wording.tool_name,
    )
    environment.filters |= {formatter.__name__: formatter for formatter in formatters} | {"base64": _base64}
    return environment


def _base64(data: bytes) -> str:
    return b64encode(data).decode("ascii")
