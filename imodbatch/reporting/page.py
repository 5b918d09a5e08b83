"""A page that stands alone: a template of `templates/`, filled in; everything in it is escaped."""

import json
from collections.abc import Mapping
from typing import Any

import jinja2


def page(template: str, context: Mapping[str, Any]) -> str:
    """Fill in a template.

    Args:
        template: its file name.
        context: what it speaks of; a name that is missing is an error.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("imodbatch.reporting"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["setting"] = _setting
    return environment.get_template(template).render(context)


def _setting(value: object) -> str:
    """A setting as its TOML file would have it, as near as JSON comes."""
    return json.dumps(value, ensure_ascii=False, default=str)
