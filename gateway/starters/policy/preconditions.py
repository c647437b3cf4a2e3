"""What an operator takes for granted of a starter, compared with what was just read.

What the gateway itself demands of one command, looked at on fresh readings and right before the write.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.errors import CommandError
from gateway.families.command.interlock import points_needed
from gateway.families.profile.schema import Profile
from gateway.families.profile.state import STATES, state_of
from gateway.families.reading.bulk import rows_of_points
from gateway.starters.policy.lock import is_forbidden, refusal
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.start_rules import Rulebook, is_start
from gateway.storage.json_file import Saver
from gateway.system.clock import Clock

STATE = "state"


class Expectation:
    """A state, or the values of points, that must still be so; `code` is that of a refusal."""

    def __init__(self, profile: Profile, wanted: Mapping[str, Any], *, code: str = "not_as_expected") -> None:
        for name, value in wanted.items():
            if name != STATE and name not in profile.points:
                raise CommandError(
                    "bad_expect", f"{profile.title} has no {name[:40]!r} to expect anything of"
                )
            if name == STATE and value not in STATES:
                raise CommandError("bad_expect", f"a state is one of {', '.join(STATES)}")
        self._profile = profile
        self._wanted = wanted
        self._code = code

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the rows that must be read to tell."""
        names = [name for name in self._wanted if name != STATE]
        if STATE in self._wanted:
            names += points_needed(self._profile, ("is_ready",))
        return rows_of_points(self._profile, names)

    def check(self, points: Mapping[str, Any]) -> None:
        """Raise CommandError unless all is as expected."""
        for name, wanted in self._wanted.items():
            value = state_of(self._profile, points) if name == STATE else points.get(name)
            if not _is_equal(value, wanted):
                text = f"{name}: expected {_word(wanted)}, but it is {_word(value)}; look, then decide again"
                raise CommandError(self._code, text)


def _is_equal(value: object, wanted: object) -> bool:
    return isinstance(value, bool) is isinstance(wanted, bool) and value == wanted


def _word(value: object) -> str:
    if value is None:
        return "unknown"
    return str(value).lower() if isinstance(value, bool) else str(value)


KEPT_WITHIN_S = 1.0


class Guard:
    """Judges one command until its first write; every method raises CommandError when it must not be."""

    def __init__(
        self,
        request: CommandRequest,
        expectations: Sequence[Expectation],
        *,
        logbook: MotorHistory,
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
            if not await self._saver.saved(within_s=KEPT_WITHIN_S):
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
