"""Makes docs/reference/commands.md from the commands' own parsers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from gateway.cli import main
from gateway.cli.main import COMMANDS
from tests.reference.markdown import table

HEAD = """\
# Command line

<!-- Made by `make docs` from the parsers in gateway/cli; edit the help texts there. -->

`starter-gateway COMMAND ..`, or `python -m gateway COMMAND ..`.
Exit codes: 0 done, 1 failed, 2 usage, 75 not now (`check --upgrade` only), 78 bad configuration, or a state
of a later version.
An error is one line on stderr: what, where, and how to fix it.
"""


def parsers() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command, those of its sub-commands behind it."""
    found: dict[str, argparse.ArgumentParser] = {}
    for name in COMMANDS:
        found.update(_all(name, _choices(main._parser(name))[name]))
    return found


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD, *(_section(name, parser) for name, parser in parsers().items())])


def unexplained() -> list[str]:
    """Return the commands without a description, and their arguments without a help text."""
    missing = [name for name, parser in parsers().items() if not parser.description]
    return missing + [
        f"{name} {_name(action)}"
        for name, parser in parsers().items()
        for action in _arguments(parser)
        if not action.help
    ]


def _all(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield name, parser
    for inner, each in _choices(parser).items():
        yield from _all(f"{name} {inner}", each)


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    left_out = (argparse._HelpAction, argparse._SubParsersAction)
    return [
        action
        for action in parser._actions
        if not isinstance(action, left_out) and action.help != argparse.SUPPRESS
    ]


def _section(name: str, parser: argparse.ArgumentParser) -> str:
    usage = " ".join(_usage(parser).split())
    title = f"{'##' if ' ' not in name else '###'} {name}\n\n{parser.description}\n\n```\n{usage}\n```"
    rows = [(f"`{_name(action)}`", _help(action, parser)) for action in _arguments(parser)]
    return table(title, ("argument", "what"), rows) if rows else f"{title}\n"


def _usage(parser: argparse.ArgumentParser) -> str:
    """Return the usage as the program prints it, however wide the terminal is."""
    formatter = argparse.HelpFormatter(parser.prog, width=1000)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups, prefix="")
    return formatter.format_help()


def _name(action: argparse.Action) -> str:
    value = action.metavar or action.dest.upper()
    value = " ".join(value) if isinstance(value, tuple) else value
    if not action.option_strings:
        return value
    words = ", ".join(action.option_strings)
    return words if action.nargs == 0 else f"{words} {value}"


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    formatter = argparse.HelpFormatter(parser.prog, width=1000)
    return formatter._expand_help(action) if action.help else ""
