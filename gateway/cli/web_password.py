"""Read a password, twice from a terminal or once from standard input, and print the line to paste below a
[[web.user]]. The password itself is stored nowhere.
"""

from __future__ import annotations

import argparse
import getpass
import sys

from gateway.errors import UsageError
from gateway.system.password_hash import password_line

SHORTEST = 8  # characters


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Add none."""


def run(_: argparse.Namespace) -> int:
    """Print the line; UsageError for a password that cannot be used."""
    password = _asked() if sys.stdin.isatty() else sys.stdin.readline().rstrip("\r\n")
    if len(password) < SHORTEST:
        raise UsageError(f"the password has {len(password)} characters, at least {SHORTEST} are needed")
    try:
        line = password_line(password)
    except ValueError as error:
        raise UsageError(str(error)) from error
    print(f'password = "{line}"')
    return 0


def _asked() -> str:
    password = getpass.getpass("Password: ")
    if getpass.getpass("Once more: ") != password:
        raise UsageError("the two passwords differ")
    return password
