"""The levels of topics, and the topics of commands; those of records are declared with the records."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from gateway.contract.records import Record

LEVEL = r"[a-z0-9_-]+"
_NOT_IN_LEVEL = re.compile(r"[^a-z0-9_-]")


class CommandAddress(NamedTuple):
    """The content of a command's topic; the broker's ACL vouches for `client`.

    Where the topic names no command, unknown levels are empty and `verb` is what it has there, cut short.
    """

    starter: str
    client: str
    verb: str
    problem: str = ""  # of such a topic: one of a few words
    text: str = ""  # what is wrong with it, and what would be right


def is_level(text: str) -> bool:
    """Return whether `text` may stand as one level of a topic."""
    return re.fullmatch(LEVEL, text) is not None


def to_level(name: str) -> str:
    """Return a manual's code as a level: lower case, anything that a level may not hold as `_`."""
    return _NOT_IN_LEVEL.sub("_", name.lower()) or "_"


class Topics:
    """The topics below one base; ValueError for a base or a command of other than levels.

    No topic that carries a payload is a prefix of another.
    """

    def __init__(self, base: str) -> None:
        self.base = "/".join(map(_checked, base.split("/")))
        self.command_filter = f"{base}/command/#"  # what is mistyped too: it is answered
        self._command_prefix = f"{base}/command/"

    def of(self, kind: type[Record], **names: str) -> str:
        """Return the topic of a record of this kind, of this starter, line, point, code or client."""
        return f"{self.base}/{kind.topic_of(**names)}"

    def command(self, starter: str, client: str, verb: str) -> str:
        """Return the topic on which `client` gives a starter a command."""
        return f"{self._command_prefix}{_checked(starter)}/{_checked(client)}/{_checked(verb)}"

    def parse_command(self, topic: str) -> CommandAddress | None:
        """Return what a command's topic says, or what is wrong with it; None for any other topic."""
        if not f"{topic}/".startswith(self._command_prefix):
            return None
        whole = topic[len(self._command_prefix) :]
        levels = whole.split("/")
        if len(levels) == 3 and all(is_level(level) for level in levels):
            return CommandAddress(*levels)
        starter, client = levels[0].lower(), levels[1] if len(levels) >= 3 else ""
        if not (is_level(starter) and is_level(client)):
            starter = client = ""
        verb = shortened("/".join(levels[2:]) if client else whole)
        return CommandAddress(starter, client, verb, *_problem_of(levels))


def shortened(text: str, most: int = 40) -> str:
    """Return foreign text fit to be shown: printable, and not long."""
    printable = "".join(sign if sign.isprintable() else "?" for sign in text[: most + 1])
    return printable if len(printable) <= most else f"{printable[: most - 1]}…"


def _problem_of(levels: list[str]) -> tuple[str, str]:
    """Return in a word and in a sentence what is wrong with the levels behind `command`."""
    form = "a command's topic is command/STARTER/CLIENT/VERB, in lower case"
    if len(levels) < 3:
        return "level_missing", f"{len(levels)} of 3 levels are there; {form}"
    if "" in levels:
        return "level_empty", f"level {levels.index('') + 1} after command is empty; {form}"
    if len(levels) > 3:
        return "level_too_many", f"there are {len(levels)} levels after command instead of 3; {form}"
    wrong = next(level for level in levels if not is_level(level))
    return "level_misspelt", f"{shortened(wrong)!r} has other characters than a-z, 0-9, _ and -; {form}"


def _checked(level: str) -> str:
    if not is_level(level):
        raise ValueError(f"{level!r} is no topic level: only a-z, 0-9, _ and - are")
    return level
