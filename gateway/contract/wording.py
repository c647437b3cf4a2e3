"""Words by code: the tables of `texts`, whose templates are filled with named fields."""

from __future__ import annotations

import tomllib
from collections.abc import KeysView, Mapping
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict


def _by_case(texts: object) -> object:
    """Return templates by their case; one template alone has the case ""."""
    return {"": texts} if isinstance(texts, str) else texts


class Meaning(BaseModel):
    """The meaning of one code for people, and the texts that may be said with it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    group: str  # its title
    sentence: str
    remedy: str
    texts: Annotated[Mapping[str, str], BeforeValidator(_by_case)]  # templates


def table(name: str) -> dict[str, Any]:
    """Return a table of `texts`."""
    return tomllib.loads(files(__package__).joinpath("texts", f"{name}.toml").read_text("utf-8"))


@cache
def names_in(template: str) -> KeysView[str]:
    """Return the names of the fields that a template is filled with, in its order."""
    return dict.fromkeys(name for _, name, _, _ in Formatter().parse(template) if name).keys()
