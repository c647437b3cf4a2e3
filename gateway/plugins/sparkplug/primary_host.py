"""Whether the primary host application is online, by what it says on its STATE topic; pure.

Births are published only while it is.
"""

from __future__ import annotations

from gateway.contract import read_object
from gateway.plugins.sparkplug.settings import state_topic


def host_state(payload: bytes) -> tuple[bool, int] | None:
    """Return whether a STATE message says online, and its host's own time (ms, UTC).

    None when it is none [tck-id-host-topic-phid-birth-payload].
    """
    try:
        fields = read_object(payload)
    except ValueError:
        return None
    is_online, time_ms = fields.get("online"), fields.get("timestamp")
    if not isinstance(is_online, bool) or isinstance(time_ms, bool) or not isinstance(time_ms, int):
        return None
    return is_online, time_ms


class PrimaryHost:
    """Whether the host that this node waits for is online at the server of the present connection.

    A message older than the last that counted is ignored
    [tck-id-message-flow-edge-node-birth-publish-phid-wait-timestamp].
    """

    def __init__(self, host: str | None) -> None:
        self._host = host
        self._last_ms: int | None = None
        self._is_online = False

    @property
    def topic(self) -> str | None:
        """Return what to subscribe to; None when none is waited for."""
        return None if self._host is None else state_topic(self._host)

    @property
    def is_online(self) -> bool:
        """Return whether births may be published."""
        return self._host is None or self._is_online

    def begin(self) -> None:
        """Begin a connection: its server has not said anything yet."""
        self._is_online, self._last_ms = False, None

    def take(self, payload: bytes) -> bool:
        """Take a STATE message; return whether the host has gone, so that this connection is to end."""
        state = host_state(payload)
        if state is None or (self._last_ms is not None and state[1] < self._last_ms):
            return False
        was_online = self._is_online
        self._is_online, self._last_ms = state
        return was_online and not self._is_online
