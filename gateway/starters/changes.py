"""What happened between one status and the next: a start, a stop, a fault, a switch to local operation.

Only what two readings in a row say has happened (`Settled`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.starters.records import Severity

UNKNOWN = "unknown"
STARTED = frozenset({"starting", "running"})
TURNING = STARTED | {"stopping"}
AT_REST = frozenset({"ready", "not_ready"})


@dataclass(frozen=True, slots=True)
class Change:
    """Something that happened to a starter."""

    code: str
    severity: Severity
    text: str
    data: Mapping[str, Any] = field(default_factory=dict)


class Settled:
    """Points as two readings one after the other have given them; what is not known now is in neither."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._waiting: dict[str, tuple[Any, float]] = {}  # values that were read once, with their time

    def note(self, readings: Mapping[str, tuple[Any, float]]) -> None:
        """Take over all points that are known now, each with the time of its reading."""
        for name in self._values.keys() - readings.keys():
            del self._values[name]
        waiting: dict[str, tuple[Any, float]] = {}
        for name, (value, at_s) in readings.items():
            if name in self._values and self._values[name] == value:
                continue
            before = self._waiting.get(name)
            if before is None or before[0] != value:
                waiting[name] = (value, at_s)
            elif at_s > before[1]:
                self._values[name] = value
            else:
                waiting[name] = before
        self._waiting = waiting

    def is_waiting_for(self, names: Iterable[str]) -> bool:
        """Return whether one of these points must be read once more."""
        return not self._waiting.keys().isdisjoint(names)

    @property
    def is_waiting(self) -> bool:
        """Return whether some point must be read once more."""
        return bool(self._waiting)

    @property
    def values(self) -> Mapping[str, Any]:
        """Return the settled values; a point whose value is about to change keeps the one before."""
        return self._values


class Watch:
    """Compares each settled status with the last one; a fault that stands at the first look is told too.

    `is_known` says that the fault was told in an earlier run.
    """

    def __init__(self) -> None:
        self._state: str | None = None
        self._remote: bool | None = None
        self._started_s: float | None = None

    def note(
        self, state: str, *, remote: bool | None, time_s: float, is_known: bool = False
    ) -> tuple[Change, ...]:
        """Take over a status read at `time_s` (UTC) and return what happened since the last one."""
        changes = [*self._of_remote(remote), *self._of_state(state, time_s, is_known=is_known)]
        self._remote = self._remote if remote is None else remote
        self._state = self._state if state == UNKNOWN else state
        return tuple(changes)

    @property
    def has_looked(self) -> bool:
        """Return whether a state was known ever."""
        return self._state is not None

    def _of_state(self, state: str, time_s: float, *, is_known: bool) -> list[Change]:
        before = self._state
        if before is None and state == "fault" and not is_known:
            at_first: dict[str, Any] = {"from": None, "to": state}
            return [Change("fault", Severity.ERROR, "fault, found at the first reading", at_first)]
        if before is None or state in (before, UNKNOWN):
            return []
        data: dict[str, Any] = {"from": before, "to": state}
        if state == "fault":
            return [Change("fault", Severity.ERROR, f"fault, was {before}", data | self._duration(time_s))]
        if state in STARTED and before not in STARTED:
            self._started_s = time_s
            return [Change("started", Severity.INFO, f"the motor was started, was {before}", data)]
        if state in AT_REST and before in TURNING:
            return [Change("stopped", Severity.INFO, "the motor has stopped", data | self._duration(time_s))]
        return []

    def _duration(self, time_s: float) -> dict[str, Any]:
        """Return how long the motor has been on, once per start that was seen."""
        started_s, self._started_s = self._started_s, None
        return {} if started_s is None else {"run_s": round(time_s - started_s, 3)}

    def _of_remote(self, remote: bool | None) -> list[Change]:  # noqa: FBT001 - a reading, not an option
        if self._remote is None or remote is None or remote is self._remote:
            return []
        if remote:
            return [Change("remote_operation", Severity.INFO, "the starter takes commands from remote again")]
        return [Change("local_operation", Severity.INFO, "the starter was switched to local operation")]
