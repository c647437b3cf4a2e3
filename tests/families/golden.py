"""Everything that is asked of and written to the four families, as text: what `golden.txt` was recorded from.

`python -m tests.families.golden` prints the table anew, with `--whole` all that its digests were made of.
"""

from __future__ import annotations

import hashlib
import random
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare, verbs
from gateway.families.command.interlock import check, points_needed
from gateway.families.devices import device_of
from gateway.families.diagnosis.identify import identify, identify_requests
from gateway.families.diagnosis.readiness import (
    readiness,
    readiness_codes,
    time_codes,
    watchdog_codes,
    watchdogs,
)
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Read
from gateway.families.profile.rows import Access, Parameter
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.state import state_of
from gateway.families.reading import plan_blocks
from gateway.modbus.device_id import DeviceIdentification
from gateway.starters.parameters.model import ParameterEntry, ParameterSet, entries_of
from gateway.starters.parameters.restore_plan import plan_restore, prepare_change

TABLE = Path(__file__).parent / "golden.txt"

VARIANTS = tuple(
    Variant(slot=slot, firmware=firmware, model=model)
    for slot in (None, 1, 2)
    for firmware, model in ((None, None), ("1.30", "SST130i-75"), ("4.21", "SST330i"))
)
STATES = 2  # random ones for each verb, its arguments and a variant
_SMALL = (0, 0, 0, 1, 1, 2, 2, 3, 4, 5, 6, 9, 12, 30, 40, 0x8000)

_ARGS: dict[str, tuple[dict[str, Any], ...]] = {
    "general_enable": ({"value": True}, {"value": False}, {}),
    "jog": ({"value": True}, {"value": False}),
    "direction": ({"value": "forward"}, {"value": "reverse"}),
    "local_remote": ({"value": "local"}, {"value": "remote"}, {"value": "x"}),
    "reset": ({}, {"whole": True}),
    "configure": (
        {},
        {"leave": "factory"},
        {"leave": "P202"},
        {"R31": 20},
        {"R41": 30, "R42": 60},
        {"R0": 1},
    ),
    "output": tuple(
        {"output": name, "value": value}
        for name in ("RL1", "RL3", "AO1", "AO2", "DO1", "DO3")
        for value in (True, False, 0, 50, 101)
    ),
    "read": (
        {"parameter": "P003"},
        {"parameter": "S1.1.4"},
        {"parameters": "R19,COIL5"},
        {"parameters": "P002,P3"},
    ),
    "set": (
        {"parameters": {"P220": 2, "P229": 1}},
        {"parameters": {"P313": 1, "P314": 30}},
        {"parameters": {"C8.2.5.1": 2, "C8.2.5.3": 10.0}},
        {"parameters": {"C3.1": 1, "C3.3": 4, "C8.1.1.5": 24}},
        {"parameters": {"R41": 30, "R31": 20}},
    ),
}


def _read(read: Read) -> str:
    return f"{read.request.encode().hex()}={','.join(read.codes)}"


def _expect(expect: Expect | None) -> str:
    if expect is None:
        return "-"
    reads = " ".join(map(_read, expect.reads))
    inner = ";".join(map(_expect, expect.or_else)) + "&" + ";".join(map(_expect, expect.also))
    return f"[{expect.name} {expect.is_one_of} {expect.within_s} {expect.mask:x} {reads} {inner}]"


def of_preparation(preparation: Preparation) -> str:
    """Return what is read and demanded."""
    return f"{' '.join(map(_read, preparation.reads))} {preparation.requires}"


def of_procedure(procedure: Procedure) -> str:
    """Return what is written, in which order, and what must be seen."""
    steps = " ".join(
        f"{step.request.encode().hex()}"
        f"{'~' * step.is_silence_expected}{'0' * step.is_run_off}{'?' * step.may_be_refused}"
        f"{_expect(step.then) if step.then else ''}"
        for step in procedure.steps
    )
    rest = (procedure.subject, procedure.subjects, procedure.is_unchanged, procedure.wears)
    flags = (procedure.is_run_cleared, procedure.is_source)
    abandon = " ".join(request.encode().hex() for request in procedure.abandon)
    return f"{steps} | {_expect(procedure.verify)} | {abandon} | {rest} {flags}"


