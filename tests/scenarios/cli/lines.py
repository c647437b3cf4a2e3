"""Rows of the command line: a line of words, its exit code, and what it says.

A row without a plant gets a folder: `CONFIG` is a file there with the row's TOML, `DIR` the folder.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.rig import Ran, RigPlant, run_cli
from tests.rig.plant import GATEWAY, MQTT
from tests.rig.rows import Action, Expectation, row

Texts = str | re.Pattern[str] | tuple[str | re.Pattern[str], ...]


@dataclass(frozen=True)
class Says:
    """The exit code, texts of each stream (an empty one: nothing is said), and fields of the printed JSON."""

    words: str
    code: int | None = 0  # None: it hangs on this machine
    out: Texts = ()
    err: Texts = ()
    json: Mapping[str, Any] = field(default_factory=dict)  # by path: `lines/0/load`; `...` is anything

    def wrong(self, ran: Ran) -> str:
        """Return what a run said otherwise; whatever ends with 2 or 78 does so in lines of one form."""
        found = [f"exit code {ran.code}"] if self.code not in (None, ran.code) else []
        found += [f"not in out: {each!r}" for each in _each(self.out) if not _is_in(each, ran.out)]
        found += [f"not in err: {each!r}" for each in _each(self.err) if not _is_in(each, ran.err)]
        if ran.code in (2, 78) and not re.fullmatch(r"(starter-gateway: [^\n]+\n)+", ran.err):
            found.append("an error is more than a line")
        for path, value in self.json.items():
            node = json.loads(ran.out)
            for step in path.split("/"):
                node = node[int(step)] if isinstance(node, list) else node[step]
            if value is not ... and (node != value or isinstance(node, bool) != isinstance(value, bool)):
                found.append(f"{path} is {node!r}")
        return f"{self.words}: {'; '.join(found)}\n{ran.out}{ran.err}" if found else ""


def _each(texts: Texts) -> tuple[str | re.Pattern[str], ...]:
    return texts if isinstance(texts, tuple) else (texts,)


def _is_in(text: str | re.Pattern[str], said: str) -> bool:
    if isinstance(text, re.Pattern):
        return text.search(said) is not None
    return text in said if text else not said


def cli(words: str, **said: Any) -> Expectation:
    """Run a line beside the plant, for `then`; `CONFIG` is its file, `DIR` its folder."""
    expected = Says(words, **said)

    def check(plant: RigPlant) -> str:
        with chdir(plant.folder):
            return expected.wrong(run_cli(*_split(words, plant.path)))

    return check


def file_has(name: str, *texts: str, but: tuple[str, ...] = ()) -> Expectation:
    """Return the expectation that a file in the folder is there with these texts, and without those."""

    def check(plant: RigPlant) -> str:
        said = (plant.folder / name).read_text()
        found = [text for text in texts if text not in said] + [text for text in but if text in said]
        return f"{name}: {found}\n{said[:2000]}" if found else ""

    return check


def beside(name: str, given: str, *said: Expectation, at_s: float = 3.0, **options: Any) -> Any:
    """Return a row of a plant that runs, in which nothing else happens than what these lines do."""
    return row(name, given=given, then={at_s: said}, **options)


def ended(
    name: str, given: str, *said: Expectation, then: Sequence[Action] = (), end_s: float = 3.0, **options: Any
) -> Any:
    """Return a row of a plant whose gateway has ended: `then` is done, and after it what these lines do."""
    return row(name, given=given, at={end_s: ["end", *then]}, then={end_s: said}, **options)


@dataclass(frozen=True)
class LineRow:
    """A line of words without a plant."""

    says: Says
    given: str
    files: Mapping[str, str]


def line_row(
    name: str, words: str, *, given: str = "", files: Mapping[str, str] | None = None, **said: Any
) -> Any:
    """Return a row for `pytest.mark.parametrize("row", ...)`; its name is a sentence."""
    return pytest.param(LineRow(Says(words, **said), given, files or {}), id=name)


def play_line(row: LineRow, folder: Path) -> None:
    """Run a row's line in the folder; files that it brings are for their owner only."""
    head = "".join(part for part in (GATEWAY, MQTT) if part.split("\n")[0] not in row.given.splitlines())
    for name, content in {"site.toml": head + row.given, **row.files}.items():
        (folder / name).touch(mode=0o600)
        (folder / name).write_text(content)
    with chdir(folder):
        wrong = row.says.wrong(run_cli(*_split(row.says.words, folder / "site.toml")))
    assert not wrong, wrong


def _split(words: str, config: Path) -> list[str]:
    return shlex.split(words.replace("DIR", str(config.parent)).replace("CONFIG", str(config)))
