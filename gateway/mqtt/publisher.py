"""Subscribes to the records for MQTT: makes each a message, puts it into the outbox, wakes the sender."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gateway.contract import (
    ForgetRecord,
    GatewayState,
    OutboxRecord,
    Record,
    Sink,
    StatusRecord,
    Topics,
)
from gateway.mqtt.message import Message, cleared, message_of
from gateway.mqtt.outbox.outbox import Outbox
from gateway.starters import Tokens
from gateway.system.clock import Clock

EVERY_S = 30.0  # gateway/outbox
LOOK_EVERY_S = 1.0  # whether something was dropped or refused


class Publisher:
    """Implements `gateway.contract.Sink`, and publishes the gateway's own status and info."""

    def __init__(self, topics: Topics, tokens: Tokens, outbox: Outbox, *, sink: Sink, clock: Clock) -> None:
        self._sink = sink  # of the records that it makes itself: they go to all
        self._topics = topics
        self._tokens = tokens
        self._outbox = outbox
        self._clock = clock
        self.wake: Callable[[], None] = lambda: None  # has what waits sent, by the connection
        self._state: GatewayState = "starting"
        self._reason: str | None = None
        self._since_s = clock.utc_s()
        self.restate()

    @property
    def state(self) -> GatewayState:
        """Return the gateway's state: starting, online or degraded."""
        return self._state

    def announce(self, message: Message) -> None:
        """Publish a message, of an integration or of a record."""
        self._outbox.put(message, self._clock.now_s())
        self.wake()

    def put(self, record: Record) -> None:
        """Take one record, in order; returns at once and never raises."""
        if isinstance(record, ForgetRecord):
            below = f"{self._topics.base}/"
            for topic in self._outbox.topics():
                if record.has(topic.removeprefix(below)):
                    self.clear(topic)
        else:
            self.announce(message_of(record, self._topics.base))

    def clear(self, topic: str) -> None:
        """Make the broker forget what an earlier run left retained."""
        self.announce(cleared(topic))

    def set_status(self, state: GatewayState, reason: str | None = None) -> None:
        """Publish the gateway's state (starting, online, degraded) when it has changed."""
        if (state, reason) == (self._state, self._reason):
            return
        if state != self._state:
            self._since_s = self._clock.utc_s()
        self._state = state
        self._reason = reason
        self.restate()

    def restate(self) -> None:
        """Publish the present status; again where its boot token has changed."""
        now_s = self._clock.utc_s()
        self._sink.put(self._status(self._state, time_s=now_s, since_s=self._since_s, reason=self._reason))

    def will(self) -> Message:
        """Return the will: what the broker publishes when the connection is lost, without a time."""
        status = self._status("offline", time_s=None, since_s=None, reason="connection lost")
        return message_of(status, self._topics.base)

    def farewell(self, reason: str) -> Message:
        """Return the last status of an orderly end."""
        now_s = self._clock.utc_s()
        status = self._status("offline", time_s=now_s, since_s=now_s, reason=reason)
        return message_of(status, self._topics.base)

    async def run(self) -> None:
        """Publish the outbox's statistics every 30 s, and within 1 s of a loss or refusal."""
        reported = (0, 0)
        due_s = self._clock.now_s()
        while True:
            losses = (self._outbox.backlog.losses.dropped, self._outbox.refused)
            if losses != reported or self._clock.now_s() >= due_s:
                self._sink.put(OutboxRecord(**self._outbox.statistics(self._clock.now_s())))
                reported = losses
                due_s = self._clock.now_s() + EVERY_S
            await asyncio.sleep(LOOK_EVERY_S)

    def _status(
        self, state: GatewayState, *, time_s: float | None, since_s: float | None, reason: str | None
    ) -> StatusRecord:
        tokens = self._tokens
        return StatusRecord(
            state=state, time_s=time_s, boot=tokens.boot, since_s=since_s, reason=reason, run=tokens.run
        )
