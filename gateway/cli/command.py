"""The interface that every command's module has."""

from __future__ import annotations

import argparse
from typing import Protocol


class Subparsers(Protocol):
    """Where a command adds its own parser: what argparse's `add_subparsers` returns."""

    def add_parser(self, name: str, *, help: str = ..., description: str = ...) -> argparse.ArgumentParser:  # noqa: A002 - argparse's word
        """Return a new parser."""
        ...


class CommandModule(Protocol):
    """A module of this package that is a command."""

    def add_parser(self, subparsers: Subparsers) -> None:
        """Add the command's parser; its name is the module's."""
        ...

    def run(self, args: argparse.Namespace) -> int:
        """Carry the command out and return the exit code."""
        ...
