"""Is a starter ready to be run from afar: what would refuse a start, and which watchdog acts when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from gateway.families.diagnosis.findings import Finding, Settings, Topic, Watchdog, Weight
from gateway.families.diagnosis.watchdogs import (
    MODE_BY_SERIAL,
    SERIAL,
    slot_source,
    watchdog_codes,
    watchdogs,
)
from gateway.families.profile.schema import Profile, Variant

SAFE_FACTOR = 1.5  # a watchdog below this many longest gaps leaves little room for commands and retries


def readiness_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows that `readiness` looks at."""
    codes = dict.fromkeys((*_CODES.get(profile.family, ()), *watchdog_codes(profile)))
    return tuple(codes)


def readiness(
    profile: Profile,
    variant: Variant,
    rows: Mapping[str, tuple[int, ...]],
    *,
    gap_s: float | None = None,
    watchdog_s: float | None = None,
) -> tuple[Finding, ...]:
    """Return what these rows (raw words by code) mean for remote control, the gravest first.

    `gap_s` is the longest time between two requests to this starter; None when nobody polls it. The
    configuration's `watchdog_s`, and its slot in `variant`, are held against what is set in the starter.
    """
    settings = Settings(profile, variant, rows)
    look = _LOOKS.get(profile.family)
    found = [
        *(look(settings) if look is not None else ()),
        *_of_watchdogs(settings, watchdogs(profile, variant, rows), gap_s),
        *_stated_watchdog(settings, watchdogs(profile, variant, rows), watchdog_s),
    ]
    order = list(reversed(Weight))
    return tuple(sorted(found, key=lambda finding: order.index(finding.weight)))


def refuses_start(findings: tuple[Finding, ...]) -> bool:
    """Return whether a start would be refused as the settings stand."""
    return any(each.topic is Topic.START and each.weight is Weight.ERROR for each in findings)


_CODES: dict[str, tuple[str, ...]] = {
    "ssw06": ("P220", "P229", "P230", "P277", "P278", "P279", "P630", "VB06"),
    "ssw07": ("P220", "P229", "P230", "P277", "P278", "P630"),
    "ssw900": ("C3.1", "C3.2", "C3.3", "S3.5.1", "S3.5.2"),
    "sst": ("COIL5", "COIL7", "COIL8", "COIL26"),
}

_WATCHDOG_ROWS = {
    "ssw06": ("P314", "P313"),
    "ssw07": ("P314", "P313"),
    "ssw900": ("C8.2.5.1", "C8.2.5.2", "C8.2.5.3"),
    "sst": ("R41", "R42"),
}
_RS485 = 2  # S3.5.1, S3.5.2 [ssw900 table A.2]
_SAME_S = 0.05  # half of the finest step that a starter has
_ACTIONS = ("P313", "C8.2.5.2")

_NOT_EXECUTED = "a start is not executed: in remote mode the commands come from elsewhere"
_NEVER_REMOTE = "a start needs remote mode, and the starter is never in it"
_CHOSEN_ELSEWHERE = "somebody else chooses local or remote, and in local mode a start is refused"
_DEAF_IN_LOCAL = "in local mode neither a start nor a stop of the gateway acts"


def _start(weight: Weight, text: str) -> Finding:
    return Finding(Topic.START, weight, text)


def _unread(settings: Settings, codes: tuple[str, ...], topic: Topic) -> Iterator[Finding]:
    for code in codes:
        if settings.number(code) is None:
            yield Finding(
                topic, Weight.WARNING, f"{code} could not be read, so what it brings about is not known"
            )


