"""The writes of a command: single coils, masked command words, or a new word out of the one in force.

A command word without mask sets all its bits at once (SSW900 S5.2, ssw07 4.2.2), so every word must be built
from what is in force: a word built from zero would also command general disable and local. A stop for which
that is not known clears its bits in the starter itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import or_

from gateway.contract import CommandError, ResultCode
from gateway.families.profile.decode import decode_points, is_there, since_firmware
from gateway.families.profile.procedure import Seen
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Command, Profile, Variant, Write
from gateway.modbus import MaskWriteRegister, Request, WriteCoil, WriteRegister


def has_plain_word(writes: Sequence[Write]) -> bool:
    """Return whether a command writes a word without mask, for which the word in force must be known."""
    return any(write.word and write.mask_shift is None for write in writes)


def word_codes(profile: Profile, variant: Variant) -> tuple[str, ...]:
    """Return the rows of the command words that the starter may listen to: both while its slot is unknown."""
    if variant.slot is None or len(profile.command_word) < 2:
        return profile.command_word
    return (profile.command_word[variant.slot - 1],)


def missing_since(profile: Profile, variant: Variant, command: Command) -> str:
    """Return the firmware that brought what a command writes, where this starter's is older; else empty."""
    coils = (write.coil for write in command.writes if write.coil is not None)
    codes = (profile.rows_at[Table.COIL, coil][0].code for coil in coils)
    missing = (code for code in codes if not is_there(profile, variant, code))
    return next((since_firmware(profile, variant, code) for code in missing), "")


def run_row(profile: Profile, variant: Variant) -> str:
    """Return the row whose bit 0 is the run command, as far as it can be read back; slot_unknown."""
    codes = word_codes(profile, variant)
    if len(codes) > 1:
        raise CommandError(ResultCode.SLOT_UNKNOWN)
    if codes:
        return codes[0]
    address = profile.commands["start"].writes[0].coil or 0
    return profile.rows_at[Table.COIL, address][0].code


def command_bit(profile: Profile, name: str) -> int:
    """Return the bit of `run_row` that a motion command sets; single coils follow its order (ssw07 5.3.2)."""
    start, write = (profile.commands[each].writes[0] for each in ("start", name))
    if write.coil is None or start.coil is None:
        return write.set_bits
    return profile.command_bits.run << (write.coil - start.coil)


def is_jogging(profile: Profile, seen: Seen) -> bool:
    """Return whether the starter was last seen to jog."""
    return bool(flags_of(profile, seen).get("jog"))


def command_requests(
    profile: Profile, variant: Variant, writes: Sequence[Write], *, seen: Seen
) -> tuple[Request, ...]:
    """Return what a command other than a stop writes; slot_unknown, or word_unknown when nothing was seen."""
    if not has_plain_word(writes):
        return _requests(profile, writes)
    code = run_row(profile, variant)
    word = word_in_force(profile, code, seen)
    if word is None:
        raise CommandError(ResultCode.WORD_UNKNOWN, "command")
    return _requests(profile, writes, code=code, word=word)


def stop_requests(
    profile: Profile, variant: Variant, writes: Sequence[Write], *, seen: Seen
) -> tuple[Request, ...]:
    """Return what a stop writes, whatever is unknown.

    Of a word that was not seen only the bits of motion are cleared, by mask (SSW900 7.1, function 22): any
    other bit written would enable the starter, or change who commands it. While the slot is unknown each
    slot's word is written: the device clears the commands of the source that is not active (SSW900 S5.2).
    """
    if not has_plain_word(writes):
        return _requests(profile, writes)
    found: list[Request] = []
    jog = profile.command_bits.jog
    for code in word_codes(profile, variant):
        word = word_in_force(profile, code, seen)
        if word is None:
            off = reduce(or_, (write.clear_bits for write in writes), jog)
            found.append(MaskWriteRegister(profile.parameters[code].address, 0xFFFF & ~off, 0))
        else:
            found += _requests(profile, writes, code=code, word=word & ~jog)
    return tuple(found)


def word_in_force(profile: Profile, code: str, seen: Seen) -> int | None:
    """Return the command word that would change nothing, None when neither it nor the status word was seen.

    The device shows only a part of the word (SSW900 S5.2), so what the status says counts for more. A run or
    jog command stays only while the motor obeys it. With the last word alone, that word is taken as it is.
    """
    last, flags = seen.get(code), flags_of(profile, seen)
    if last is None and not flags:
        return None
    bits = profile.command_bits
    word = 0 if last is None else last[0] & bits.all
    for name, bit in (
        ("general_enabled", bits.general_enabled),
        ("remote", bits.remote),
        ("reverse", bits.reverse),
    ):
        if name in flags:
            word = word | bit if flags[name] else word & ~bit
    for name, bit in (("moving", bits.run), ("jog", bits.jog)):
        if flags.get(name) is False:
            word &= ~bit
    return word


def flags_of(profile: Profile, seen: Seen) -> dict[str, bool]:
    """Return the known boolean points of the rows seen, and `moving`: whether a run command is obeyed."""
    points = decode_points(profile, Variant(), seen)
    flags = {name: point.value for name, point in points.items() if isinstance(point.value, bool)}
    if "running" in flags:
        flags["moving"] = any(
            flags.get(name) for name in ("running", "accelerating", *profile.state.starting)
        )
    return flags


def _requests(
    profile: Profile, writes: Sequence[Write], *, code: str = "", word: int = 0
) -> tuple[Request, ...]:
    """Return the requests of writes; `code` and `word` are of the plain command word, which they change."""
    found: list[Request] = []
    for write in writes:
        if write.coil is not None:
            found.append(WriteCoil(write.coil, write.value))
        elif write.mask_shift is not None:  # bits without their mask bit keep their state (ssw06-es 4.2.3)
            mask = (write.set_bits | write.clear_bits) << write.mask_shift
            found.append(WriteRegister(profile.parameters[write.word].address, mask | write.set_bits))
        else:
            word = (word & ~write.clear_bits) | write.set_bits
            found.append(WriteRegister(profile.parameters[code].address, word))
    return tuple(found)
