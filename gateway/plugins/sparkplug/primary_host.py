"""Whether the primary host application is online, by what it says on its STATE topic; pure.

Births are published only while it is.
"""

from __future__ import annotations

from pydantic import BaseModel, ValidationError

from gateway.plugins.sparkplug.settings import state_topic


class HostState(BaseModel, strict=True):
    """What a STATE message says; `timestamp` is its host's own time, ms, UTC."""

    online: bool
    timestamp: int


def host_state(payload: bytes) -> HostState | None:
    """Return a STATE message; None when it is none [tck-id-host-topic-phid-birth-payload]."""
    try:
        return HostState.model_validate_json(payload)
    except ValidationError:
        return None


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
        if state is None or (self._last_ms is not None and state.timestamp < self._last_ms):
            return False
        was_online = self._is_online
        self._is_online, self._last_ms = state.online, state.timestamp
        return was_online and not self._is_online
