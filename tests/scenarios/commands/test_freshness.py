"""What dates a command, and what never acts: old, retained, repeated, of an earlier connection or run."""

from __future__ import annotations

import json
import re

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    command,
    frames,
    msg,
    never,
    play,
    publish,
    reload,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action
from tests.rig.sites import ALICE, QUICK, SSW07, operator
from tests.scenarios.commands import confirmed, issued, old_token

SITE = SSW07 + ALICE
START = "05 00 64 ff 00"


def boot(path: str, *, of_s: float = 0.0, **fields: object) -> Action:
    """A command with the `boot` of the first status after that second."""

    def act(plant: RigPlant) -> None:
        plant.command(path, boot=plant.messages("gateway/status", since=of_s)[0].json["boot"], **fields)

    return act


def refuses(name: str, code: str, *sent: Action, given: str = SITE, at_s: float = 9.0) -> object:
    return row(
        name,
        given=given,
        at={at_s: sent},
        then={at_s + 1.0: [result(f"start rejected {code}"), frames("pump")]},
    )


def acts(name: str, *sent: Action, given: str = SITE, at_s: float = 9.0) -> object:
    return row(
        name,
        given=given,
        sim={"pump": QUICK},
        at={at_s: sent},
        then={at_s + 3.0: [results(*confirmed("start")), frames("pump", START)]},
    )


PROOFS = [
    refuses("boot alone proves nothing", "not_fresh", boot("pump/alice/start", fresh=False)),
    acts("the present boot does no harm beside a token", boot("pump/alice/start")),
    refuses(
        "another boot is refused whatever is beside it", "wrong_boot", command("pump/alice/start", boot="b-1")
    ),
    row(
        "after a reconnect a token of the old connection proves nothing, a new one does",
        given=SITE,
        sim={"pump": QUICK},
        at={
            5.5: "broker drops",
            8.0: old_token("pump/alice/start", of_s=4.0),
            9.0: command("pump/alice/start"),
        },
        then={8.5: [result("start rejected not_fresh"), frames("pump")], 12.0: result("start confirmed ok")},
    ),
]


def twice(**properties: object) -> Action:
    """The same start again: the same id, a fresh token."""
    return command("pump/alice/start", id="one", **properties)


NEVER = [
    row(
        "an id that was used gets its stored result again, and nothing is written",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: twice(), 6.0: twice()},
        then={
            7.0: [
                results(*confirmed("start"), "start confirmed ok"),
                msg("result/pump/alice", id="one", duplicate=True),
                frames("pump", START),
                seen("audit", decision="duplicate", times=1),
            ]
        },
    ),
    row(
        "a refused id stays refused when the cause has gone",
        given=SITE,
        at={3.0: "pump control local", 5.0: twice(), 6.0: "pump control remote", 8.0: twice()},
        then={
            9.0: [
                msg(
                    "result/pump/alice", code="in_local", duplicate=True, text=re.compile("id stays refused")
                ),
                frames("pump"),
            ]
        },
    ),
    row(
        "an id that stood for another command is refused",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: twice(), 6.0: command("pump/alice/reset", id="one")},
        then={7.0: [result("reset rejected id_reused"), frames("pump", START)]},
    ),
    row(
        "one id sent three hundred times has one end",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: [twice()] * 50, 3.05: [twice()] * 20, 3.2: [twice()] * 20, 5.0: twice()},
        then={
            6.0: [
                seen("result/pump/alice", phase="confirmed", duplicate=False, times=1),
                never("result/pump/alice", phase="rejected", duplicate=False),
                frames("pump", START),
            ]
        },
    ),
    row(
        "the same id of another client is another command",
        given=SITE + operator("bob"),
        sim={"pump": QUICK},
        at={3.0: twice(), 6.0: command("pump/bob/stop"), 9.0: command("pump/bob/start", id="one")},
        then={12.0: [msg("result/pump/bob", id="one", phase="confirmed", duplicate=False)]},
    ),
    row(
        "a late copy of a command gets its result, not that it is late",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: twice(), 10.0: old_token("pump/alice/start", of_s=2.0, id="one")},
        then={11.0: [msg("result/pump/alice", phase="confirmed", duplicate=True), frames("pump", START)]},
    ),
    row(
        "a command in bad form leaves its id free for one in good form",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: twice(speed=3), 5.0: twice()},
        then={
            4.0: result("start rejected bad_payload"),
            8.0: [result("start confirmed ok"), frames("pump", START)],
        },
    ),
    row(
        "an issued_at of the future is not taken later either",
        given=SITE,
        at={3.0: issued(-4.0, id="one"), 7.5: issued(0.5, id="one")},
        then={8.0: [msg("result/pump/alice", code="not_fresh", duplicate=True), frames("pump")]},
    ),
    row(
        "a client that has lost its right still gets the result of its command",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: twice(), 6.0: reload(SSW07 + operator("bob")), 9.0: twice()},
        then={10.0: [msg("result/pump/alice", phase="confirmed", duplicate=True), frames("pump", START)]},
    ),
    row(
        "a start's id is its own also after a stop with the same id",
        given=SITE,
        sim={"pump": QUICK},
        at={
            3.0: twice(),
            6.0: command("pump/alice/stop", id="one"),
            9.0: twice(),
            10.0: ["kill", "start"],
            14.0: twice(),
        },
        then={
            9.9: msg("result/pump/alice", verb="start", phase="confirmed", duplicate=True),
            15.0: [
                msg("result/pump/alice", verb="start", phase="confirmed", duplicate=True),
                frames("pump", START, "05 00 64 00 00"),
            ],
        },
    ),
    row(
        "a start while a stop is under way is busy",
        given=SITE,
        at={
            2.0: "pump VB01 = 0x5123",
            3.0: publish("command/pump/alice/stop"),
            4.5: command("pump/alice/start"),
        },
        then={
            5.0: [
                seen("result/pump/alice", verb="start", code="busy"),
                never("audit", verb="start", code="ok"),
            ]
        },
    ),
    row(
        "a retained start is refused, live or not",
        given=SITE,
        at={
            3.0: publish("command/pump/alice/start", json.dumps({"id": "retained"}), retain=True),
            5.0: "broker drops",
            9.0: "restart",
        },
        then={
            4.0: result("start rejected retained"),
            14.0: [never("result/pump/alice", id="retained", code="ok"), frames("pump")],
        },
    ),
    row(
        "commands that came while the gateway was away are not acted on",
        given=SITE,
        at={
            4.0: "end",
            5.0: [command("pump/alice/start"), publish("command/pump/alice/stop")],
            6.0: "start",
        },
        then={12.0: frames("pump")},
    ),
]


@pytest.mark.parametrize("row", PROOFS)
def test_every_command_but_stop_and_read_is_provably_fresh(row: ScenarioRow) -> None:
    play(row)


@pytest.mark.parametrize("row", NEVER)
def test_what_is_old_or_repeated_does_not_act(row: ScenarioRow) -> None:
    play(row)
