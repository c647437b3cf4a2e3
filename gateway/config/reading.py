"""Reads a configuration file; reports all its mistakes at once, each with its line."""

from __future__ import annotations

import tomllib
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from gateway.config.cross_checks import Check, find_mistakes
from gateway.config.explain import explain
from gateway.config.mistakes import Mistake, spell
from gateway.config.schema import Config
from gateway.config.toml_lines import line_of, locate, syntax_problem
from gateway.errors import ConfigError, Problem


def load(path: str | Path, *, check: Check = lambda _: ()) -> Config:
    """Return the configuration in a file; ConfigError with every problem when it cannot be used.

    `check` looks for further mistakes. Where there are others, it must do so rule by rule, `WHERE_RIGHT`.
    """
    return parse(_read(path), str(path), check=check)


def parse(text: str, path: str, *, check: Check = lambda _: ()) -> Config:
    """Do as `load` with a TOML text; `path` is what messages call it."""
    document, wrong = _document(text, path), list[Mistake]()
    try:
        config = Config.model_validate(document)
    except ValidationError as error:
        config, wrong = _in_spite_of(error, document), explain(error)
    mistakes = find_mistakes(config, wrong, check)
    if mistakes:
        raise ConfigError(path, _problems(text, mistakes))
    return config


def _in_spite_of(error: ValidationError, document: dict[str, Any]) -> Config:
    """Return the configuration with None for each wrong or missing value, which is then to be taken out."""
    for *table, key in (detail["loc"] for detail in error.errors() if detail["type"] == "missing"):
        reduce(getitem, table, cast(Any, document))[key] = None
    return Config.model_validate(document, context=True, extra="ignore")


def _read(path: str | Path) -> str:
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        hint = "is the path right, and may this user read it?"
        raise _unusable(path, Problem("file", error.strerror or str(error), hint)) from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise _unusable(path, Problem("text", "is not UTF-8", "save the file as UTF-8", line)) from error


def _document(text: str, path: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise _unusable(path, Problem("syntax", "brackets are nested too deeply")) from error
    except ValueError as error:  # TOMLDecodeError, and numbers of absurd length
        raise _unusable(path, syntax_problem(error, text)) from error


def _unusable(path: str | Path, problem: Problem) -> ConfigError:
    return ConfigError(str(path), [problem])


def _problems(text: str, mistakes: list[Mistake]) -> list[Problem]:
    lines = locate(text)
    problems = [Problem(spell(m.key), m.what, m.hint, line_of(lines, m.key)) for m in mistakes]
    return sorted(problems, key=lambda problem: problem.line or 0)
