"""What the gateway itself demands of one command, looked at on fresh readings and right before the write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.clock import Clock
from gateway.errors import CommandError
from gateway.starters.expectation import Expectation
from gateway.starters.logbook import Logbook
from gateway.starters.maintenance import is_forbidden, refusal
from gateway.starters.memory import Saver
from gateway.starters.request import CommandRequest
from gateway.starters.rules import Rulebook, is_start

KEPT_WITHIN_S = 1.0


class Guard:
    """Judges one command until its first write; every method raises CommandError when it must not be."""

    def __init__(
        self,
        request: CommandRequest,
        expectations: Sequence[Expectation],
        *,
        logbook: Logbook,
        rulebook: Rulebook,
        saver: Saver,
        clock: Clock,
    ) -> None:
        self._request = request
        self._expectations = expectations
        self._logbook = logbook
        self._rulebook = rulebook
        self._saver = saver
        self._clock = clock
        self._is_start = is_start(request.verb, request.args)
        self._is_counted = False  # the start, in the logbook: it must not stand in its own way

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the rows that must be read besides those of the command itself."""
        return tuple(code for expectation in self._expectations for code in expectation.codes)

    def check(self, points: Mapping[str, Any] | None = None) -> None:
        """Judge by the gateway's own rules, and by fresh points where there are some."""
        self._check_time_and_lock()
        if points is not None:
            for expectation in self._expectations:
                expectation.check(points)
        if self._is_start and not self._is_counted:
            self._check_rules()

    async def admit(self) -> None:
        """Judge for the last time; a start is counted and, where a rule counts, kept on the disk first."""
        self.check()
        if not self._is_start:
            return
        starter = self._request.starter
        self._is_counted = True
        self._logbook.note_start(starter, now_s=self._clock.now_s())
        self._saver.touch()
        if self._rulebook.of(starter).is_counting:
            if not await self._saver.kept(within_s=KEPT_WITHIN_S):
                raise CommandError(
                    "not_kept", "the start could not be counted on the disk, as its rules demand"
                )
            self._check_time_and_lock()

    def _check_time_and_lock(self) -> None:
        request, now_s = self._request, self._clock.now_s()
        if request.expires_s is not None and now_s > request.expires_s:
            age_s = now_s - request.received_s
            raise CommandError("expired", f"it came in {age_s:.1f} s ago and is not valid any more")
        lock = self._logbook.lock_of(request.starter)
        if lock is not None and is_forbidden(request.verb, request.args):
            raise refusal(lock)

    def _check_rules(self) -> None:
        violation = self._rulebook.check_start(self._request.starter, now_s=self._clock.now_s())
        if violation is not None:
            raise CommandError(violation.code, violation.text)
