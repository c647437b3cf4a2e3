"""Subscribes to the records for MQTT: makes each a message, puts it into the outbox, wakes the sender."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from typing import Literal

from gateway.contract import LineRecord, OutboxRecord, Record, StatusRecord, Topics, ValueRecord
from gateway.mqtt.message import Message, cleared, message_of
from gateway.mqtt.outbox.outbox import Outbox
from gateway.starters.policy.freshness import RunToken
from gateway.system.clock import Clock

log = logging.getLogger(__name__)

EVERY_S = 30.0  # gateway/outbox
State = Literal["starting", "online", "degraded", "offline"]

LOOK_EVERY_S = 1.0  # whether something was dropped or refused


class Publisher:
    """Implements `gateway.contract.Sink`, and publishes the gateway's own status and info."""

    def __init__(self, topics: Topics, boot: RunToken, outbox: Outbox, *, clock: Clock) -> None:
        self._topics = topics
        self._boot = boot
        self._outbox = outbox
        self._clock = clock
        self._wake: Callable[[], None] = _no_connection
        self._on_message: Callable[[Message], None] = _no_listener
        self._state: State = "starting"
        self._reason: str | None = None
        self._since_s = clock.utc_s()
        self._put_status()

    @property
    def state(self) -> State:
        """Return the gateway's state: starting, online or degraded."""
        return self._state

    def wake_with(self, wake: Callable[[], None]) -> None:
        """Set the function to call when there is something to send."""
        self._wake = wake

    def listen(self, on_message: Callable[[Message], None] | None) -> None:
        """Hand every message to another one, too, the retained ones of before first; None ends that.

        It must return at once and never raise.
        """
        self._on_message = on_message or _no_listener
        below = f"{self._topics.base}/"
        for message in tuple(self._outbox.latest.values()) if on_message else ():
            if message.topic.startswith(below):
                self._on_message(message)

    def announce(self, message: Message) -> None:
        """Publish a message of an integration, on a topic that is none of the gateway's own."""
        self._outbox.put(message, self._clock.now_s())
        self._wake()

    def retained(self, topic: str) -> Message | None:
        """Return the newest message of a retained topic; None once the broker has been made to forget it."""
        return self._outbox.latest.get(topic)

    def values(self) -> Iterator[ValueRecord]:
        """Yield the newest value of each point that was published."""
        return (each.value for each in tuple(self._outbox.latest.values()) if each.value is not None)

    def wake(self) -> None:
        """Have what waits sent."""
        self._wake()

    def put(self, record: Record) -> None:
        """Take one record, in order; returns at once and never raises."""
        self._put(message_of(record, self._topics.base))

    def forget(self, *starters: str) -> None:
        """Clear every retained topic of starters that are no longer configured."""
        topics = self._topics
        self._outbox.forget([topics.starter(starter) for starter in starters], self._clock.now_s())
        self._wake()
        for starter in starters:
            self._on_message(cleared(topics.starter(starter)))

    def clear(self, topic: str) -> None:
        """Make the broker forget what an earlier run left retained."""
        self._put(cleared(topic))

    def forget_line(self, line: str) -> None:
        """Clear the retained statistics of a line that is no longer configured."""
        self._put(cleared(self._topics.of(LineRecord, line=line)))

    def set_status(self, state: State, reason: str | None = None) -> None:
        """Publish the gateway's state (starting, online, degraded) when it has changed."""
        if (state, reason) == (self._state, self._reason):
            return
        if state != self._state:
            self._since_s = self._clock.utc_s()
        self._state = state
        self._reason = reason
        self._put_status()

    def restate(self) -> None:
        """Publish the present status again: its boot token has changed."""
        self._put_status()

    def will(self) -> Message:
        """Return the will: what the broker publishes when the connection is lost, without a time."""
        return self._status("offline", time_s=None, since_s=None, reason="connection lost")

    def farewell(self, reason: str) -> Message:
        """Return the last status of an orderly end."""
        now_s = self._clock.utc_s()
        return self._status("offline", time_s=now_s, since_s=now_s, reason=reason)

    async def run(self) -> None:
        """Publish the outbox's statistics every 30 s, and within 1 s of a loss or refusal."""
        reported = (0, 0)
        due_s = self._clock.now_s()
        while True:
            losses = self._losses()
            if losses != reported or self._clock.now_s() >= due_s:
                self.put(OutboxRecord(data=self._outbox.statistics(self._clock.now_s())))
                self._log_losses(reported, losses)
                reported = losses
                due_s = self._clock.now_s() + EVERY_S
            await asyncio.sleep(LOOK_EVERY_S)

    def _losses(self) -> tuple[int, int]:
        return self._outbox.dropped, self._outbox.refused

    def _log_losses(self, before: tuple[int, int], after: tuple[int, int]) -> None:
        """Log the first of each kind; the counts are in `gateway/outbox`."""
        if after[0] and not before[0]:
            log.warning("outbox full: the oldest history, events and audit records are dropped")
        if after[1] and not before[1]:
            refusal = self._outbox.refusals[-1]
            log.error(
                "topic=%s refused by the broker, reason code 0x%02X; check its access list",
                refusal.topic,
                refusal.reason_code,
            )

    def _put_status(self) -> None:
        now_s = self._clock.utc_s()
        self._put(self._status(self._state, time_s=now_s, since_s=self._since_s, reason=self._reason))

    def _status(
        self, state: State, *, time_s: float | None, since_s: float | None, reason: str | None
    ) -> Message:
        boot = self._boot
        status = StatusRecord(
            state=state, time_s=time_s, boot=boot.token, since_s=since_s, reason=reason, run=boot.run
        )
        return message_of(status, self._topics.base)

    def _put(self, message: Message) -> None:
        self._outbox.put(message, self._clock.now_s())
        self._wake()
        self._on_message(message)


def _no_listener(_: Message) -> None:
    """Do nothing: only MQTT gets the messages."""


def _no_connection() -> None:
    """Do nothing: there is no connection to wake yet."""