def _weg(settings: Settings) -> Iterator[Finding]:
    """SSW-06, SSW-07, SSW-08 [ssw06-es 2.5-2.7, 4.2.3-4.3; ssw07 2.5-2.7, 4.2.2-4.3]."""
    yield from _unread(settings, ("P220", "P229", "P230"), Topic.START)
    mode, local, remote = (settings.number(code) for code in ("P220", "P229", "P230"))
    if remote not in (None, SERIAL):
        shown = settings.shown("P230")
        yield _start(Weight.ERROR, f"{_NOT_EXECUTED}: {shown} (set P230 = 2, Serial)")
    if mode == 0:
        yield _start(Weight.ERROR, f"{_NEVER_REMOTE}: {settings.shown('P220')} (set P220 = 1 or 6)")
    elif mode is not None and mode != 1 and mode not in MODE_BY_SERIAL:
        yield Finding(Topic.LOCAL, Weight.NOTE, f"{_CHOSEN_ELSEWHERE}: {settings.shown('P220')}")
    if local not in (None, SERIAL) and mode != 1:
        yield Finding(Topic.LOCAL, Weight.NOTE, f"{_DEAF_IN_LOCAL}: {settings.shown('P229')}")
    if settings.number("VB06"):
        what = "the motor cannot be run in an adjusting mode"
        yield _start(Weight.ERROR, f"{what}: {settings.shown('VB06')} (leave it at the starter)")
    if settings.number("P630"):
        what = "right after a stop a start is ignored for a time, without an error"
        yield _start(Weight.NOTE, f"{what}: {settings.shown('P630')}")
    yield from _relays(settings)


def _relays(settings: Settings) -> Iterator[Finding]:
    """The number that means Serial is not printed [ssw06-es 4.2.6; ssw07 4.2.3]."""
    known = [code for code in ("P277", "P278", "P279") if settings.number(code) is not None]
    if known:
        shown = ", ".join(settings.shown(code) for code in known)
        what = "a relay follows `output` only where its function is Serial, whose number is not printed"
        yield Finding(Topic.OUTPUT, Weight.NOTE, f"{what}: {shown}")


def _ssw900(settings: Settings) -> Iterator[Finding]:
    """Menu C3 [ssw900 table A.2, C8.2.5.2]; C8.2.5.3 = 0.0 s is not explained (C8.2.5)."""
    yield from _unread(settings, ("C3.1", "C3.2", "C3.3"), Topic.START)
    own, slot = slot_source(settings.variant), settings.variant.slot
    if own is None or slot is None:
        what = "no command is sent while it is not known which slot holds the RS-485 accessory"
        yield _start(Weight.ERROR, f"{what} (see S3.5.1 and S3.5.2, or configure `slot`)")
        return
    yield from _stated_slot(settings, slot)
    mode, local, remote = (settings.number(code) for code in ("C3.1", "C3.2", "C3.3"))
    if remote not in (None, own):
        shown = settings.shown("C3.3")
        yield _start(Weight.ERROR, f"{_NOT_EXECUTED}: {shown} (set C3.3 = {own}, Slot {slot})")
    own_modes = (7 + 2 * slot, 8 + 2 * slot)  # Slot n LOC, Slot n REM
    if mode == 0:
        yield _start(
            Weight.ERROR, f"{_NEVER_REMOTE}: {settings.shown('C3.1')} (set C3.1 = 1 or {own_modes[1]})"
        )
    elif mode is not None and mode != 1 and mode not in own_modes:
        yield Finding(Topic.LOCAL, Weight.NOTE, f"{_CHOSEN_ELSEWHERE}: {settings.shown('C3.1')}")
    if local not in (None, own) and mode != 1:
        yield Finding(Topic.LOCAL, Weight.NOTE, f"{_DEAF_IN_LOCAL}: {settings.shown('C3.2')}")
    if settings.number("C8.2.5.1") and settings.number("C8.2.5.3") == 0:
        what = "the manual does not say what a timeout of 0.0 s does"
        yield Finding(Topic.WATCHDOG, Weight.WARNING, f"{what}: {settings.shown('C8.2.5.1')}")


