"""Whether a starter answers, and which part of it cannot be read: online, degraded, offline, disabled."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gateway.contract import AvailabilityRecord, EventCode, Presence, RecordWriter


class Availability:
    """Of one starter; `on_trouble` gets each change of what cannot be read of it, empty for nothing."""

    def __init__(self, starter: str, records: RecordWriter) -> None:
        self._starter = starter
        self._records = records
        self.troubles: dict[str, str] = {}  # by topic: what cannot be read at present
        self.on_trouble: Callable[[str], None] = lambda _: None
        self.is_online = False
        self.was_lost = False
        self.reason = "not yet read"  # why it is offline

    def start(self, *, is_enabled: bool) -> None:
        """Publish what is known before the first answer."""
        if not is_enabled:
            self._put("disabled", "disabled in the configuration")
        elif not self.is_online:
            self._put("offline", self.reason)

    def set_trouble(self, topic: str, reason: str) -> None:
        """Publish that a part cannot be read at present; an empty reason: it can be again."""
        if self.troubles.get(topic, "") == reason:
            return
        if reason:
            self.troubles[topic] = reason
        else:
            del self.troubles[topic]
        if self.is_online:
            self._publish()
        if reason:
            self._records.event(self._starter, EventCode.DEGRADED, topic=topic, reason=reason)
        elif not self.troubles:
            self._records.event(self._starter, EventCode.RECOVERED)
        self.on_trouble("; ".join(self.troubles.values()))

    def come_online(self) -> None:
        """Publish that it answers, as it did not before."""
        self.is_online = True
        self._publish()
        if self.was_lost:
            self._records.event(self._starter, EventCode.ANSWERS_AGAIN)

    def go_offline(self, reason: str, frames: Sequence[str]) -> None:
        """Publish that it went silent; everything is asked again once it answers."""
        self.is_online, self.was_lost, self.reason = False, True, reason
        self.troubles.clear()
        self.on_trouble("")
        self._put("offline", reason)
        self._records.event(self._starter, EventCode.WENT_SILENT, reason=reason, frames=list(frames))

    def note_never_answered(self, reason: str) -> None:
        """Publish why a starter that has not answered yet does not, when that is news."""
        if not self.was_lost and reason != self.reason:
            self.reason = reason
            self._put("offline", reason)

    def end(self, reason: str) -> None:
        """Publish that it is no longer watched."""
        if self.is_online:
            self._put("offline", reason)

    def _publish(self) -> None:
        text = "; ".join(self.troubles.values())
        self._put("degraded" if text else "online", text or None)

    def _put(self, state: Presence, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        since_s = self._records.clock.utc_s()
        self._records.put(
            AvailabilityRecord(starter=self._starter, state=state, since_s=since_s, reason=reason)
        )
