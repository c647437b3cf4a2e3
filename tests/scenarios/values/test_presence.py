"""Whether a starter answers, and how old its values then are; rows that it refuses."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable

from tests.rig import RigPlant, clean_line, event, fault, msg, never, played, row, scene, seen
from tests.rig.rows import Action, Expectation
from tests.rig.sites import SITES, SST, SSW07, SSW900, starter
from tests.scenarios.values.words import answers, reads_any, refuse_rows

PUMP = "starter/pump/"


def _every_value_is(quality: str, name: str = "pump") -> Expectation:
    def check(plant: RigPlant) -> str:
        topics = {each.topic for each in plant.messages(f"starter/{name}/value/+")}
        assert len(topics) > 5
        newest = {topic: plant.messages(topic.removeprefix(plant.base + "/"))[-1].json for topic in topics}
        read = [
            topic for topic, body in newest.items() if body["time"] is not None
        ]  # some are the gateway's own
        return "\n".join(topic for topic in read if newest[topic]["quality"] != quality)

    return check


def _times_are_older_than(at_s: float) -> Expectation:
    """The stale values have the time of their last reading."""

    def check(plant: RigPlant) -> str:
        stale = [each for each in plant.messages(PUMP + "value/+") if each.json["quality"] == "stale"]
        late = [str(each) for each in stale if each.json["time"] > f"2026-11-21T00:00:{at_s:06.3f}Z"]
        return "\n".join(late) if stale else "nothing is stale"

    return check


PRESENCE = [
    scene(
        "after four misses it is offline, said once, and every value stale with its own old time",
        SSW07,
        {5: fault("silent", "pump")},
        20,
        msg(PUMP + "availability", state="offline", reason=..., since=...),
        seen(PUMP + "event", code="went_silent", severity="warning", times=1),
        msg(PUMP + "state", state="unknown", quality="stale"),
        msg(PUMP + "value/current", quality="stale", value=0.0),
        _every_value_is("stale"),
        _times_are_older_than(5.1),
        clean_line,
    ),
    scene(
        "a disabled starter is never asked",
        SSW07 + starter("spare", 9, "ssw07", enabled=False),
        {},
        10,
        msg("starter/spare/availability", state="disabled"),
        lambda plant: str(plant.starter("spare").asked or ""),
    ),
]


def _every(count: int, reply: bytes | None = None) -> Callable[[bytes], bytes | None]:
    """Answer every so many requests by this, or not at all."""
    asked = itertools.count(1)
    return lambda _: reply if next(asked) % count == 0 else b""


def _hides_coil8(time: int) -> Action:
    """Have an SST refuse its coils as a block, and not answer COIL8 alone after so many refusals."""
    refused = itertools.count(1)
    latest = 0

    def habit(pdu: bytes) -> bytes | None:
        nonlocal latest
        if not reads_any(pdu, {7}, (1,)):
            return b""
        if not reads_any(pdu, {16}, (1,)):
            return None if latest >= time else b""
        latest = next(refused)
        return b"\x81\x02"

    return answers("belt", habit)


def _asked_for(register: int, name: str, *, most_s: float) -> Expectation:
    """From 20 s to 50 s a register was asked for again and again, within this time."""

    def check(plant: RigPlant) -> str:
        asked = [at_s for at_s, pdu in plant.starter(name).asked if reads_any(pdu, {register})]
        times_s = [20.0, *(at_s for at_s in asked if 20.0 <= at_s <= 50.0), 50.0]
        longest_s = max(after - before for before, after in itertools.pairwise(times_s))
        return "" if longest_s <= most_s else f"it was not asked for during {longest_s:.1f} s"

    return check


REFUSALS = [
    *(
        scene(
            f"a row that is refused with exception {code} leaves the others of its block good",
            SSW07,
            {5: refuse_rows("pump", {3}, code)},
            120,
            msg(PUMP + "value/current", value=None, quality="bad"),
            msg(PUMP + "value/current_pct", quality="good"),
            msg(PUMP + "value/fault_code", quality="good"),
            msg(PUMP + "state", state="ready", quality="good"),
        )
        for code in (1, 2, 3)
    ),
    row(
        "a row that was refused is asked again after an hour",
        given=SSW07.replace("every_s = 1.0", "every_s = 20.0"),
        at={5: refuse_rows("pump", {3}, for_s=900)},
        then={
            3000: msg(PUMP + "value/current", quality="bad"),
            3800: msg(PUMP + "value/current", quality="good"),
        },
    ),
    *(
        row(
            f"exception {code} gives no row up",
            given=SSW07,
            at={5: refuse_rows("pump", {3}, code, for_s=60)},
            then={100: msg(PUMP + "value/current", quality="good")},
        )
        for code in (5, 6, 10)
    ),
    *(
        row(
            f"a starter whose status is refused is degraded, and asked at least every 5 s ({name})",
            given=SITES[name],
            at={5: refuse_rows(name, {register}, code, for_s=60)},
            then={
                50: [
                    msg(f"starter/{name}/availability", state="degraded", reason=re.compile("refused")),
                    event("degraded", f"starter/{name}/event", severity="warning"),
                    msg(f"starter/{name}/state", state="unknown"),
                    _asked_for(register, name, most_s=5.1),
                ],
                90: [
                    msg(f"starter/{name}/availability", state="online"),
                    event("recovered", f"starter/{name}/event"),
                    msg(f"starter/{name}/state", quality="good", running=False),
                ],
            },
        )
        for name, register, code in (("pump", 5001, 2), ("fan", 5001, 1), ("mill", 680, 3), ("belt", 19, 2))
    ),
    row(
        "a point that is made of two others goes on while both do, read one by one since a third is refused",
        given=SST,
        at={
            5: refuse_rows("belt", {16}, functions=(1,)),
            40: "belt COIL7 = 1",
            60: [refuse_rows("belt", {6}, functions=(1,)), "belt COIL7 = 0"],
        },
        then={
            40: [
                msg("starter/belt/value/coil17", quality="bad"),
                never("starter/belt/value/remote", since=6, quality="bad"),
            ],
            50: msg("starter/belt/value/remote", value=False, quality="good"),
            80: msg("starter/belt/value/remote", value=None, quality="bad"),
        },
    ),
    *[
        scene(
            f"a row that is not answered after refusal {time} of its block is stale, what is made of it bad",
            SST,
            {5: _hides_coil8(time)},
            judged_s,
            msg("starter/belt/value/coil7", quality="good"),
            msg("starter/belt/value/coil8", value=False, quality="stale"),
            msg("starter/belt/value/remote", value=None, quality="bad"),
        )
        for time, judged_s in ((1, 30), (3, 100))  # before the third it was asked for as a whole again
    ],
    row(
        "a refusal now and then costs no poll and no value",
        given=SSW07,
        at={3: answers("pump", _every(20, b"\x83\x02"), for_s=200)},
        then={
            600: [
                never(PUMP + "availability", since=5, state="degraded"),
                msg(PUMP + "state", quality="good"),
            ],
            280: _every_value_is("good"),
        },
    ),
    scene(
        "an SSW900 whose fault number is refused is degraded, its status good",
        SSW900,
        {5: refuse_rows("mill", {90})},
        60,
        msg("starter/mill/availability", state="degraded"),
        msg("starter/mill/state", state="ready", quality="good", running=False),
    ),
]


test_presence = played(PRESENCE + REFUSALS)
