"""What was, or may have been, decided before a stop and comes after it moves no motor."""

from __future__ import annotations

from typing import Any

from tests.rig import RigPlant, command, frames, played, publish, row, seen
from tests.rig.rows import Action
from tests.rig.sites import ALICE, QUICK, SSW07, starter, table
from tests.scenarios.commands import issued, old_token

TWO = SSW07 + starter("fan", 2, "ssw06") + ALICE
SITE = TWO + table("[group]", name="hall", starters=["*"])
START, STOP = "05 00 64 ff 00", "05 00 64 00 00"


def by_old(verb: str, **fields: Any) -> Action:
    """A command by a token that was made before the stop."""
    return old_token(f"pump/alice/{verb}", of_s=4.0, **fields)


def late(
    name: str, sent: Action, said: str = "start rejected stopped_first", *, stopped: str = "pump", **more: Any
) -> Any:
    """A stop at 5.5 s; what is sent at 7 s ends as said, and the motor stays at rest."""
    return row(
        name,
        given=more.pop("given", SITE),
        sim={"pump": QUICK, "fan": QUICK},
        at={5.5: publish(f"command/{stopped}/alice/stop"), 7.0: sent},
        then={9.5: [seen("result/pump/alice", **_fields(said)), frames("pump", *more.pop("pdus", [STOP]))]},
        **more,
    )


def _fields(said: str) -> dict[str, str]:
    return dict(zip(("verb", "phase", "code"), said.split(), strict=True))


def few_tokens(plant: RigPlant) -> str:
    return "" if 1 <= len(plant.messages("gateway/fresh", since=5.02)) <= 10 else "too many or none"


ROWS = [
    late("a start by a token of before", by_old("start")),
    late("a start by a token of before the group's stop", by_old("start"), stopped="hall"),
    late("a start by a token of before that is wrong besides", by_old("start", args={"speed": 1})),
    late("a start issued before", issued(2.0)),
    late("a start issued after, by a clock that may be 2 s ahead", issued(0.1)),
    late(
        "a start that was issued before is not saved by a new token",
        lambda plant: issued(2.0, token=plant.token())(plant),  # type: ignore[operator]
    ),
    late("a selection by a token of before", by_old("select", args={"verb": "start"}),
         "select rejected stopped_first"),
    late("a selection of what moves nothing", by_old("select", args={"verb": "reset"}),
         "select confirmed ok"),
    late("the stop of another starter refuses nothing", by_old("start"),
         "start confirmed ok", stopped="fan", pdus=[START]),
    late("a start by a token of after", command("pump/alice/start"), "start confirmed ok",
         pdus=[STOP, START]),
    row(
        "a start by a token of before, while the stop is still under way",
        given=SITE,
        at={5.0: "pump VB01 = 0x5123", 5.5: publish("command/pump/alice/stop"), 7.0: by_old("start")},
        then={7.5: seen("result/pump/alice", verb="start", phase="rejected", code="stopped_first")},
    ),
    *(
        late(
            f"{verb} {args}",
            by_old(verb, args=args),
            f"{verb} {said}",
            pdus=[STOP, *pdus],
        )
        for verb, args, said, *pdus in (
            ("read", {"parameter": "P003"}, "confirmed ok"),
            ("reset", {}, "rejected no_fault_to_reset"),
            ("jog", {"value": False}, "confirmed ok", "05 00 66 00 00"),
            ("general_enable", {"value": False}, "confirmed ok", "05 00 65 00 00"),
            ("jog", {"value": True}, "rejected stopped_first"),
            ("general_enable", {"value": True}, "rejected stopped_first"),
            ("direction", {"value": "reverse"}, "rejected stopped_first"),
            ("local_remote", {"value": "local"}, "rejected stopped_first"),
        )
    ),
    row(
        "every stop has a new token published at once, a flood of stops a few a second",
        given=SITE,
        at={
            4.05: publish("command/pump/alice/stop"),
            5.05: [publish("command/pump/alice/stop")] * 100,
            5.5: lambda plant: plant.publish("command/pump/mallory/stop"),
        },
        then={
            4.3: seen("gateway/fresh", since=4.02, times=1),
            5.4: few_tokens,
            5.9: seen("gateway/fresh", since=5.48, times=0),
        },
    ),
]  # fmt: skip


test_what_was_decided_before_a_stop_moves_nothing = played(ROWS)
