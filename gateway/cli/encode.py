"""Print the request frames of a command: hex, CRC included, one a line."""

from __future__ import annotations

import argparse

from gateway.cli.command import KEY_VALUE, assigned, whole_number
from gateway.contract import CommandError
from gateway.errors import UsageError
from gateway.families import FAMILIES, Profile, Variant, command, load_profile
from gateway.modbus import encode

_WRONG_WORDS = ("unknown_verb", "bad_arguments", "unknown_parameter")
_HINTS = {"slot_unknown": "give --slot 1 or --slot 2", "word_unknown": "give --last-word"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("family", metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("address", metavar="ADDRESS", help="of the starter, 1..247")
    parser.add_argument("verb", metavar="VERB", help="start, stop, reset, set, read ...")
    parser.add_argument("args", metavar="KEY=VALUE", nargs="*", help="e.g. parameter=P314 value=30")
    parser.add_argument("--last-word", metavar="N", help="the word in force, as last read or written")
    parser.add_argument("--slot", choices=("1", "2"), help="of the SSW900's RS-485 accessory")


def run(args: argparse.Namespace) -> int:
    """Print all writes of the command in their order, read-backs left out; no port is opened."""
    profile = load_profile(args.family)
    address = whole_number(args.address, "ADDRESS", low=1, high=247)
    variant = Variant(slot=_slot(profile, args.slot))
    seen = _seen(profile, variant, args.last_word)
    values = assigned(args.args, sign="=", form=KEY_VALUE)
    try:
        reads = command.prepare(profile, variant, args.verb, values).reads
        is_read = args.verb == "read"
        steps = reads if is_read else command.build(profile, variant, args.verb, values, seen=seen).steps
    except CommandError as error:
        if error.code in _WRONG_WORDS:
            raise UsageError(error.text) from error
        if error.code in _HINTS:
            raise UsageError(f"{error.text} ({_HINTS[error.code]})") from error
        raise
    for step in steps:
        print(encode(address, step.request.encode()).hex(" ").upper())
    return 0


def _slot(profile: Profile, slot: str | None) -> int | None:
    if slot is not None and len(profile.command_word) < 2:
        raise UsageError(f"{profile.family} has no slots (leave --slot out)")
    return None if slot is None else int(slot)


def _seen(profile: Profile, variant: Variant, last_word: str | None) -> dict[str, tuple[int, ...]]:
    if last_word is None:
        return {}
    if not profile.command_word:
        raise UsageError(f"{profile.family} has no command word (leave --last-word out)")
    word = whole_number(last_word, "--last-word", low=0, high=0xFFFF)
    codes = profile.command_word if variant.slot is None else (profile.command_word[variant.slot - 1],)
    outputs = (output.word for output in profile.outputs.values())  # of the verb `output`
    return dict.fromkeys((*codes, *outputs), (word,))
