"""Names this run of the gateway, and within it each connection to the broker."""

from __future__ import annotations


class RunToken:
    """`run` goes with everything that is numbered, `token` proves a command fresh.

    Numbers (`seq`) go on over a reconnection, so their messages carry `run`. The token changes whenever a
    connection is lost or the gateway stood still: who has the present one has read it since then.
    """

    def __init__(self, run: str) -> None:
        self.run = run
        self._tokens = 1  # so far
        self._connected_s: float | None = None

    @property
    def token(self) -> str:
        """Return the `boot` of gateway/status: the run's own name during its first connection."""
        return self.run if self._tokens == 1 else f"{self.run}-{self._tokens}"

    def connected(self, now_s: float) -> None:
        """Note, on the steady clock, since when commands can arrive; further calls change nothing."""
        if self._connected_s is None:
            self._connected_s = now_s

    def disconnected(self) -> None:
        """Let the token of the lost connection count no more; without a connection nothing changes."""
        if self._connected_s is not None:
            self._tokens += 1
            self._connected_s = None

    def stood_still(self, now_s: float) -> None:
        """Invalidate the tokens issued so far: a command that carries one has waited for an unknown time."""
        self._tokens += 1
        if self._connected_s is not None:
            self._connected_s = now_s

    def renew(self) -> None:
        """Let the token count no more, although nothing was lost: a new one is to be read first."""
        self._tokens += 1

    def is_before_connection(self, at_s: float) -> bool:
        """Return whether a moment of the steady clock lies before the present connection."""
        return self._connected_s is not None and at_s < self._connected_s


def boot_of(boot: RunToken | str) -> RunToken:
    """Return the boot of a run that is given by its name only."""
    return boot if isinstance(boot, RunToken) else RunToken(boot)
