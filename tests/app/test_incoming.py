"""What comes in, and what of it is taken after the gateway has stood still."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.mqtt.connection.inbox import Inbox
from gateway.mqtt.contract.commands import RETAINED_STOP, Incoming
from gateway.mqtt.contract.payloads import Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.records import AuditRecord, ResultRecord, Severity, rfc3339
from tests.app.desk import desk
from tests.starters.rig import virtually
from tests.virtual_time import VirtualTimeLoop, run_virtually


@pytest.mark.parametrize(("asleep_s", "code"), [(0.0, "before_connection"), (3600.0, "expired")])
@virtually
async def test_what_waited_while_the_gateway_stood_still_is_refused(asleep_s: float, code: str) -> None:
    here = await desk()
    boot, token, issued_at = here.boot.token, here.token(), rfc3339(here.plant.clock.utc_s())
    await asyncio.sleep(3.0 if not asleep_s else 0.01)
    here.asleep_s = asleep_s  # with the machine: the steady clock does not count that
    here.plant.clock.epoch_s += asleep_s

    here.take("start", "1", boot=boot)
    here.take("start", "2", issued_at=issued_at, ttl_s=60)
    here.take("start", "3", boot=boot, issued_at=issued_at, ttl_s=60)
    here.take("start", "4", token=token, ttl_s=60)
    here.take("read", "5", boot=boot)
    await asyncio.sleep(3.0)

    codes = {id_: here.plant.sink.final(id_).code for id_ in "12345"}
    assert codes == {"1": "wrong_boot", "2": code, "3": "wrong_boot", "4": "not_fresh", "5": "wrong_boot"}
    assert here.plant.starts() == 0
    assert here.tokens == [here.boot.token] != [boot]
    assert [(code, severity) for code, severity, *_ in here.events] == [("stood_still", Severity.WARNING)]


@virtually
async def test_a_live_stop_with_the_retain_flag_stops_and_its_result_says_that_others_are_refused() -> None:
    here = await desk()
    here.plant.machines["pump-1"].set_motor(is_on=True)

    here.incoming.take(Incoming("b/command/pump-1/alice/stop", b'{"id":"1"}', is_retained=True, is_live=True))
    await here.plant.wait(3.0)
    here.incoming.take(Incoming("b/command/pump-1/alice/stop", b'{"id":"2"}', is_retained=True))
    await here.plant.wait(3.0)

    assert here.plant.stops() == 1
    final = here.plant.sink.final("1")
    assert (final.phase, final.code) == ("confirmed", "ok")
    assert final.text.endswith(f"; {RETAINED_STOP}")
    assert here.plant.sink.final("2").code == "retained"


@virtually
async def test_a_stop_that_waited_stops_all_the_same() -> None:
    here = await desk()
    here.plant.machines["pump-1"].set_motor(is_on=True)
    await asyncio.sleep(30.0)

    here.take("stop", "1")
    await here.plant.wait(3.0)

    assert here.plant.stops() == 1


@virtually
async def test_after_a_suspension_the_new_token_and_what_is_issued_from_then_on_are_fresh() -> None:
    here = await desk()
    await asyncio.sleep(3.0)
    here.take("read", "old", boot="run")

    here.take("start", "1", token=here.token())
    await here.plant.wait(3.0)
    here.take("stop", "2")
    await here.plant.wait(3.0)
    for look in range(2):  # more often than what counts as a suspension
        here.take("read", f"look-{look}", boot="run")
        await here.plant.wait(1.5)
    here.take("start", "3", issued_at=rfc3339(here.plant.clock.utc_s()))
    await here.plant.wait(3.0)

    assert [here.plant.sink.final(id_).code for id_ in "123"] == ["ok", "ok", "ok"]


@pytest.mark.parametrize("step_s", [-20.0, 20.0])
@virtually
async def test_a_clock_that_was_set_makes_no_old_command_fresh(step_s: float) -> None:
    here = await desk()
    true_utc_s = here.plant.clock.utc_s()
    here.plant.clock.epoch_s += step_s

    here.take("start", "late", issued_at=rfc3339(true_utc_s - 20.0))
    here.take("start", "now", issued_at=rfc3339(true_utc_s))
    before = here.plant.starts()
    here.take("start", "by token", token=here.token())
    await here.plant.wait(3.0)

    late, now = here.plant.sink.final("late"), here.plant.sink.final("now")
    by = "back" if step_s < 0 else "ahead"
    assert (before, here.plant.starts()) == (0, 1)
    assert late.code == now.code == "not_fresh"
    assert late.text.startswith(f"this gateway's clock was set {by} by 20.0 s, so issued_at does not count")
    assert here.plant.sink.final("by token").code == "ok"


@virtually
async def test_the_boot_alone_starts_nothing_and_a_read_needs_no_proof() -> None:
    here = await desk()

    here.take("start", "1", boot="run")
    here.take("read", "2", args={"parameter": "P003"})
    await here.plant.wait(3.0)

    assert [here.plant.sink.final(id_).code for id_ in "12"] == ["not_fresh", "ok"]


@virtually
async def test_a_step_of_the_clock_is_published_and_so_is_that_it_counts_again() -> None:
    here = await desk()
    looking = asyncio.create_task(here.incoming.run())

    here.plant.clock.epoch_s -= 20.0
    await asyncio.sleep(55.0)
    stepped = [(code, severity) for code, severity, *_ in here.events]
    await asyncio.sleep(10.0)
    looking.cancel()

    assert stepped == [("clock_stepped", Severity.WARNING)]
    assert here.events[0][2].startswith(
        "this gateway's clock was set back by 20.0 s: issued_at does not count"
    )
    assert [code for code, *_ in here.events] == ["clock_stepped", "clock_trusted"]


@virtually
async def test_a_start_whose_token_is_old_when_it_comes_expires_within_the_gateway_as_well() -> None:
    here = await desk()
    token = here.token()
    await asyncio.sleep(1.5)
    verdicts: list[float | None] = []
    here.plant.dispatcher.submit = lambda request: verdicts.append(request.expires_s)  # type: ignore[method-assign]

    here.take("start", "1", token=token)

    assert verdicts == [pytest.approx(here.plant.clock.now_s() - 1.5 + 5.0)]


@virtually
async def test_without_a_suspension_the_token_stays_what_it_is() -> None:
    here = await desk()
    for number in range(100):
        await asyncio.sleep(0.5)
        here.take("read", f"{number}", boot="run", args={"parameter": "P003"})

    assert here.boot.token == "run"
    assert here.events == []


@virtually
async def test_what_is_no_command_topic_is_nobodys() -> None:
    here = await desk()

    here.incoming.take(Incoming("b/result/pump-1/alice", b""))
    here.incoming.take(Incoming("b/command/pump-1/alice/start", b"no JSON"))
    await asyncio.sleep(1.0)

    assert [each.code for each in here.plant.sink.of(ResultRecord)] == ["bad_json"]
    assert here.events == []


@virtually
async def test_a_command_under_way_learns_of_a_suspension_that_was_not_noticed_yet() -> None:
    here = await desk()
    before_s = here.standstill.ended_s()
    await asyncio.sleep(0.01)
    here.asleep_s = 3600.0

    assert here.standstill.ended_s() == here.plant.clock.now_s() > before_s
    assert [event[0] for event in here.events] == ["stood_still"]


@pytest.mark.parametrize(
    ("topic", "result", "problem"),
    [
        ("pump-1/alice/STOP", ("pump-1", "alice", "STOP", "malformed_topic"), "level_misspelt"),
        ("PUMP-1/alice/stop", ("pump-1", "alice", "stop", "malformed_topic"), "level_misspelt"),
        ("pump-1/alice/stop/", ("pump-1", "alice", "stop/", "malformed_topic"), "level_empty"),
        ("pump-1/alice/stpo", ("pump-1", "alice", "stpo", "unknown_verb"), "unknown_verb"),
        ("pump-1/stop", None, "level_missing"),
        ("pump-1//stop", None, "level_empty"),
        ("pump-1/ALICE/stop", None, "level_misspelt"),
    ],
)
@pytest.mark.parametrize("is_retained", [False, True])
@virtually
async def test_a_mistyped_command_topic_is_answered_and_does_nothing(
    topic: str, result: tuple[str, str, str, str] | None, problem: str, is_retained: bool
) -> None:
    here = await desk()
    here.plant.machines["pump-1"].set_motor(is_on=True)
    here.plant.sink.clear()

    here.incoming.take(Incoming(f"b/command/{topic}", b"", is_retained=is_retained))
    await here.plant.wait(3.0)

    reported = [(r.starter, r.client, r.verb, r.code) for r in here.plant.sink.of(ResultRecord)]
    assert reported == ([] if result is None else [result])
    (audit,) = here.plant.sink.of(AuditRecord)
    assert (audit.decision, audit.code) == ("rejected", result[3] if result else "malformed_topic")
    ((code, severity, text, data),) = here.events
    assert (code, severity) == ("malformed_topic", Severity.WARNING)
    assert data == {"problem": problem, "topic": f"b/command/{topic}", "count": 1}
    assert topic in text
    assert here.plant.stops() == 0


@virtually
async def test_a_flood_of_mistyped_topics_is_counted_and_one_event_a_second_published_of_each_kind() -> None:
    here = await desk()
    for number in range(3000):
        here.incoming.take(Incoming(f"b/command/pump-1/{'x' * 900}é{number}", b"x" * 4000))
        here.incoming.take(Incoming("b/command/pump-1/alice/STOP", b""))
        await asyncio.sleep(0.001)
    await asyncio.sleep(2.0)

    for problem in ("level_missing", "level_misspelt"):
        events = [event for event in here.events if event[3]["problem"] == problem]
        assert 3 <= len(events) <= 5
        assert sum(event[3]["count"] for event in events) == 3000
        assert all(len(event[2]) < 500 for event in events)
    results = here.plant.sink.of(ResultRecord)
    assert len(results) < 200
    assert len(here.plant.sink.of(AuditRecord)) < 300
    assert all(result.starter and result.client for result in results)


ODD = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**25), 10**25)
    | st.floats()
    | st.text(st.characters(), max_size=20)
    | st.sampled_from(["\ud800", "P314", "a\udfff", "\x00", "1", "run"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["parameter", "value", "reason", "verb", "args", "state", "\ud800"])
            | st.text(max_size=5),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)
BODIES = st.fixed_dictionaries(
    {},
    optional={
        "id": st.text(st.characters(), max_size=70) | ODD,
        "boot": st.just("run") | ODD,
        "issued_at": ODD,
        "ttl_s": ODD,
        "operator": ODD,
        "reason": ODD,
        "args": ODD,
        "expect": ODD,
        "select": ODD,
    },
)
PAYLOADS = st.binary(max_size=60) | BODIES.map(lambda body: json.dumps(body).encode())
TOPICS = st.sampled_from(
    [
        f"pump-1/alice/{verb}"
        for verb in ("start", "stop", "set", "read", "select", "lock", "unlock", "STOP", "x")
    ]
) | st.text(st.characters(exclude_categories=["Cs"]), max_size=40)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(TOPICS, PAYLOADS, st.booleans()), max_size=12))
def test_no_payload_and_no_topic_raises_and_everything_reported_can_be_published_and_stored(
    messages: list[tuple[str, bytes, bool]],
) -> None:
    async def run() -> None:
        here = await desk()
        asyncio.get_running_loop().set_exception_handler(lambda _, context: pytest.fail(str(context)))
        for topic, payload, is_retained in messages:
            here.incoming.take(Incoming(f"b/command/{topic}", payload, is_retained=is_retained))
            await asyncio.sleep(0.5)
        await here.plant.wait(5.0)
        payloads = Payloads(Topics("b"), "run")
        for record in here.plant.sink.of(object):
            payloads.message(record)
        for result in here.plant.sink.of(ResultRecord):
            f"{result.id}{result.text}{result.verb}".encode()
        for audit in here.plant.sink.of(AuditRecord):
            json.dumps(audit.args, ensure_ascii=False).encode()

    run_virtually(run())


@pytest.mark.parametrize("field", ["id", "operator", "reason", "args", "expect"])
@virtually
async def test_half_a_surrogate_pair_anywhere_in_a_command_is_no_json(field: str) -> None:
    here = await desk()
    odd: Any = {"args": {"parameter": "\ud800"}, "expect": {"state": "\udfff"}}.get(field, "x\ud800")

    here.take("start", **{"id_": "1", "token": here.token(), field.replace("id", "id_"): odd})  # type: ignore[arg-type]
    here.take("start", "2", token=here.token(), reason="\U0001f600")
    await here.plant.wait(3.0)

    assert [(r.id, r.code) for r in here.plant.sink.of(ResultRecord) if r.phase.is_final] == [
        (None, "bad_json"),
        ("2", "ok"),
    ]
    assert here.plant.starts() == 1


@virtually
async def test_a_start_that_waits_to_be_parsed_is_not_carried_out_after_the_stop_that_overtook_it() -> None:
    here = await desk()
    inbox = Inbox(
        Topics("b"),
        take=here.incoming.take,
        refuse=here.plant.dispatcher.refuse_unread,
        now_s=here.plant.clock.now_s,
    )
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    inbox._paid_s = loop.time() + 1.5  # it has parsed a flood

    inbox.put(message("start", "1", token=here.token(), ttl_s=60.0))
    await asyncio.sleep(0.01)
    inbox.put(message("stop", "2"))
    await asyncio.sleep(1.0)
    assert here.plant.sink.final("2").code == "ok"
    await asyncio.sleep(1.0)

    sink = here.plant.sink
    assert sink.phases("1") == [("rejected", "stopped_first")]
    assert here.plant.starts() == 0


def message(verb: str, id_: str, **fields: Any) -> Incoming:
    return Incoming(f"b/command/pump-1/alice/{verb}", json.dumps({"id": id_, **fields}).encode())
