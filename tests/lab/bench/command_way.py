"""The way of a start command, from its message to its result: the files that it goes through.

One SSW-07 on a line that answers at once, in virtual time; the line's own side is not counted.
"""

from __future__ import annotations

import asyncio
import json

from gateway.contract import Record, StatusRecord, Topics
from gateway.mqtt.commands import Incoming, command_in
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.starters import Commands, RunToken, Tokens
from gateway.system.clock import ClockWatch
from gateway.system.stalls import SuspendWatch
from tests.lab.bench.calls import Counts, counted
from tests.lab.bench.one_starter import OneStarter, RecordingSink


class PublishingRig(OneStarter):
    """A starter with its dispatcher, whose records become MQTT messages in an outbox."""

    def __init__(self) -> None:
        super().__init__()
        topics, self.boot = Topics("b"), RunToken("run")
        self.tokens = Tokens(self.boot)
        outbox = Outbox(last_topic=topics.of(StatusRecord), boot=self.boot.run)
        publisher = Publisher(topics, self.boot, outbox, sink=self.sink, clock=self.clock)
        self.topics = topics
        self.commands = Commands(
            self.dispatcher,
            self.tokens,
            clock=self.clock,
            clock_watch=ClockWatch("trusted"),
            suspend_watch=SuspendWatch(self.clock.now_s, up_s=self.clock.now_s, utc_s=self.clock.utc_s),
            restate=lambda: None,
            publish_event=lambda *_, **__: None,
        )
        keep = RecordingSink.put.__get__(self.sink)

        def put(record: Record) -> None:
            publisher.put(record)
            keep(record)

        self.sink.put = put  # type: ignore[method-assign] # so that all that is published becomes messages


async def start_command() -> Counts:
    """Return the calls of a start from its message to its confirmation."""
    rig = PublishingRig()
    await rig.online()
    token = rig.tokens.issue(rig.clock.now_s())
    payload = json.dumps({"id": "1", "token": token}).encode()
    with counted() as way:
        incoming = Incoming("b/command/pump-1/alice/start", payload)
        address = rig.topics.parse_command(incoming.topic)
        assert address is not None
        received = command_in(address, incoming, rig.clock.now_s(), verb_error=rig.dispatcher.verb_error)
        rig.commands.submit(received.request, received.refusal)
        await asyncio.sleep(5.0)
    assert rig.sink.final("1").code == "ok"
    return way
