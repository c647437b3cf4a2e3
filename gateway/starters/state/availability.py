"""Whether a starter answers, and which part of it cannot be read: online, degraded, offline, disabled."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gateway.contract import EventCode
from gateway.starters.state.publisher import Emitter


class Availability:
    """Of one starter; `on_trouble` gets each change of what cannot be read of it, empty for nothing."""

    def __init__(self, emitter: Emitter) -> None:
        self._emitter = emitter
        self._never_answered = "not yet read"  # why, as published last
        self.troubles: dict[str, str] = {}  # by topic: what cannot be read at present
        self.on_trouble: Callable[[str], None] = lambda _: None
        self.is_online = False
        self.was_lost = False
        self.lost_reason = ""  # why it is offline, since it was lost

    def start(self, *, is_enabled: bool) -> None:
        """Publish what is known before the first answer."""
        if not is_enabled:
            self._emitter.availability("disabled", reason="disabled in the configuration")
        elif not self.is_online:
            self._emitter.availability("offline", reason=self._never_answered)

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
            self._emitter.event(EventCode.DEGRADED, topic=topic, reason=reason)
        elif not self.troubles:
            self._emitter.event(EventCode.RECOVERED)
        self.on_trouble("; ".join(self.troubles.values()))

    def come_online(self) -> None:
        """Publish that it answers, as it did not before."""
        self.is_online, self.lost_reason = True, ""
        self._publish()
        if self.was_lost:
            self._emitter.event(EventCode.ANSWERS_AGAIN)

    def go_offline(self, reason: str, frames: Sequence[str]) -> None:
        """Publish that it went silent; everything is asked again once it answers."""
        self.is_online, self.was_lost, self.lost_reason = False, True, reason
        self.troubles.clear()
        self.on_trouble("")
        self._emitter.availability("offline", reason=reason)
        self._emitter.event(EventCode.WENT_SILENT, reason=reason, frames=list(frames))

    def note_never_answered(self, reason: str) -> None:
        """Publish why a starter that has not answered yet does not, when that is news."""
        if not self.was_lost and reason != self._never_answered:
            self._never_answered = reason
            self._emitter.availability("offline", reason=reason)

    def end(self, reason: str) -> None:
        """Publish that it is no longer watched."""
        if self.is_online:
            self._emitter.availability("offline", reason=reason)

    def _publish(self) -> None:
        text = "; ".join(self.troubles.values())
        self._emitter.availability("degraded" if text else "online", reason=text or None)