def _words(row: Parameter, chance: random.Random) -> tuple[int, ...]:
    def word() -> int:
        return chance.choice(_SMALL) if chance.random() < 0.6 else chance.getrandbits(16)

    if row.type.value == "bit":
        return (chance.getrandbits(1),)
    if row.type.value == "bits":
        return (chance.getrandbits(16),)
    return tuple(word() for _ in range(row.words))


def _rows(profile: Profile, chance: random.Random) -> dict[str, tuple[int, ...]]:
    """Return what a starter might show, with gaps."""
    if chance.random() < 0.05:
        return {}
    return {
        row.code: _words(row, chance)
        for row in profile.parameters.values()
        if row.access is not Access.NONE and chance.random() < 0.9
    }


def _prepared(make: Callable[..., Preparation], *args: Any) -> str:
    try:
        return of_preparation(make(*args))
    except CommandError as error:
        return error.code


def _built(*args: Any, seen: Mapping[str, tuple[int, ...]]) -> str:
    try:
        return of_procedure(build(*args, seen=seen))
    except CommandError as error:
        return error.code


def _verbs(profile: Profile) -> Iterator[tuple[str, str]]:
    for verb in verbs(profile):
        chance = random.Random(f"{profile.family} {verb}")
        for args in _ARGS.get(verb, ({},)):
            for variant in VARIANTS:
                yield verb, _prepared(prepare, profile, variant, verb, args)
                for _ in range(STATES):
                    seen = _rows(profile, chance)
                    yield (
                        verb,
                        _built(profile, variant, verb, args, seen=seen),
                    )


def _sets(profile: Profile) -> Iterator[tuple[str, str]]:
    """Each row of the family, set to this and that."""
    chance = random.Random(f"{profile.family} every row")
    for row in profile.parameters.values():
        variant, seen = chance.choice(VARIANTS), _rows(profile, chance)
        for value in (0, 1, 12, row.raw_max, "2026-11-22T05:30:00", "abc"):
            args = {"parameter": row.code, "value": value}
            yield "every row", _prepared(prepare, profile, variant, "set", args)
            yield "every row", _built(profile, variant, "set", args, seen=seen)
    for code in ("P000", "P999", "HR1600", "HR1619", "HR5003", "COIL1", "IR0"):
        yield (
            "every row",
            _prepared(prepare, profile, Variant(), "read", {"parameter": code}),
        )
        args = {"parameter": code, "value": 1}
        yield "every row", _built(profile, Variant(), "set", args, seen={})


def _restores(profile: Profile) -> Iterator[tuple[str, str]]:
    chance = random.Random(f"{profile.family} restore")
    for _ in range(5):
        seen, wanted = _rows(profile, chance), _rows(profile, chance)
        variant = chance.choice(VARIANTS)
        entries = entries_of(profile, variant, wanted)
        entries = {code: ParameterEntry(e.name, None, None, "", e.raw) for code, e in entries.items()}
        saved = ParameterSet("s", profile.family, "", None, None, None, entries)
        for with_sources in (True, False):
            plan = plan_restore(profile, variant, wanted=saved, seen=seen, with_sources=with_sources)
            yield "restore", repr(([(each.code, each.value) for each in plan.changes], list(plan.left)))
            values = {each.code: each.value for each in plan.changes}
            verb = "configure" if any(each.is_configuration for each in plan.changes) else "set"
            for args in (
                [values] if verb == "configure" else [{"parameter": c, "value": v} for c, v in values.items()]
            ):
                yield "restore", _prepared(prepare_change, profile, variant, verb, args)
                yield "restore", _built(profile, variant, verb, args, seen=seen)