def _sst(settings: Settings) -> Iterator[Finding]:
    """Coils 5, 7, 8, 26; registers 41, 42 [coil table, NOTES]."""
    yield from _unread(settings, ("COIL5", "COIL7", "COIL8", "COIL26"), Topic.START)
    if settings.number("COIL7"):
        yield _start(Weight.ERROR, "USB controls the starter (coil 7): it refuses every write")
    if settings.number("COIL8"):
        yield _start(Weight.ERROR, "the parallel inputs control the starter (coil 8): it refuses every write")
    if settings.number("COIL5") == 0:
        yield _start(Weight.ERROR, "it is not initialised (coil 5 = 0): send `configure` before a start")
    if settings.number("COIL26") == 0:
        what = (
            "it is not ready for a start (coil 26 = 0): mains and power source are not detected, or an error"
        )
        yield _start(Weight.ERROR, f"{what} is present")
    stop_s, restart_s = settings.number("R41"), settings.number("R42")
    if stop_s and restart_s and restart_s <= stop_s:
        what = "it would restart before it stops the motor, which the manual does not describe"
        shown = f"{settings.shown('R42')} is not above {settings.shown('R41')}"
        yield Finding(Topic.WATCHDOG, Weight.WARNING, f"{what}: {shown}")


def _stated_slot(settings: Settings, slot: int) -> Iterator[Finding]:
    """Say that the accessory sits in the other slot: its command word would never be written (ssw900 3)."""
    contents = (settings.number("S3.5.1"), settings.number("S3.5.2"))
    if contents[slot - 1] is not None and contents[slot - 1] != _RS485 and _RS485 in contents:
        other = contents.index(_RS485) + 1
        shown = f"{settings.shown('S3.5.1')}, {settings.shown('S3.5.2')}"
        what = f"slot = {slot} is configured, but the RS-485 accessory sits in slot {other}"
        yield _start(Weight.ERROR, f"{what}: {shown} (set slot = {other}, or leave it out)")


def _stated_watchdog(
    settings: Settings, found: tuple[Watchdog, ...], watchdog_s: float | None
) -> Iterator[Finding]:
    """Say that the configuration's `watchdog_s` is not what is set in the starter."""
    codes = _WATCHDOG_ROWS.get(settings.profile.family, ())
    if watchdog_s is None or any(settings.number(code) is None for code in codes):
        return
    set_s = min((each.after_s for each in found), default=0.0)
    if abs(set_s - watchdog_s) < _SAME_S:
        return
    shown = ", ".join(settings.shown(code) for code in codes if code not in _ACTIONS)
    is_set = f"is set to {set_s:g} s" if set_s else "is off"
    what = f"watchdog_s = {watchdog_s:g} is configured, but the starter's own {is_set}: {shown}"
    yield Finding(Topic.WATCHDOG, Weight.WARNING, f"{what} (correct one of them)")


def _of_watchdogs(settings: Settings, found: tuple[Watchdog, ...], gap_s: float | None) -> Iterator[Finding]:
    codes = _WATCHDOG_ROWS.get(settings.profile.family, ())
    unread = tuple(_unread(settings, codes, Topic.WATCHDOG))
    yield from unread
    if not found and codes and not unread:
        shown = ", ".join(settings.shown(code) for code in codes if code not in _ACTIONS)
        what = "no watchdog is on: when the gateway or the line fails, the motor goes on as it is"
        yield Finding(Topic.WATCHDOG, Weight.NOTE, f"{what} ({shown})")
    for watchdog in found:
        yield _kept(watchdog, gap_s)


def _kept(watchdog: Watchdog, gap_s: float | None) -> Finding:
    """Say what a watchdog does, and whether the polls keep it from doing so."""
    text = f"after {watchdog.after_s:g} s without a request it {watchdog.does} ({watchdog.code})"
    if gap_s is None:
        return Finding(Topic.WATCHDOG, Weight.NOTE, text)
    polls = f"the polls leave up to {gap_s:.2f} s between two requests"
    if watchdog.after_s <= gap_s:
        weight = Weight.ERROR if watchdog.is_felt else Weight.WARNING
        return Finding(Topic.WATCHDOG, weight, f"{text}; {polls}: it may act although all is well")
    if watchdog.after_s < SAFE_FACTOR * gap_s:
        return Finding(Topic.WATCHDOG, Weight.WARNING, f"{text}; {polls}, which leaves little to spare")
    return Finding(Topic.WATCHDOG, Weight.NOTE, f"{text}; {polls}, which keeps it quiet")


_LOOKS: dict[str, Callable[[Settings], Iterator[Finding]]] = {
    "ssw06": _weg,
    "ssw07": _weg,
    "ssw900": _ssw900,
    "sst": _sst,
}
