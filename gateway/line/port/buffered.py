"""Ports that are open: bytes that wait for their reader, waits that end on time (`EarlyWakeUp`)."""

from __future__ import annotations

import abc
import asyncio
from math import inf
from typing import cast

from gateway.errors import PortLostError
from gateway.line.port.event_loop import PreciseLoop

FIRST_S, LEAST_S, MOST_S = 0.0001, 0.00005, 0.0004

_EARLIER_S, _LATER_S = 0.000012, 0.000003  # the steps of learning: one write in five then is late

UNREAD_BYTES = 4096  # stored at most; more than the longest frame many times over
CLOSED_BY_OTHER = "lost: closed by the other side"
_AT_ONCE_S = 0.00004


class EarlyWakeUp:
    """Learns from each write that follows a wait."""

    def __init__(self) -> None:
        self.seconds = FIRST_S

    def learn(self, left_s: float) -> None:
        """Record how much time was left when all was ready, negative when it was too late."""
        if left_s < 0.0:
            self.seconds = min(self.seconds + _EARLIER_S, MOST_S)
        else:
            self.seconds = max(self.seconds - _LATER_S, LEAST_S)


class OpenPort(asyncio.Protocol, abc.ABC):
    """A Port that is fed by an asyncio transport, on a PreciseLoop."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._loop = cast(PreciseLoop, asyncio.get_running_loop())
        self._time = self._loop.time
        self._transport: asyncio.Transport | None = None
        self._received = bytearray()
        self._wanted = 1  # bytes for which the reader is woken
        self.last_byte_s = -inf  # when the latest were handed over: never before they arrived
        self._waiter: asyncio.Future[None] | None = None
        self._early = EarlyWakeUp()  # a read ends so long before its time: waking up and writing take as long
        self._was_woken = False  # the latest read, by the time
        self._hold_s = -inf  # until then nothing is written
        self._lost: str | None = None  # the reason
        self._closed = asyncio.Event()

    @abc.abstractmethod
    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the wire; raise PortLostError when the port is gone or stuck."""

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        """Return what has arrived, once it is `count` bytes or right before `until_s`; b"" when nothing came.

        A write that follows waits for the rest of the time, so that all that is done between the two is free.
        """
        self._was_woken = False
        while len(self._received) < count:
            # The port was lost: the bytes before the loss are still handed out, then the loss is raised.
            if self._lost is not None:
                if not self._received:
                    raise PortLostError(self._name, self._lost)
                break
            # The time is over, but for the moment by which the loop wakes late: look once, wait in `write`.
            if until_s - self._time() <= self._early.seconds:
                self._look_once()
                self._hold_s = until_s
                break
            self._wanted = count
            self._waiter = asyncio.Future(loop=self._loop)
            if count > 1:
                self._await_rest()
            self._loop.alarms[self._wake] = until_s - self._early.seconds
            try:
                await self._waiter
            finally:
                self._loop.alarms.pop(self._wake, None)
                self._waiter = None
                self._wanted = 1
            self._was_woken = len(self._received) < count and self._lost is None
        chunk = bytes(self._received)
        self._received.clear()
        return chunk

    def close(self) -> None:
        """Give the port up at once, unsent bytes included."""
        self._lost = self._lost or "closed"
        if self._transport is not None and not self._transport.is_closing():
            self._transport.abort()

    def uart_errors(self) -> dict[str, int] | None:
        """Return what the UART has counted; None where nothing does."""
        return None

    async def wait_closed(self) -> None:
        """Return once the descriptor is closed."""
        await self._closed.wait()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport; asyncio calls this."""
        self._transport = cast(asyncio.Transport, transport)
        if self._lost is not None:  # closed before it was quite open
            self._transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that the port is gone; asyncio calls this, right before it closes the descriptor."""
        self._lost = self._lost or (f"lost: {exc}" if exc else CLOSED_BY_OTHER)
        self._loop.call_soon(self._wake)  # not from within the transport's own end
        self._loop.call_soon(self._closed.set)

    def _take(self, data: bytes, asked_s: float) -> None:
        """Keep bytes that have just been handed over, the driver being asked for them at `asked_s`."""
        now_s = self._time()
        # These bytes were here when we asked, unless that took us so long that more can have come meanwhile.
        self.last_byte_s = asked_s if now_s - asked_s < _AT_ONCE_S else now_s
        self._received += data
        del self._received[:-UNREAD_BYTES]

    def hold(self) -> None:
        """Wait for the end of a read that ended early without letting go: no sleep ends as exactly."""
        time, until_s = self._time, self._hold_s
        if self._was_woken:
            self._early.learn(until_s - time())
            self._was_woken = False
        while time() < until_s:
            pass

    @abc.abstractmethod
    def _look_once(self) -> None:
        """Take what has arrived, without waiting."""

    def _await_rest(self) -> None:
        """Prepare for bytes that are awaited from now on, some of which may be under way."""

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
