"""How large a packet from the broker may be: paho's client, which stores none that is announced larger.

MQTT 5 lets a client ask the broker to hold larger ones back; MQTT 3.1.1 does not, and a broker may ignore it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Self

from paho.mqtt import client as paho

from gateway.contract import Event, EventCode, event_of

MAX_INCOMING_BYTES = 65_536  # asked of the broker; commands are 4 KB at most
MOST_SKIPPED_BYTES = 1_048_576  # of a larger packet its beginning is stored; beyond this it ends the session
RETAIN = 0x01  # in a PUBLISH's first byte [MQTT3 3.3.1.3]


class TooLargeError(Exception):
    """The broker announced more than is taken; carries its size. An OSError would not come out of paho."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(size)


class LimitedClient(paho.Client):
    """Reads over a packet that is too large, and says so to `on_skip`.

    One that is larger than MOST_SKIPPED_BYTES would hold up what comes after it, and ends the session
    (TooLargeError); unless it is retained, since the next session would get it too.
    """

    on_skip: Callable[[int], None]

    def pinged_for_s(self) -> float:
        """Return for how long a ping has been without its answer; 0 for none."""
        return time.monotonic() - self._ping_t if self._ping_t else 0.0

    def _sock_recv(self, bufsize: int) -> bytes:
        """Read so much at most; for a packet's body paho first asks for its whole announced length."""
        if bufsize > MAX_INCOMING_BYTES:
            packet = self._in_packet
            if not isinstance(packet["packet"], _Beginning):
                is_retained = bool(packet["command"] & RETAIN)
                if bufsize > MOST_SKIPPED_BYTES and not is_retained:
                    raise TooLargeError(bufsize)
                packet["packet"] = _Beginning()
                self.on_skip(bufsize)
        return super()._sock_recv(min(bufsize, MAX_INCOMING_BYTES))


class _Beginning(bytearray):
    """The body of a packet that is too large, as far as it is stored: its topic, and more than is taken."""

    def __iadd__(self, data: Any) -> Self:  # type: ignore[misc]  # paho adds in place only
        """Add what there is room for."""
        self.extend(data[: 2 * MAX_INCOMING_BYTES - len(self)])
        return self


def too_large(size: int, *, is_skipped: bool) -> Event:
    """Return what is wrong with a packet from the broker: it was read over, or has ended the connection."""
    return event_of(
        EventCode.MESSAGE_TOO_LARGE,
        "skipped" if is_skipped else "announced",
        size=size,
        limit=MAX_INCOMING_BYTES,
    )
