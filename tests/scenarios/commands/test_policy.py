"""What a site demands beyond the starter: rights, start rules, expectations, two steps, locks."""

from __future__ import annotations

import re
from typing import Any

from tests.rig import (
    RigPlant,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    reload,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SSW07, operator, starter, table
from tests.rig.state import with_document
from tests.scenarios.commands import do

SITE = SSW07 + ALICE
BOB = operator("bob", may=("stop", "read"))
TWO = SSW07 + starter("fan", 2, "ssw06") + ALICE
START = "05 00 64 ff 00"


def rules(**keys: Any) -> str:
    return table("[rules]", starters=["*"], **keys)


def by(client: str, verb: str, starter: str = "pump", **fields: Any) -> Action:
    return command(f"{starter}/{client}/{verb}", **fields)


def refused(name: str, said: str, sent: Any, *then: Expectation, given: str = SITE, **before: Any) -> Any:
    """What is sent at 9 s is refused as said, and nothing is written; `at` says what happened before."""
    return row(
        name,
        given=given,
        sim={"pump": QUICK},
        at={**before.get("at", {}), 9.0: sent},
        then={10.0: [result(said), frames("pump", since=9.0), *then]},
    )


def confirmed(name: str, said: str, *then: Expectation, given: str = SITE, **at: Any) -> Any:
    """The last of what happens is confirmed, as said, by 13 s."""
    return row(
        name,
        given=given,
        sim={"pump": QUICK},
        at=at["at"],
        then={13.0: [result(f"{said} confirmed ok"), *then]},
    )


RIGHTS = [
    refused("a verb that the client may not", "start rejected not_allowed", by("bob", "start"),
            seen("result/pump/bob", verb="read", phase="confirmed"), given=SITE + BOB,
            at={3.0: by("bob", "read", args={"parameter": "P314"})}),
    refused("a starter that the client may not command", "start rejected not_allowed", by("carol", "start"),
            frames("fan", "06 13 8b 01 01"), given=TWO + operator("carol", starters=("fan",)),
            at={3.0: by("carol", "start", "fan")}),
    refused("who is no operator may nothing, not even stop", "stop rejected not_allowed",
            [by("mallory", "start"), by("mallory", "stop")],
            results("start rejected not_allowed", "stop rejected not_allowed")),
    refused("a client without the right does not learn whether its arguments are good",
            "set rejected not_allowed", by("bob", "set", args={"nonsense": 1}), given=SITE + BOB),
    refused("without operators the gateway is read-only", "stop rejected not_allowed",
            [by("alice", "start"), by("alice", "stop")], never("result/pump/alice", phase="confirmed"),
            given=SSW07),
    row(
        "one command at a time: a second is busy",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: [do("pump start"), do("pump reset")]},
        then={5.0: [seen("result/pump/alice", verb="reset", code="busy"), frames("pump", START)]},
    ),
]  # fmt: skip

ONE_START = SITE + rules(starts_per_hour=1)
RULES = [
    refused("more starts an hour than the rule allows are refused", "start rejected too_many_starts",
            do("pump start"), frames("pump", START, "05 00 64 00 00"), given=ONE_START,
            at={3.0: do("pump start"), 6.0: do("pump stop")}),
    refused("a start at the keypad counts as well", "start rejected too_many_starts", do("pump start"),
            given=ONE_START, at={3.0: ["pump control local", "pump keypad start"], 6.0: "pump keypad stop",
                                 8.0: "pump control remote"}),
    row(
        "no rule holds up a stop",
        given=SITE + rules(starts_per_hour=1, minimum_pause_s=60, two_step=["start"]),
        at={3.0: [do("pump stop"), do("pump stop")]},
        then={
            6.0: [never("result/pump/alice", phase="rejected"), seen("result/pump/alice", phase="confirmed")]
        },
    ),
]  # fmt: skip


def selected(verb: str = "start", client: str = "alice", **fields: Any) -> Action:
    """A command with the token of the newest selection."""

    def act(plant: RigPlant) -> None:
        found = [each.json["select"] for each in plant.messages("result/+/+") if "select" in each.json]
        plant.command(f"pump/{client}/{verb}", select=found[-1], **fields)

    return act


