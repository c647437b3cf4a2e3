"""How long the ways are: files and calls from a message to its result, and from a reply to its publication.

    python -m tests.lab.bench.command_way

One SSW-07 on a line that answers at once, in virtual time. `sys.setprofile` counts the calls of functions in
`gateway/`, so the counts are the same on every machine; the line's own side is not in them.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import gateway
from gateway.line.rtu.outcome import Answered
from gateway.mqtt.contract.commands import CommandParser, Incoming
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.payloads import Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
from gateway.records import Record, ResultRecord
from gateway.starters.policy.request import CommandRequest
from tests.starters.fakes import AT_SPEED, VB01, RecordingSink
from tests.starters.rig import CommandRig
from tests.virtual_time import run_virtually

HOUSE = str(Path(gateway.__file__).parent)
SIMULATOR = f"{HOUSE}/sim/"


@dataclass
class Way:
    """What was called on the way."""

    calls: Counter[str] = field(default_factory=Counter)  # by file

    def __str__(self) -> str:
        return f"{len(self.calls)} files, {sum(self.calls.values())} calls"

    def note(self, frame: FrameType, event: str, _: Any) -> None:
        """Count a call; as `sys.setprofile` gives it."""
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(HOUSE) and not name.startswith(SIMULATOR):
            self.calls[name.removeprefix(HOUSE)] += 1

    def listing(self) -> str:
        """Return the files with their calls, the busiest first."""
        return "\n".join(f"  {count:5d}  {name}" for name, count in self.calls.most_common())


@contextmanager
def counted() -> Iterator[Way]:
    """Count the calls inside."""
    way = Way()
    sys.setprofile(way.note)
    try:
        yield way
    finally:
        sys.setprofile(None)


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


async def start_command() -> Way:
    """Return the way of a start from its message to its confirmation, the line's side left out."""
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


async def reply(*, is_changed: bool) -> Way:
    """Return the way of a status reply from the line's outcome to the outbox."""
    rig = PublishingRig()
    await rig.online()
    (key,) = [each for each in rig.line.polls if "VB01" in each]
    for word in (rig.unit.holding[VB01], AT_SPEED if is_changed else rig.unit.holding[VB01]):
        rig.unit.holding[VB01] = word
        outcome = rig.line.outcome_of(rig.line.polls[key].request, at_s=rig.clock.now_s())
        assert isinstance(outcome, Answered)
        with counted() as way:
            rig.telemetry.on_poll(key, outcome)
        await asyncio.sleep(1.0)
    assert not rig.sink.of(ResultRecord)
    return way


def main() -> None:
    """Print the ways; with -v file by file."""
    ways: dict[str, Way] = {}

    async def measure() -> None:
        ways["start, from the message to its result"] = await start_command()
        ways["status reply with a change, to the outbox"] = await reply(is_changed=True)
        ways["status reply without a change"] = await reply(is_changed=False)

    run_virtually(measure())
    for what, way in ways.items():
        print(f"{what}: {way}")
        if "-v" in sys.argv:
            print(way.listing())


if __name__ == "__main__":
    main()
