"""Which watchdogs of the communication are on in a starter: after how long they act, and what they do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gateway.families.devices import device_of
from gateway.families.devices.findings import Settings, Watchdog
from gateway.families.profile.schema import Profile, Table, Variant
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteRegister, WriteRegisters


def watchdog_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows that `watchdogs` looks at, as far as the family has them."""
    device = device_of(profile)
    return (*device.source_rows, *device.watchdog_rows)


def time_codes(profile: Profile) -> tuple[str, ...]:
    """Return those of `watchdog_codes` that say whether a watchdog is on, and after how long it acts."""
    return device_of(profile).watchdog_rows


def watchdogs(
    profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]
) -> tuple[Watchdog, ...]:
    """Return the watchdogs that these rows (raw words by code) switch on, the first to act first."""
    found = device_of(profile).watchdogs(Settings(profile, variant, rows))
    return tuple(sorted(found, key=lambda each: each.after_s))


def shortest_s(profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]) -> float | None:
    """Return after how long without a request the first watchdog acts; None when none is on."""
    found = watchdogs(profile, variant, rows)
    return found[0].after_s if found else None


def written_rows(profile: Profile, requests: Iterable[Request]) -> dict[str, tuple[int, ...]]:
    """Return those rows of `watchdog_codes` that these requests write, with the words they get."""
    found: dict[str, tuple[int, ...]] = {}
    rows = [profile.parameters[code] for code in watchdog_codes(profile)]
    for request in requests:
        match request:
            case WriteRegister():
                start = request.address
                words: tuple[int, ...] = (request.word,)
            case WriteRegisters():
                start = request.address
                words = tuple(request.words)
            case _:
                continue
        for row in rows:
            at = row.address - start
            if row.table is not Table.COIL and at >= 0 and at + row.words <= len(words):
                found[row.code] = words[at : at + row.words]
    return found
