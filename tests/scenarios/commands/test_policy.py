"""What a site demands beyond the starter: rights, start rules, expectations, two steps, locks, groups."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    play,
    reload,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action
from tests.rig.sites import ALICE, QUICK, SSW07, operator, starter, table
from tests.rig.state import with_document
from tests.scenarios.commands import do

SITE = SSW07 + ALICE
BOB = operator("bob", may=("stop", "read"))
TWO = SSW07 + starter("fan", 2, "ssw06") + ALICE
START = "05 00 64 ff 00"
BOTH = {"pump": QUICK, "fan": QUICK}


def rules(**keys: Any) -> str:
    return table("[rules]", starters=["*"], **keys)


RIGHTS = [
    row(
        "a verb that the client may not is refused",
        given=SITE + BOB,
        at={3.0: [command("pump/bob/start"), command("pump/bob/read", args={"parameter": "P314"})]},
        then={
            4.0: [
                seen("result/pump/bob", verb="start", code="not_allowed"),
                frames("pump"),
                seen("result/pump/bob", verb="read", phase="confirmed"),
            ]
        },
    ),
    row(
        "a starter that the client may not command is refused",
        given=TWO + operator("carol", starters=("fan",)),
        sim=BOTH,
        at={3.0: [command("pump/carol/start"), command("fan/carol/start")]},
        then={
            5.0: [
                seen("result/pump/carol", code="not_allowed"),
                frames("pump"),
                frames("fan", "06 13 8b 01 01"),
            ]
        },
    ),
    row(
        "who is no operator may nothing, not even stop",
        given=SITE,
        at={3.0: [command("pump/mallory/start"), command("pump/mallory/stop")]},
        then={5.0: [results("start rejected not_allowed", "stop rejected not_allowed"), frames("pump")]},
    ),
    row(
        "a client without the right does not learn whether its arguments are good",
        given=SITE + BOB,
        at={3.0: command("pump/bob/set", args={"nonsense": 1})},
        then={4.0: results("set rejected not_allowed")},
    ),
    row(
        "without operators the gateway is read-only",
        given=SSW07,
        at={3.0: [command("pump/alice/start"), command("pump/alice/stop")]},
        then={5.0: [never("result/pump/alice", phase="confirmed"), frames("pump")]},
    ),
    row(
        "one command at a time: a second is busy",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: [command("pump/alice/start"), command("pump/alice/reset")]},
        then={5.0: [seen("result/pump/alice", verb="reset", code="busy"), frames("pump", START)]},
    ),
]

RULES = [
    row(
        "more starts an hour than the rule allows are refused, an hour later they pass",
        given=SITE + rules(starts_per_hour=1),
        sim={"pump": QUICK},
        at={3.0: do("pump start"), 6.0: do("pump stop"), 9.0: do("pump start")},
        then={10.0: [result("start rejected too_many_starts"), frames("pump", START, "05 00 64 00 00")]},
    ),
    row(
        "a start at the keypad counts as well",
        given=SITE + rules(starts_per_hour=1),
        sim={"pump": QUICK},
        at={
            3.0: ["pump control local", "pump keypad start"],
            6.0: "pump keypad stop",
            8.0: "pump control remote",
            10.0: do("pump start"),
        },
        then={11.0: [result("start rejected too_many_starts"), frames("pump")]},
    ),
    row(
        "no rule holds up a stop",
        given=SITE + rules(starts_per_hour=1, minimum_pause_s=60, two_step=["start"]),
        at={3.0: [do("pump stop"), do("pump stop")]},
        then={
            6.0: [never("result/pump/alice", phase="rejected"), seen("result/pump/alice", phase="confirmed")]
        },
    ),
]


def selected(path: str, **fields: Any) -> Action:
    """A command with the token of the newest selection."""

    def act(plant: RigPlant) -> None:
        found = [each.json["select"] for each in plant.messages("result/+/+") if "select" in each.json]
        plant.command(path, select=found[-1], **fields)

    return act


TWO_STEP = SITE + operator("bob") + rules(two_step=["start"])
SELECT = do("pump select", verb="start")

STEPS = [
    row(
        "a start of two steps needs its selection",
        given=TWO_STEP,
        at={3.0: do("pump start")},
        then={4.0: [results("start rejected select_first"), frames("pump")]},
    ),
    row(
        "a selected start is carried out, once",
        given=TWO_STEP,
        sim={"pump": QUICK},
        at={3.0: SELECT, 5.0: selected("pump/alice/start"), 8.0: selected("pump/alice/start")},
        then={
            4.0: msg("result/pump/alice", phase="confirmed", select=..., valid_s=10.0, state="ready"),
            7.0: [result("start confirmed ok"), frames("pump", START)],
            9.0: result("start rejected not_selected"),
        },
    ),
    row(
        "a start is selected in local mode where the starter obeys the line there",
        given=TWO_STEP,
        sim={"pump": {**QUICK, "settings": {229: 2}}},
        at={2.0: "pump control local", 4.0: SELECT, 6.0: selected("pump/alice/start")},
        then={8.0: [result("start confirmed ok"), frames("pump", START)]},
    ),
    row(
        "a selection is valid for 10 s",
        given=TWO_STEP,
        at={3.0: SELECT, 14.0: selected("pump/alice/start")},
        then={15.0: [result("start rejected selection_expired"), frames("pump")]},
    ),
    row(
        "a selection is for one verb",
        given=TWO_STEP,
        at={3.0: do("pump select", verb="start"), 5.0: selected("pump/alice/jog", args={"value": True})},
        then={6.0: [result("jog rejected selected_otherwise"), frames("pump")]},
    ),
    row(
        "a selection is its client's",
        given=TWO_STEP,
        at={
            3.0: SELECT,
            5.0: selected("pump/bob/start"),
            6.0: command("pump/bob/select", args={"verb": "start"}),
        },
        then={
            5.5: [result("start rejected not_selected"), frames("pump")],
            7.0: [
                result("select rejected selected_by_other"),
                msg("result/pump/bob", text=re.compile("wait 7 s")),
            ],
        },
    ),
    row(
        "a selection ends when the state changes",
        given=TWO_STEP,
        at={2.0: "pump trip E05", 4.0: SELECT, 5.0: "pump clear", 8.0: selected("pump/alice/start")},
        then={9.0: [result("start rejected state_changed"), frames("pump")]},
    ),
    row(
        "cancel ends a selection",
        given=TWO_STEP,
        at={3.0: SELECT, 4.0: do("pump cancel"), 5.0: selected("pump/alice/start")},
        then={
            6.0: [
                seen("result/pump/alice", verb="cancel", phase="confirmed"),
                frames("pump"),
                result("start rejected not_selected"),
            ]
        },
    ),
    row(
        "a stop ends a selection",
        given=TWO_STEP,
        at={3.0: SELECT, 4.0: do("pump stop"), 6.0: selected("pump/alice/start")},
        then={7.0: [result("start rejected not_selected"), frames("pump", "05 00 64 00 00")]},
    ),
    row(
        "a start goes out when the starter is as expected",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start", expect={"state": "ready", "remote": True})},
        then={6.0: [result("start confirmed ok"), frames("pump", START)]},
    ),
    row(
        "what is not as expected is refused",
        given=SITE,
        at={3.0: command("pump/alice/start", expect={"state": "running"})},
        then={5.0: [result("start rejected not_as_expected"), frames("pump")]},
    ),
    row(
        "an expectation of a point that there is not is refused",
        given=SITE,
        at={3.0: command("pump/alice/start", expect={"coffee": True})},
        then={5.0: [result("start rejected bad_expect"), frames("pump")]},
    ),
]


CANNOT_SELECT = [
    row(
        f"{client} cannot select with {args}",
        given=TWO_STEP + operator("victor", may=("stop",)),
        at={3.0: command(f"pump/{client}/select", args=args)},
        then={4.0: results(f"select rejected {code}", client=client)},
    )
    for client, args, code in (
        ("alice", {}, "bad_arguments"),
        ("alice", {"verb": "fly"}, "bad_arguments"),
        ("alice", {"verb": "stop"}, "bad_arguments"),
        ("alice", {"verb": "lock"}, "bad_arguments"),
        ("alice", {"verb": "start", "args": []}, "bad_arguments"),
        ("alice", {"verb": "start", "now": 1}, "bad_arguments"),
        ("alice", {"verb": "start", "args": {"x": 1}}, "bad_arguments"),
        ("victor", {"verb": "start"}, "not_allowed"),
        ("mallory", {"verb": "start"}, "not_allowed"),
    )
] + [
    row(
        "a locked starter cannot be selected",
        given=TWO_STEP,
        at={3.0: do("pump lock", reason="belt"), 4.0: SELECT},
        then={5.0: result("select rejected locked")},
    ),
    row(
        "a starter whose state is not known cannot be selected",
        given=TWO_STEP,
        at={3.0: fault("refuse", "pump", 2, (3,)), 15.0: SELECT},
        then={16.0: [msg("starter/pump/state", state="unknown"), result("select rejected state_unknown")]},
    ),
    row(
        "only who selected can cancel",
        given=TWO_STEP,
        at={3.0: SELECT, 4.0: command("pump/bob/cancel"), 5.0: selected("pump/alice/start")},
        then={4.5: result("cancel rejected not_selected"), 8.0: result("start confirmed ok")},
    ),
    row(
        "a repeated selection has the same token",
        given=TWO_STEP,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/select", id="s", args={"verb": "start"}),
            4.0: command("pump/alice/select", id="s", args={"verb": "start"}),
            5.0: selected("pump/alice/start"),
        },
        then={8.0: [msg("result/pump/alice", phase="confirmed", verb="start"), frames("pump", START)]},
    ),
]

LOCK = do("pump lock", reason="belt is off")
LOCKS = [
    row(
        "a lock lets no start through, and the state says who locked and why",
        given=SITE,
        at={3.0: LOCK, 5.0: do("pump start")},
        then={
            6.0: [
                result("start rejected locked"),
                frames("pump"),
                msg("starter/pump/state", locked={"by": "alice", "reason": "belt is off"}),
            ]
        },
    ),
    row(
        "while a lock stands stop, read, reset and taking back go through, what moves does not",
        given=SITE,
        at={
            3.0: LOCK,
            4.0: do("pump stop"),
            6.0: do("pump jog", value=False),
            8.0: do("pump general_enable", value=False),
            10.0: do("pump jog", value=True),
            11.0: do("pump general_enable", value=True),
            12.0: do("pump set", parameter="P314", value=9),
            13.0: do("pump reset"),
        },
        then={
            14.0: [
                seen("result/pump/alice", verb="stop", phase="confirmed"),
                seen("result/pump/alice", verb="jog", phase="confirmed", times=1),
                seen("result/pump/alice", verb="general_enable", phase="confirmed", times=1),
                seen("result/pump/alice", code="locked", times=3),
                result("reset rejected no_fault_to_reset"),
            ]
        },
    ),
    row(
        "the owner of a lock that another client removes gets a result of it",
        given=SITE + operator("bob"),
        at={3.0: LOCK, 5.0: command("pump/bob/unlock")},
        then={
            6.0: [
                seen("result/pump/alice", id=None, code="lock_removed", by="bob"),
                event("unlocked", topic="starter/pump/event"),
                seen("audit", client="bob", verb="unlock", decision="confirmed", before=...),
            ]
        },
    ),
    row(
        "what is not locked is not unlocked",
        given=SITE,
        at={3.0: do("pump unlock")},
        then={4.0: result("unlock rejected not_locked")},
    ),
    row(
        "a lock needs a reason, the right and an id",
        given=SITE + BOB,
        at={
            3.0: do("pump lock"),
            4.0: command("pump/bob/lock", args={"reason": "x"}),
            5.0: command("pump/alice/lock", id=None, args={"reason": "x"}),
        },
        then={
            6.0: [
                results("lock rejected bad_arguments", "lock rejected no_id", client="alice"),
                results("lock rejected not_allowed", client="bob"),
                msg("starter/pump/state", locked=None),
            ]
        },
    ),
    row(
        "another client cannot take a lock over, its owner can give another reason",
        given=SITE + operator("bob"),
        at={
            3.0: LOCK,
            4.0: command("pump/bob/lock", args={"reason": "mine"}),
            5.0: do("pump lock", reason="two"),
        },
        then={
            4.5: result("lock rejected locked", client="bob"),
            6.0: msg("starter/pump/state", locked={"by": "alice", "reason": "two"}),
        },
    ),
    row(
        "where the locks are not known every starter that can be locked is",
        given=SITE,
        sim={"pump": QUICK},
        at={
            3.0: "end",
            4.0: [with_document("locks", "{"), "start"],
            8.0: do("pump start"),
            9.0: do("pump unlock"),
            10.0: do("pump start"),
        },
        then={
            8.5: [
                event("memory_damaged"),
                result("start rejected locked"),
                msg("starter/pump/state", locked={"by": "gateway"}),
            ],
            13.0: result("start confirmed ok"),
        },
    ),
    row(
        "a command under way ends by the rules and rights it came under, the next is judged by the new ones",
        given=SITE,
        sim={"pump": QUICK},
        at={
            3.0: [
                do("pump start"),
                reload(SSW07 + operator("alice", may=("stop", "start")) + rules(starts_per_hour=1)),
            ],
            7.0: [do("pump read", parameter="P314"), do("pump stop")],
            10.0: do("pump start"),
        },
        then={
            6.0: [event("reloaded"), result("start confirmed ok")],
            9.0: seen("result/pump/alice", verb="read", code="not_allowed"),
            11.0: result("start rejected too_many_starts"),
        },
    ),
]


@pytest.mark.parametrize("row", RIGHTS + RULES + STEPS + CANNOT_SELECT + LOCKS)
def test_what_a_site_demands(row: ScenarioRow) -> None:
    play(row)