TWO_STEP = SITE + operator("bob") + operator("victor", may=("stop",)) + rules(two_step=["start"])
SELECT = do("pump select", verb="start")
SELECTED = {"given": TWO_STEP, "at": {7.0: SELECT}}

STEPS = [
    refused("a start of two steps needs its selection", "start rejected select_first", do("pump start"),
            given=TWO_STEP),
    refused("a selected start is carried out, once", "start rejected not_selected", selected(),
            seen("result/pump/alice", phase="confirmed", select=..., valid_s=10.0, state="ready"),
            seen("result/pump/alice", verb="start", phase="confirmed"), frames("pump", START),
            given=TWO_STEP, at={3.0: SELECT, 5.0: selected()}),
    row(
        "a start is selected in local mode where the starter obeys the line there",
        given=TWO_STEP,
        sim={"pump": {**QUICK, "settings": {229: 2}}},
        at={2.0: "pump control local", 4.0: SELECT, 6.0: selected()},
        then={8.0: [result("start confirmed ok"), frames("pump", START)]},
    ),
    row(
        "a selection is valid for 10 s",
        given=TWO_STEP,
        at={3.0: SELECT, 14.0: selected()},
        then={15.0: [result("start rejected selection_expired"), frames("pump")]},
    ),
    refused("a selection is for one verb", "jog rejected selected_otherwise",
            selected("jog", args={"value": True}), **SELECTED),
    refused("a selection is for its arguments", "jog rejected selected_otherwise",
            selected("jog", args={"value": False}), given=TWO_STEP,
            at={7.0: do("pump select", verb="jog", args={"value": True})}),
    refused("a selection is its client's", "start rejected not_selected", selected(client="bob"), **SELECTED),
    refused("a selected starter is not selected by another client", "select rejected selected_by_other",
            by("bob", "select", args={"verb": "start"}),
            msg("result/pump/bob", text=re.compile("wait 8 s")), **SELECTED),
    refused("only who selected can cancel", "cancel rejected not_selected", by("bob", "cancel"), **SELECTED),
    row(
        "a selection ends when the state changes",
        given=TWO_STEP,
        at={2.0: "pump trip E05", 4.0: SELECT, 5.0: "pump clear", 8.0: selected()},
        then={9.0: [result("start rejected state_changed"), frames("pump")]},
    ),
    refused("cancel ends a selection", "start rejected not_selected", selected(),
            seen("result/pump/alice", verb="cancel", phase="confirmed"), given=TWO_STEP,
            at={3.0: SELECT, 4.0: do("pump cancel")}),
    refused("a stop ends a selection", "start rejected not_selected", selected(), given=TWO_STEP,
            at={3.0: SELECT, 4.0: do("pump stop")}),
    confirmed("a repeated selection has the same token", "start", frames("pump", START), given=TWO_STEP,
              at={3.0: [by("alice", "select", id="s", args={"verb": "start"})] * 2, 5.0: selected()}),
    confirmed("a start goes out when the starter is as expected", "start", frames("pump", START),
              at={3.0: by("alice", "start", expect={"state": "ready", "remote": True})}),
    refused("what is not as expected", "start rejected not_as_expected",
            by("alice", "start", expect={"state": "running"})),
    *(refused(f"{wanted} is no expectation", "start rejected bad_expect", by("alice", "start", expect=wanted))
      for wanted in ({"coffee": True}, {"state": "stopped"}, {"state": 1})),
    *(refused(f"{wanted} is not expected alike", "start rejected not_as_expected",
              by("alice", "start", expect=wanted)) for wanted in ({"running": 0}, {"fault_code": False})),
    refused("a locked starter cannot be selected", "select rejected locked", SELECT, given=TWO_STEP,
            at={3.0: do("pump lock", reason="belt")}),
    row(
        "a starter whose state is not known cannot be selected",
        given=TWO_STEP,
        at={3.0: fault("refuse", "pump", 2, (3,)), 15.0: SELECT},
        then={16.0: [msg("starter/pump/state", state="unknown"), result("select rejected state_unknown")]},
    ),
    *(
        refused(f"{client} cannot select with {args}", f"select rejected {code}",
                by(client, "select", args=args), given=TWO_STEP)
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
    ),
]  # fmt: skip

LOCK = do("pump lock", reason="belt is off")
THREE = SITE + operator("bob") + operator("carol", may=("stop", "read"))


