"""The way of a start command, from its message to its result: the files that it goes through.

One SSW-07 on a line that answers at once, in virtual time; the line's own side is not counted.
"""

from __future__ import annotations

import asyncio
import json

from gateway.mqtt.contract.payloads import Payloads

from gateway.contract import CommandRequest, Record, Topics
from gateway.mqtt.commands import CommandParser, Incoming
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.starters.policy.freshness import Moment, RunToken, Tokens
from tests.lab.bench.calls import Counts, counted
from tests.starters.fakes import RecordingSink
from tests.starters.rig import CommandRig


class PublishingRig(CommandRig):
    """A starter with its dispatcher, whose records become MQTT messages in an outbox."""

    def __init__(self) -> None:
        super().__init__()
        topics, self.boot = Topics("b"), RunToken("run")
        self.tokens = Tokens(self.boot)
        payloads = Payloads(topics, self.boot)
        outbox = Outbox(last_topic=topics.gateway_status, pack=payloads.history, boot=self.boot.run)
        publisher = Publisher(payloads, outbox, self.clock)
        self.parser = CommandParser(topics, self.tokens, freshness_of=lambda _: ("token",))
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
    moment = Moment(rig.clock.now_s(), rig.clock.utc_s(), None)
    with counted() as way:
        verdict = rig.parser.judge(Incoming("b/command/pump-1/alice/start", payload), moment)
        assert isinstance(verdict, CommandRequest), verdict
        rig.dispatcher.submit(verdict)
        await asyncio.sleep(5.0)
    assert rig.sink.final("1").code == "ok"
    return way
