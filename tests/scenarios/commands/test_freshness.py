"""What dates a command, and what never acts: old, retained, repeated, of an earlier connection or run."""

from __future__ import annotations

import json
import re
from typing import Any

from tests.rig import (
    RigPlant,
    command,
    frames,
    msg,
    never,
    played,
    publish,
    reload,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SSW07, operator
from tests.scenarios.commands import confirmed, issued, old_token

SITE = SSW07 + ALICE
START = "05 00 64 ff 00"
RETAINED = json.dumps({"id": "retained"})


def boot(path: str, *, of_s: float = 0.0, **fields: object) -> Action:
    """A command with the `boot` of the first status after that second."""

    def act(plant: RigPlant) -> None:
        plant.command(path, boot=plant.messages("gateway/status", since=of_s)[0].json["boot"], **fields)

    return act


def twice(**properties: object) -> Action:
    """The same start again: the same id, a fresh token."""
    return command("pump/alice/start", id="one", **properties)


def case(name: str, said: str, at: dict[float, Any], *then: Expectation, given: str = SITE) -> Any:
    """The newest result is as said a second after what happened last, four where that is confirmed."""
    until_s = max(at) + (4.0 if said.endswith("ok") else 1.0)
    return row(name, given=given, sim={"pump": QUICK}, at=at, then={until_s: [result(said), *then]})


NOTHING, ONCE = frames("pump"), frames("pump", START)


def again(client: str = "alice", **fields: object) -> Expectation:
    return msg(f"result/pump/{client}", id="one", duplicate=True, **fields)


PROOFS = [
    case("boot alone proves nothing", "start rejected not_fresh",
         {9.0: boot("pump/alice/start", fresh=False)}, NOTHING),
    case("the present boot does no harm beside a token", "start confirmed ok",
         {9.0: boot("pump/alice/start")}, results(*confirmed("start")), ONCE),
    case("another boot is refused whatever is beside it", "start rejected wrong_boot",
         {9.0: command("pump/alice/start", boot="b-1")}, NOTHING),
    case("after a reconnect a token of the old connection proves nothing", "start rejected not_fresh",
         {5.5: "broker drops", 8.0: old_token("pump/alice/start", of_s=4.0)}, NOTHING),
    case("after a reconnect a new token proves a command fresh", "start confirmed ok",
         {5.5: "broker drops", 8.0: command("pump/alice/start")}, ONCE),
]  # fmt: skip


NEVER = [
    case("an id that was used gets its stored result again, and nothing is written", "start confirmed ok",
         {3.0: twice(), 6.0: twice()}, results(*confirmed("start"), "start confirmed ok"), again(), ONCE,
         seen("audit", decision="duplicate", times=1)),
    case("a refused id stays refused when the cause has gone", "start rejected in_local",
         {3.0: "pump control local", 5.0: twice(), 6.0: "pump control remote", 8.0: twice()},
         again(text=re.compile("id stays refused")), NOTHING),
    case("an id that stood for another command is refused", "reset rejected id_reused",
         {3.0: twice(), 6.0: command("pump/alice/reset", id="one")}, ONCE),
    case("one id sent a hundred times has one end", "start confirmed ok",
         {3.0: [twice()] * 50, 3.05: [twice()] * 20, 3.2: [twice()] * 20, 5.0: twice()},
         seen("result/pump/alice", phase="confirmed", duplicate=False, times=1),
         never("result/pump/alice", phase="rejected", duplicate=False), ONCE),
    case("the same id of another client is another command", "start confirmed ok",
         {3.0: twice(), 6.0: command("pump/bob/stop"), 9.0: command("pump/bob/start", id="one")},
         msg("result/pump/bob", id="one", phase="confirmed", duplicate=False), given=SITE + operator("bob")),
    case("a late copy of a command gets its result, not that it is late", "start confirmed ok",
         {3.0: twice(), 10.0: old_token("pump/alice/start", of_s=2.0, id="one")}, again(), ONCE),
    case("the id of a command in bad form is used up as well", "start rejected bad_payload",
         {3.0: twice(speed=3), 5.0: twice()}, again(), NOTHING),
    case("an issued_at of the future is not taken later either", "start rejected not_fresh",
         {3.0: issued(-4.0, id="one"), 7.5: issued(0.5, id="one")}, again(), NOTHING),
    case("a client that has lost its right still gets the result of its command", "start confirmed ok",
         {3.0: twice(), 6.0: reload(SSW07 + operator("bob")), 9.0: twice()}, again(), ONCE),
    case("a start's id is its own also after a stop with the same id", "start confirmed ok",
         {3.0: twice(), 6.0: command("pump/alice/stop", id="one"), 9.0: twice()}, again(verb="start"),
         frames("pump", START, "05 00 64 00 00")),
    case("and after a crash", "start confirmed ok",
         {3.0: twice(), 6.0: command("pump/alice/stop", id="one"), 10.0: ["kill", "start"], 14.0: twice()},
         again(verb="start"), frames("pump", START, "05 00 64 00 00")),
    case("a start while a stop is under way is busy", "start rejected busy",
         {2.0: "pump VB01 = 0x5123", 3.0: publish("command/pump/alice/stop"),
          4.5: command("pump/alice/start")},
         never("audit", verb="start", code="ok")),
    case("a retained start is refused, live or not", "start rejected retained",
         {3.0: publish("command/pump/alice/start", RETAINED, retain=True)}, NOTHING),
    row(
        "a retained start does not act on a later connection, nor in a later run",
        given=SITE,
        at={3.0: publish("command/pump/alice/start", RETAINED, retain=True), 5.0: "broker drops",
            9.0: "restart"},
        then={14.0: [never("result/pump/alice", id="retained", code="ok"), NOTHING]},
    ),
]  # fmt: skip


test_every_command_but_stop_and_read_is_provably_fresh = played(PROOFS)
test_what_is_old_or_repeated_does_not_act = played(NEVER)