def _looks(profile: Profile) -> Iterator[tuple[str, str]]:
    chance = random.Random(f"{profile.family} looks")
    yield (
        "rows looked at",
        f"{sorted(readiness_codes(profile))} {sorted(watchdog_codes(profile))} {sorted(time_codes(profile))}",
    )
    for number in range(400):
        rows, variant = _rows(profile, chance), chance.choice(VARIANTS)
        gap_s, watchdog_s = chance.choice((None, 0.5, 9.0)), chance.choice((None, 1.0, 30.0))
        for code in sorted(readiness_codes(profile)):
            if code in rows and chance.random() < 0.8:
                rows[code] = tuple(chance.choice(range(12)) for _ in rows[code])
        found = readiness(profile, variant, rows, gap_s=gap_s, watchdog_s=watchdog_s)
        yield "readiness", repr([(each.topic, each.weight) for each in found])
        yield "watchdogs", repr([(w.code, w.after_s, w.is_felt) for w in watchdogs(profile, variant, rows)])
        names = [name for name in profile.points if chance.random() < 0.95]
        points: Mapping[str, Any] = {
            name: chance.choice((False, False, False, True, None) if number % 2 else (False, 0, 5, 17, 128))
            for name in names
        }
        alarms = [(alarm.code, alarm.severity) for alarm in device_of(profile).alarms(profile, points)]
        for rule in ("remote", "serial_controls", "no_fault", "has_fault", "is_ready", "is_stopped"):
            if rule not in ("remote", "serial_controls") or rule in points:
                yield "rules", repr([each.code for each in check(profile, (rule,), points)])
        yield "rules", repr(points_needed(profile, ("is_ready", "serial_controls", "is_stopped", "no_fault")))
        yield "state", f"{state_of(profile, points)} {alarms}"


def _identities(profile: Profile) -> Iterator[tuple[str, str]]:
    texts = (
        "SSW-06 820.0A",
        "SSW-07 85.0A",
        "ssw 8 30A",
        "SSW900",
        "SSW-900 48A",
        "SSW-0600",
        "PUMP",
        "",
        "SSW-06/SSW-07",
    )
    asked = identify_requests(profile)
    yield "identify", " ".join(f"{each.tag}={each.request.encode().hex()}" for each in asked)
    chance = random.Random(f"{profile.family} who")
    for number in range(400):
        text = texts[number % len(texts)]
        fc43 = DeviceIdentification({0: "WEG", 1: text, 2: chance.choice(("V1.40", "V01.3", ""))})
        answers: dict[str, Any] = {"fc43": chance.choice((fc43, fc43, None))}
        for each in asked:
            if each.tag != "fc43" and chance.random() < 0.8:
                count = each.request.count  # type: ignore[attr-defined]
                answers[each.tag] = tuple(
                    chance.choice((0, 2, 3, 15, 130, 330, 360, 12345, 0x5353)) for _ in range(count)
                )
        yield "identify", repr(replace(identify(profile, answers), reason=""))


def _polls(profile: Profile) -> Iterator[tuple[str, str]]:
    for variant in VARIANTS:
        plan = plan_blocks(profile, variant)
        yield "polls", " ".join(f"{each.name}:{each.request.encode().hex()}" for each in plan)


def everything() -> Iterator[tuple[str, str, str]]:
    """Yield family, topic and what is done, in their order."""
    for family in ("ssw06", "ssw07", "ssw900", "sst"):
        profile = load_profile(family)
        for part in (_verbs, _sets, _restores, _looks, _identities, _polls):
            for topic, text in part(profile):
                yield family, topic, text


def table() -> list[str]:
    """Return one line for each family and topic: how much there is of it, and its digest."""
    found: dict[tuple[str, str], tuple[int, Any]] = {}
    for family, topic, text in everything():
        count, digest = found.get((family, topic), (0, hashlib.sha256()))
        digest.update(text.encode() + b"\n")
        found[family, topic] = count + 1, digest
    return [
        f"{family:7} {topic:15} {count:6} {digest.hexdigest()[:24]}"
        for (family, topic), (count, digest) in found.items()
    ]


if __name__ == "__main__":
    if "--whole" in sys.argv:
        sys.stdout.writelines(f"{family} {topic}: {text}\n" for family, topic, text in everything())
    else:
        sys.stdout.writelines(f"{line}\n" for line in table())
