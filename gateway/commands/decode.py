"""`starter-gateway decode`: what words mean that somebody has read from a starter."""

from __future__ import annotations

import argparse
import json

from gateway.commands.command import Subparsers
from gateway.commands.words import whole_number
from gateway.errors import UsageError
from gateway.families.decode import decode_words
from gateway.families.load import load_profile
from gateway.families.schema import Table, Variant


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser("decode", description="Decode words read from a starter, to JSON.")
    parser.add_argument("family", metavar="FAMILY", help="ssw06, ssw07, ssw900 or sst")
    parser.add_argument("table", metavar="TABLE", help="holding, input or coil")
    parser.add_argument("start", metavar="START", help="address of the first word on the wire, zero-based")
    parser.add_argument("words", metavar="WORD", nargs="+", help="decimal or 0x..; 0 or 1 for coils")
    parser.add_argument("--model", help='e.g. "SSW-06 820A": some values hang on the rated current')
    parser.add_argument("--firmware", help="e.g. 1.42: some bits exist from a version on")


def run(args: argparse.Namespace) -> int:
    """Print what the words mean; no port is opened."""
    profile = load_profile(args.family)
    try:
        table = Table(args.table)
    except ValueError:
        raise UsageError(f"no table {args.table!r} (holding, input or coil)") from None
    start = whole_number(args.start, "START", low=0, high=0xFFFF)
    highest = 1 if table is Table.COIL else 0xFFFF
    words = [whole_number(word, "WORD", low=0, high=highest) for word in args.words]
    if start + len(words) > 0x10000:
        raise UsageError(f"{len(words)} words do not fit behind START {start} (the last address is 65535)")
    variant = Variant(model=args.model, firmware=args.firmware)
    print(json.dumps(decode_words(profile, variant, table, start, words), indent=2, ensure_ascii=False))
    return 0
