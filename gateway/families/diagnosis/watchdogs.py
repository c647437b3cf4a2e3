"""Which watchdogs of the communication are on in a starter: after how long they act, and what they do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from gateway.families.diagnosis.findings import Settings, Watchdog
from gateway.families.profile.schema import Profile, Table, Variant
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteRegister, WriteRegisters

SERIAL = 2  # P229, P230 [ssw06-es 2.6, 2.7; ssw07 2.6, 2.7]
MODE_BY_SERIAL = (5, 6)  # P220 [ssw06-es 2.5; ssw07 2.5]


def watchdog_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows that `watchdogs` looks at, as far as the family has them."""
    codes = (
        "P220",
        "P229",
        "P230",
        "P313",
        "P314",
        "C3.2",
        "C3.3",
        "C8.2.5.1",
        "C8.2.5.2",
        "C8.2.5.3",
        "R41",
        "R42",
    )
    return tuple(code for code in codes if code in profile.parameters)


def time_codes(profile: Profile) -> tuple[str, ...]:
    """Return those of `watchdog_codes` that say whether a watchdog is on, and after how long it acts."""
    rows = ("P313", "P314", "C8.2.5.1", "C8.2.5.2", "C8.2.5.3", "R41", "R42")  # neighbours: one request
    return tuple(code for code in rows if code in profile.parameters)


def watchdogs(
    profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]
) -> tuple[Watchdog, ...]:
    """Return the watchdogs that these rows (raw words by code) switch on, the first to act first."""
    told = _TELLERS.get(profile.family)
    found = told(Settings(profile, variant, rows)) if told is not None else ()
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


def slot_source(variant: Variant) -> int | None:
    """Return the number of this accessory's slot in C3.2 and C3.3; None while the slot is unknown."""
    return None if variant.slot is None else 3 + variant.slot


def _is_one_of(numbers: tuple[int, ...], *read: int | None) -> bool:
    """Return whether any of these readings may be one of the numbers: one that is not known may be."""
    return any(number is None or number in numbers for number in read)


def _weg(settings: Settings) -> tuple[Watchdog, ...]:
    """SSW-06, SSW-07, SSW-08: E28 after P314 [ssw06-es 2.3, 2.4; ssw07 2.3, 2.4]."""
    after_s, action = settings.number("P314"), settings.number("P313")
    if not after_s:
        return ()
    is_serial = _is_one_of((SERIAL,), settings.number("P229"), settings.number("P230"))
    does, is_felt = "shows E28 and does nothing else", False
    if action == 1 and is_serial:
        does, is_felt = "shows E28 and stops the motor by ramp", True
    elif action == 1:
        does = "shows E28; P313 = 1 does not stop the motor, since P229 and P230 are not Serial"
    elif action == 2:
        does, is_felt = "shows E28 and disables the motor, which coasts", True
    elif action == 3 and _is_one_of(MODE_BY_SERIAL, settings.number("P220")):
        does, is_felt = "shows E28 and changes to local", True
    elif action == 3:
        does = "shows E28; P313 = 3 does not change to local, since P220 is not Serial"
    elif action == 5:
        does, is_felt = "shows E28 as a fatal error: the motor is disabled until a reset", True
    elif action is None:
        does, is_felt = "shows E28 and does what P313 says, which could not be read", True
    return (Watchdog("P314", float(after_s), does, is_felt),)


_FAULT, _ALARM = 1, 2  # C8.2.5.1
_ALARM_ACTIONS = {  # C8.2.5.2, carried out through the command word of the accessory's slot
    1: "raises alarm A128 and stops the motor by ramp",
    2: "raises alarm A128 and disables the motor, which coasts",
    3: "raises alarm A128 and changes to local",
    4: "raises alarm A128 and changes to remote",
}


def _is_elsewhere(settings: Settings) -> bool:
    """Return whether the accessory's slot is no source of commands [ssw900 C8.2.5.2]."""
    own = slot_source(settings.variant)
    return own is not None and not _is_one_of((own,), settings.number("C3.2"), settings.number("C3.3"))


def _ssw900(settings: Settings) -> tuple[Watchdog, ...]:
    """F128 or A128 after C8.2.5.3, counted from the first valid request on [ssw900 C8.2.5]."""
    mode, tenths = settings.number("C8.2.5.1"), settings.number("C8.2.5.3")
    if mode not in (_FAULT, _ALARM) or not tenths:
        return ()
    action = settings.number("C8.2.5.2")
    if mode == _FAULT:
        does, is_felt = "trips with fault F128: the motor is disabled until a reset", True
    elif action not in _ALARM_ACTIONS:
        does, is_felt = "raises alarm A128 and does nothing else", False
    elif _is_elsewhere(settings):
        does = "raises alarm A128; its action has no effect, since C3.2 and C3.3 name other sources"
        is_felt = False
    else:
        does, is_felt = _ALARM_ACTIONS[action], True
    return (Watchdog("C8.2.5.3", tenths / 10, does, is_felt),)


def _sst(settings: Settings) -> tuple[Watchdog, ...]:
    """Registers 41 and 42; any request starts both anew [register table, NOTES]."""
    found = []
    for code, does in (("R41", "stops the motor"), ("R42", "stops the motor and restarts itself")):
        after_s = settings.number(code)
        if after_s:
            found.append(Watchdog(code, float(after_s), does, is_felt=True))
    return tuple(found)


_TELLERS: dict[str, Callable[[Settings], tuple[Watchdog, ...]]] = {
    "ssw06": _weg,
    "ssw07": _weg,
    "ssw900": _ssw900,
    "sst": _sst,
}
