"""Decode words read from a starter, to JSON."""

from __future__ import annotations

import argparse
import json

from gateway.cli.command import whole_number
from gateway.contract import CommandError
from gateway.errors import UsageError
from gateway.families import (
    ENGLISH,
    FAMILIES,
    LANGUAGES,
    Profile,
    Table,
    Variant,
    decode,
    load_profile,
    parameters,
)

TABLES = ("holding", "input", "coil")  # that have rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("family", metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("table", metavar="TABLE", choices=TABLES, help="holding, input or coil")
    parser.add_argument(
        "start",
        metavar="START",
        help="address of the first word on the wire, zero-based, or its code: P003, S1.1.4, R13, COIL5",
    )
    parser.add_argument("words", metavar="WORD", nargs="+", help="decimal or 0x..; 0 or 1 for coils")
    parser.add_argument("--model", help='e.g. "SSW-06 820A": some values depend on the rated current')
    parser.add_argument("--firmware", help="e.g. 1.42: some bits exist only from a certain version on")
    parser.add_argument("--language", default=ENGLISH, help=f"of the names: {', '.join(LANGUAGES)}")


def run(args: argparse.Namespace) -> int:
    """Print what the words mean; no port is opened."""
    profile = load_profile(args.family, args.language)
    table = Table(args.table)
    start = _start(profile, table, args.start)
    highest = 1 if table.is_bits else 0xFFFF
    words = [whole_number(word, "WORD", low=0, high=highest) for word in args.words]
    if start + len(words) > 0x10000:
        raise UsageError(f"{len(words)} words do not fit behind START {start} (the last address is 65535)")
    variant = Variant(model=args.model, firmware=args.firmware)
    found = decode.decode_words(profile, variant, table, start, words)
    print(json.dumps(found, indent=2, ensure_ascii=False))
    return 0


def _start(profile: Profile, table: Table, text: str) -> int:
    """Return the address on the wire that a number or a code names; UsageError for what is neither."""
    if text[:1].isdigit() or not any(each.isdigit() for each in text):
        return whole_number(text, "START", low=0, high=0xFFFF)
    try:
        row = parameters.find(profile, text)
    except CommandError as error:
        raise UsageError(f"{profile.title} has no {text!r} (an address, or a code of its manual)") from error
    if row.table is not table:
        raise UsageError(f"{row.code} is in the table {row.table}, not {table}")
    return row.address
