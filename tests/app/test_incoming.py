"""What comes in, and what of it is taken after the gateway has stood still."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.mqtt.connection.inbox import Inbox
from gateway.mqtt.contract.commands import Incoming
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
async def test_a_start_whose_token_is_old_when_it_comes_expires_within_the_gateway_as_well() -> None:
    here = await desk()
    token = here.token()
    await asyncio.sleep(1.5)
    verdicts: list[float | None] = []
    here.plant.dispatcher.submit = lambda request: verdicts.append(request.expires_s)  # type: ignore[method-assign]

    here.take("start", "1", token=token)

    assert verdicts == [pytest.approx(here.plant.clock.now_s() - 1.5 + 5.0)]


@virtually
async def test_a_command_under_way_learns_of_a_suspension_that_was_not_noticed_yet() -> None:
    here = await desk()
    before_s = here.standstill.ended_s()
    await asyncio.sleep(0.01)
    here.asleep_s = 3600.0

    assert here.standstill.ended_s() == here.plant.clock.now_s() > before_s
    assert [event[0] for event in here.events] == ["stood_still"]


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