def locked(**fields: Any) -> Expectation:
    return msg("starter/pump/state", locked=fields)


LOCKS = [
    refused("a lock lets no start through, and the state says who locked and why", "start rejected locked",
            do("pump start"), locked(by="alice", reason="belt is off"), at={3.0: LOCK}),
    refused("another client cannot take a lock over", "lock rejected locked",
            by("bob", "lock", args={"reason": "mine"}), locked(by="alice", reason="belt is off"),
            given=THREE, at={3.0: LOCK}),
    confirmed("its owner can give a lock another reason", "lock", locked(by="alice", reason="two"),
              at={3.0: LOCK, 5.0: do("pump lock", reason="two")}),
    refused("what is not locked is not unlocked", "unlock rejected not_locked", do("pump unlock")),
    *(
        refused(f"a lock with {fields} of {client}", f"lock rejected {code}", by(client, "lock", **fields),
                msg("starter/pump/state", locked=None), given=THREE)
        for client, fields, code in (
            ("alice", {}, "bad_arguments"),
            ("alice", {"args": {"reason": "  "}}, "bad_arguments"),
            ("alice", {"args": {"reason": 7}}, "bad_arguments"),
            ("alice", {"args": {"reason": "x" * 257}}, "bad_arguments"),
            ("alice", {"args": {"reason": "a\nb"}}, "bad_arguments"),
            ("alice", {"args": {"reason": "x"}, "id": None}, "no_id"),
            ("carol", {"args": {"reason": "x"}}, "not_allowed"),
        )
    ),
    row(
        "while a lock stands stop, read, reset and taking back go through, what moves does not",
        given=SITE,
        at={
            3.0: LOCK,
            4.0: do("pump stop"),
            6.0: do("pump jog", value=False),
            8.0: do("pump general_enable", value=False),
            10.0: [
                do("pump jog", value=True),
                do("pump general_enable", value=True),
                do("pump direction", value="reverse"),
                do("pump local_remote", value="local"),
                do("pump output", output="RL1", value=True),
                do("pump set", parameter="P314", value=9),
            ],
            13.0: do("pump reset"),
        },
        then={
            14.0: [
                seen("result/pump/alice", verb="stop", phase="confirmed"),
                seen("result/pump/alice", verb="jog", phase="confirmed", times=1),
                seen("result/pump/alice", verb="general_enable", phase="confirmed", times=1),
                seen("result/pump/alice", code="locked", times=6),
                result("reset rejected no_fault_to_reset"),
            ]
        },
    ),
    row(
        "the owner of a lock that another client removes gets a result of it",
        given=THREE,
        at={3.0: LOCK, 5.0: by("bob", "unlock")},
        then={
            6.0: [
                seen("result/pump/alice", id=None, code="lock_removed", by="bob"),
                event("unlocked", topic="starter/pump/event"),
                seen("audit", client="bob", verb="unlock", decision="confirmed", before=...),
            ]
        },
    ),
    confirmed("where the locks are not known every starter that can be locked is", "start",
              seen("gateway/event", code="memory_damaged"),
              seen("result/pump/alice", verb="start", phase="rejected", code="locked"),
              seen("starter/pump/state", locked=...),
              at={3.0: "end", 4.0: [with_document("locks", "{"), "start"], 8.0: do("pump start"),
                  9.0: do("pump unlock"), 10.0: do("pump start")}),
    *(
        row(
            f"a motor whose starter was {how} has its pause from then on",
            given=TWO + rules(minimum_pause_s=20),
            sim={"fan": QUICK},
            at={
                30.0: reload(without + rules(minimum_pause_s=20)),
                60.0: reload(TWO + rules(minimum_pause_s=20)),
                66.0: do("fan start"),
                85.0: do("fan start"),
            },
            then={
                67.0: result("start rejected pause_too_short", starter="fan"),
                89.0: result("start confirmed ok", starter="fan"),
            },
        )
        for how, without in (
            ("out of the configuration", SITE),
            ("disabled", SSW07 + starter("fan", 2, "ssw06", enabled=False) + ALICE),
        )
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
]  # fmt: skip


test_what_a_site_demands = played(RIGHTS + RULES + STEPS + LOCKS)
