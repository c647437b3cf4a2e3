"""Shared by the commands: their interface, the words that people type, progress on stderr."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TextIO

from gateway.errors import StoreError, UsageError

if TYPE_CHECKING:  # not every command reads a configuration
    from gateway.config import Config, LineTable, StarterTable

STEP = 0.1  # of the whole, between two lines where there is no terminal
KEY_VALUE = "KEY=VALUE (e.g. parameter=P314 value=30)"

_CLEAR = "\r\x1b[K"
_CONSTANTS = {"true": True, "false": False}


class CommandModule(Protocol):
    """A module of this package that is a command; its docstring's first paragraph describes it to users."""

    def add_arguments(self, parser: argparse.ArgumentParser, /) -> None:
        """Give the command's parser its arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Carry the command out and return the exit code."""


def flag(parser: argparse._ActionsContainer, *names: str, about: str) -> None:
    """Add an option that is given or not."""
    parser.add_argument(*names, action="store_true", help=about)


def add_starter(
    parser: argparse.ArgumentParser, *, about: str = "name of the starter", nargs: str | None = None
) -> None:
    """Add CONFIG and STARTER, whose names a shell with argcomplete completes."""
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    starter = parser.add_argument("starter", metavar="STARTER", help=about, nargs=nargs)
    completed(starter, by=lambda config, _: targets(config))


def targets(config: Config) -> list[str]:
    """Return what a command may name: the starters, then the groups."""
    return [*(starter.name for starter in config.starters), *(group.name for group in config.groups)]


def completed(action: argparse.Action, *, by: Callable[[Config, argparse.Namespace], Iterable[str]]) -> None:
    """Have a shell with argcomplete complete an argument by the configuration that stands before it."""

    def completer(parsed_args: argparse.Namespace, **_: object) -> Iterable[str]:
        from gateway.config import load

        return by(load(parsed_args.config), parsed_args)

    action.completer = completer  # type: ignore[attr-defined] # argcomplete's


def whole_number(text: str, what: str, *, low: int, high: int) -> int:
    """Return a decimal or 0x.. number; UsageError when it is none, or outside low..high."""
    try:
        number = int(text, 0)
    except ValueError:
        raise UsageError(f"{what} {text!r} is no number (decimal, or 0x..)") from None
    if not low <= number <= high:
        raise UsageError(f"{what} {text} is out of range ({low}..{high})")
    return number


def assigned(
    items: Iterable[str], *, sign: str, form: str, texts: Sequence[str] = ()
) -> dict[str, bool | int | float | str]:
    """Return the values of KEY=VALUE, or with another sign, by key; UsageError for what is not of this form.

    Numbers, true and false are values as such; those of `texts` stay as they are.
    """
    found: dict[str, bool | int | float | str] = {}
    for item in items:
        key, _, value = item.partition(sign)
        if not key or not value:
            raise UsageError(f"argument {item!r} is not {form}")
        if key in found:
            raise UsageError(f"argument {key} is given twice (give it once)")
        found[key] = value if key in texts else _value(value)
    return found


def _value(text: str) -> bool | int | float | str:
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    with contextlib.suppress(ValueError):
        return int(text, 0)
    with contextlib.suppress(ValueError):
        number = float(text)
        if math.isfinite(number):
            return number
    return text


def place_of(config: Config, name: str) -> tuple[LineTable, StarterTable]:
    """Return a starter that people name, with its line; UsageError when there is none."""
    for line in config.lines:
        for starter in line.starters:
            if starter.name == name:
                return line, starter
    raise UsageError(f"no starter {name!r} ({choose(name, [each.name for each in config.starters])})")


def choose(word: str, known: Iterable[str]) -> str:
    """Return the hint for an unknown word: the nearest known one, or all of them."""
    from gateway.config import choose as nearest

    return nearest(word, known)


def write_text(path: Path, text: str) -> None:
    """Write a file that people have named, its line ends as they are in the text; StoreError."""
    try:
        path.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror} (choose another folder)") from error


def coded(code: str, text: str) -> str:
    """Return what a fault or an alarm is called, with its code once: E05 Motor overload."""
    return text if code in text.lower() else f"{code.upper()} {text}"


def counted(number: int, what: str) -> str:
    """Return a number of things: 1 line, 2 lines."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


class Progress:
    """Shows how far one piece of work has come, and how long the rest may take."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._is_terminal = self._stream.isatty()
        self._began_s = time.monotonic()
        self._next_share = 0.0

    def show(self, share: float, what: str) -> None:
        """Show that this share (0..1) is done, and what is being done."""
        left_s = (time.monotonic() - self._began_s) * (1.0 / share - 1.0) if 0.0 < share < 1.0 else 0.0
        text = f"{min(share, 1.0):4.0%} {what}" + (f", {in_words(left_s)} left" if left_s else "")
        if self._is_terminal:
            self._stream.write(_CLEAR + text)
        elif share >= self._next_share:
            self._next_share = (int(share / STEP) + 1) * STEP
            self._stream.write(text + "\n")
        self._stream.flush()

    def say(self, text: str) -> None:
        """Say something that stays."""
        self.clear()
        self._stream.write(text + "\n")
        self._stream.flush()

    def clear(self) -> None:
        """Take the changing line away."""
        if self._is_terminal:
            self._stream.write(_CLEAR)
            self._stream.flush()


def in_words(seconds: float) -> str:
    """Return a duration for people: 4.2 s, 38 s, 3 min 20 s, 1 h 5 min."""
    if seconds < 10:
        return f"{max(seconds, 0.0):.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
