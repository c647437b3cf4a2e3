"""Is a starter ready for remote control: what would refuse a start, and which watchdog acts when."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from gateway.families.devices import device_of
from gateway.families.devices.findings import Remark, Settings, Topic, Watchdog, Weight, start, unread
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Profile, Variant, once_per_profile
from gateway.modbus import Request, WriteCoil, WriteRegister, WriteRegisters

SAFE_FACTOR = 1.5  # a watchdog below this many longest gaps leaves little room for commands and retries


@once_per_profile
def watchdog_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows that `watchdogs` looks at, as far as the family has them."""
    device = device_of(profile)
    return (*device.source_rows, *device.watchdog_rows)


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
    """Return the rows that these requests write, with the words they get."""
    found: dict[str, tuple[int, ...]] = {}
    for request in requests:
        match request:
            case WriteCoil(is_on=is_on):
                words: tuple[int, ...] = (int(is_on),)
            case WriteRegister(word=word):
                words = (word,)
            case WriteRegisters(words=several):
                words = several
            case _:
                continue
        for code, row in profile.parameters.items():
            at, is_coil = row.address - request.address, row.table is Table.COIL
            if is_coil is isinstance(request, WriteCoil) and at >= 0 and at + row.words <= len(words):
                found[code] = words[at : at + row.words]
    return found


def readiness_codes(profile: Profile) -> tuple[str, ...]:
    """Return the rows that `readiness` looks at."""
    return tuple(dict.fromkeys((*device_of(profile).start_rows, *watchdog_codes(profile))))


def readiness(
    profile: Profile,
    variant: Variant,
    rows: Mapping[str, tuple[int, ...]],
    *,
    gap_s: float | None = None,
    watchdog_s: float | None = None,
    slot_trouble: str = "",
) -> tuple[Remark, ...]:
    """Return what these rows (raw words by code) mean for remote control, errors first.

    `gap_s` is the longest time between two requests to this starter; None when it is not polled. The
    configuration's `watchdog_s` is held against what is set in the starter.
    """
    settings = Settings(profile, variant, rows)
    on = watchdogs(profile, variant, rows)
    found = [
        *([start(Weight.ERROR, slot_trouble)] if slot_trouble else ()),
        *device_of(profile).start_findings(settings),
        *_of_watchdogs(settings, on, gap_s),
        *_stated_watchdog(settings, on, watchdog_s),
    ]
    order = list(reversed(Weight))
    return tuple(sorted(found, key=lambda finding: order.index(finding.weight)))


def refuses_start(findings: tuple[Remark, ...]) -> bool:
    """Return whether a start would be refused as the settings stand."""
    return any(each.topic is Topic.START and each.weight is Weight.ERROR for each in findings)


_SAME_S = 0.05  # half of the finest step that a starter has


def _stated_watchdog(
    settings: Settings, found: tuple[Watchdog, ...], watchdog_s: float | None
) -> Iterator[Remark]:
    """Say that the configuration's `watchdog_s` is not what is set in the starter."""
    codes = device_of(settings.profile).watchdog_rows
    if watchdog_s is None or any(settings.number(code) is None for code in codes):
        return
    set_s = min((each.after_s for each in found), default=0.0)
    if abs(set_s - watchdog_s) < _SAME_S:
        return
    is_set = f"is set to {set_s:g} s" if set_s else "is off"
    what = f"watchdog_s = {watchdog_s:g} is configured, but the starter's own {is_set}: {_times(settings)}"
    yield Remark(Topic.WATCHDOG, Weight.WARNING, f"{what} (correct one of them)")


def _of_watchdogs(settings: Settings, found: tuple[Watchdog, ...], gap_s: float | None) -> Iterator[Remark]:
    codes = device_of(settings.profile).watchdog_rows
    missing = tuple(unread(settings, codes, Topic.WATCHDOG))
    yield from missing
    if not found and codes and not missing:
        what = "no watchdog is on: when the gateway or the line fails, the motor goes on as it is"
        yield Remark(Topic.WATCHDOG, Weight.NOTE, f"{what} ({_times(settings)})")
    for watchdog in found:
        yield _margin(watchdog, gap_s)


def _times(settings: Settings) -> str:
    device = device_of(settings.profile)
    return ", ".join(settings.shown(code) for code in device.watchdog_rows if code != device.watchdog_action)


def _margin(watchdog: Watchdog, gap_s: float | None) -> Remark:
    """Say what a watchdog does, and whether the polls keep it from doing so."""
    text = f"after {watchdog.after_s:g} s without a request it {watchdog.does} ({watchdog.code})"
    if gap_s is None:
        return Remark(Topic.WATCHDOG, Weight.NOTE, text)
    polls = f"the polls leave up to {gap_s:.2f} s between two requests"
    if watchdog.after_s <= gap_s:
        weight = Weight.ERROR if watchdog.is_felt else Weight.WARNING
        return Remark(Topic.WATCHDOG, weight, f"{text}; {polls}: it may act although all is well")
    if watchdog.after_s < SAFE_FACTOR * gap_s:
        return Remark(Topic.WATCHDOG, Weight.WARNING, f"{text}; {polls}, which leaves little to spare")
    return Remark(Topic.WATCHDOG, Weight.NOTE, f"{text}; {polls}, which keeps it quiet")
