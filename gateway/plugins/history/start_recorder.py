"""From readings to the record of a start: when it began and ended, who gave it, what the current did.

The theory, in the order in which it is applied:

1. A motor is at rest (ready, not_ready, fault), accelerating (starting), on (running) or stopping, by the
   state as of a reply that holds the points of motion; another reply only brings samples.
2. A start begins when a motor that was seen at rest or stopping is accelerating or on. It ends at full
   voltage (or bypass), at a trip, at a stop, or when the starter is lost: then what is known is recorded, and
   nothing is a new start until the motor was seen at rest again.
3. The instant of a change lies between two replies. It is taken in the middle, so it is known to plus or
   minus half the time between them; our command that was written between them narrows that down.
4. Where no reply has shown the motor accelerating, the acceleration time is that over which the current was
   above 2.5 times the rated one [SEL-749M, Motor Start Report].
5. Samples go on for 5 s after full voltage, so that the current of the load is seen too.
6. A current above ten times the rated one, and a lone one that is four times as high as both its neighbours,
   is a reading that went wrong: it is counted, and enters nothing.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gateway.contract import Cause, StartOutcome, StartRecord, StartSource
from gateway.families import Profile, once_per_profile
from gateway.plugins.history.start_curve import COLUMNS, Curve, crossings, i2t_error_pct_of, rate_hz_of
from gateway.starters import Readings

BEFORE_S = 1.0  # samples begin so long before the start
AFTER_S = 5.0  # and go on for so long after full voltage
LONGEST_S = 300.0  # a motor that accelerates longer is given up
RISEN = 2.5  # times the rated current: it accelerates [SEL-749M]
LARGEST = 10.0  # times the rated current, which is also as far as S1.1.4 goes [SSW900, table A.2]
FITS_S = 10.0  # from the write of a start until the motor is seen to start (verify, 5 s, and a poll)
THERMAL_VALID_S = 120.0  # a thermal level of the motor at rest
MOST_COMMANDS = 4
MOST_BEFORE = 32  # samples that are remembered of the time before a start

AT_REST = frozenset({"ready", "not_ready", "fault"})
_NOT_A_START = ("jog", "braking", "reversing")  # on, but not by a start


@dataclass(frozen=True, slots=True)
class StartPoints:
    """Which points of a family the recorder looks at."""

    motion: frozenset[str]  # a reply with one of them shows whether the motor moves
    columns: tuple[str, ...]  # the point of each of `COLUMNS`
    has_acceleration: bool  # a point says so; else the state does

    @staticmethod
    @once_per_profile
    def of(profile: Profile) -> StartPoints:
        """Return those of a family."""
        motion = {name for name, state in profile.state.order.items() if state in ("starting", "running")}
        columns = (profile.thermal_point if name == "thermal" else name for name in COLUMNS)
        return StartPoints(frozenset(motion), tuple(columns), "accelerating" in profile.points)


@dataclass(frozen=True, slots=True)
class StartCommand:
    """A start command of the gateway, at the moment when it was written."""

    client: str
    id: str | None
    at_s: float


class _Phase(enum.Enum):
    UNSEEN = "unseen"  # nothing is known yet
    REST = "rest"  # or it was when the starter was lost
    STARTING = "starting"  # the start was accepted; `_Start.began` says whether the motor accelerates
    AFTER = "after"  # at full voltage, still recorded
    ON = "on"  # or stopping, or it was when the starter was lost
    LOST = "lost"  # during a start, which was given up


@dataclass(slots=True)
class _Motor:
    """The latest readings of the motor; times on the steady clock."""

    motion_s: float | None = None  # of the latest reply that showed whether it moves
    rest_since_s: float | None = None
    remote: bool | None = None
    was_full: bool = False  # at full voltage
    thermal: tuple[float, float] | None = None  # time, level

    def thermal_at(self, now_s: float) -> float | None:
        """Return the thermal level of the motor at rest; None when it was read too long ago."""
        if self.thermal is None or now_s - self.thermal[0] > THERMAL_VALID_S:
            return None
        return self.thermal[1]


@dataclass(slots=True)
class _Start:
    """The start under way; times on the steady clock."""

    earliest_s: float | None  # it began after this; None: nothing is known
    seen_s: float  # first
    utc_offset_s: float  # UTC minus the steady clock
    standstill_s: float | None
    thermal_before: float | None
    remote: bool | None
    was_found: bool  # under way at the first reading
    began: tuple[float, float] | None = None  # accelerating: the latest time without, the first time with it
    ended: tuple[float, float] | None = None  # the latest time with it, the first without
    after_until_s: float = math.inf
    own: Mapping[str, Any] = field(default_factory=dict)  # the starter's own rows of it


class StartRecorder:
    """The starts of one motor, from its readings; gives each record when it is over."""

    def __init__(self, starter: str, points: StartPoints, *, boot: str, sequence: Iterator[int]) -> None:
        self._starter = starter
        self._points = points
        self._boot = boot
        self._sequence = sequence
        self._phase = _Phase.UNSEEN
        self._motor = _Motor()
        self._commands: list[StartCommand] = []
        self._start: _Start | None = None
        self._curve = Curve()  # of the start under way; before it, of the latest samples
        self._last_s = -math.inf
        self.rated_a: float | None = None
        self.given_up_s: float | None = None  # UTC, when the latest start began, if that was given up

    def note_command(self, command: StartCommand) -> None:
        """Record that a start command of the gateway was just written."""
        self._commands = [*self._commands, command][-MOST_COMMANDS:]

    def forget_command(self, client: str, command_id: str | None) -> None:
        """Record that the starter has refused a start command of the gateway."""
        for command in [each for each in self._commands if (each.client, each.id) == (client, command_id)]:
            self._commands.remove(command)

    def note_own(self, rows: Mapping[str, Any]) -> None:
        """Record what the starter has stored of the start that has reached full voltage."""
        if self._start is not None and self._phase is _Phase.AFTER:
            self._start.own = rows

    def take(self, readings: Readings) -> StartRecord | None:
        """Record what was just read; return the start that is over by it, if one is."""
        if readings.at_s < self._last_s:
            return None
        self._last_s = readings.at_s
        remote = readings.values.get("remote")
        if isinstance(remote, bool):
            self._motor.remote = remote
        finished = self._follow(readings)
        self._sample(readings)
        start = self._start
        if start is not None and readings.at_s - start.seen_s > LONGEST_S:
            return self.lose()
        return finished

    def lose(self) -> StartRecord | None:
        """Record that the starter is not read any more; return the start that is over by it."""
        match self._phase:
            case _Phase.STARTING:
                return self._finish(StartOutcome.GIVEN_UP, _Phase.LOST)
            case _Phase.AFTER:
                return self._finish(StartOutcome.FULL_VOLTAGE, _Phase.ON)
            case _:
                self._motor.rest_since_s = None  # it may have been started meanwhile
                return None

    def _follow(self, readings: Readings) -> StartRecord | None:
        if readings.state == "unknown":
            return self.lose()
        if readings.state == "fault":  # also from a reply without motion: the fault is what counts
            return self._rest(readings)
        if self._points.motion.isdisjoint(readings.values):
            if self._phase is _Phase.UNSEEN and readings.state in AT_REST:
                # as an earlier reply showed, which was not handed to us
                self._phase, self._motor.rest_since_s = _Phase.REST, readings.at_s
            return None
        finished: StartRecord | None = None
        if readings.state == "starting":
            finished = self._accelerate(readings)
        elif readings.state == "running":
            finished = self._run(readings)
        elif readings.state == "stopping":
            finished = self._leave(StartOutcome.STOPPED, _Phase.ON)
        else:
            finished = self._rest(readings)
        self._motor.motion_s = readings.at_s
        return finished

    def _accelerate(self, readings: Readings) -> StartRecord | None:
        if self._phase is _Phase.LOST:
            return (
                None  # the start whose record was given up; a motor that was on was started again meanwhile
            )
        is_full = _is_full(readings.values)
        is_accelerating = not self._points.has_acceleration or readings.values.get("accelerating") is True
        start = self._start
        if start is None:
            start = self._begin(readings)
            self._phase, self._motor.was_full = _Phase.STARTING, is_full
        elif self._phase is _Phase.AFTER:
            if is_full or start.began is None:
                return self._stay(start, readings)
            start.ended, self._phase = None, _Phase.STARTING  # it was not over
        if is_accelerating and start.began is None:
            start.began = (self._earliest(start), readings.at_s)
        elif is_full and not self._motor.was_full and start.began is not None:
            self._reach_full_voltage(start, readings.at_s)
        self._motor.was_full = is_full
        return None

    def _earliest(self, start: _Start) -> float:
        """Return after which time the motor began to accelerate; nan when that is not known."""
        if self._motor.motion_s is not None and self._motor.motion_s >= start.seen_s:
            return self._motor.motion_s  # when it was announced already
        return math.nan if start.earliest_s is None else start.earliest_s

    def _run(self, readings: Readings) -> StartRecord | None:
        if any(readings.values.get(name) is True for name in _NOT_A_START):
            return self._leave(StartOutcome.STOPPED, _Phase.ON)
        start = self._start
        if start is None and self._phase is _Phase.REST:
            self._reach_full_voltage(self._begin(readings), readings.at_s)
        elif start is not None and self._phase is not _Phase.AFTER:
            self._reach_full_voltage(start, readings.at_s)
        elif start is not None:
            return self._stay(start, readings)
        else:
            self._phase = _Phase.ON
        return None

    def _stay(self, start: _Start, readings: Readings) -> StartRecord | None:
        """Record the time after full voltage; where no state has shown the ramp, the high current ends it."""
        self._sample(readings)
        if start.began is None and self.rated_a:
            high = [at_s for at_s, value in self._curve.currents() if value > RISEN * self.rated_a]
            start.after_until_s = max([start.after_until_s, *(at_s + AFTER_S for at_s in high[-1:])])
        is_over = readings.at_s >= start.after_until_s
        return self._finish(StartOutcome.FULL_VOLTAGE, _Phase.ON) if is_over else None

    def _reach_full_voltage(self, start: _Start, at_s: float) -> None:
        if start.began is not None and self._motor.motion_s is not None:
            start.ended = (max(self._motor.motion_s, start.began[1]), at_s)
        start.after_until_s = at_s + AFTER_S
        self._phase = _Phase.AFTER

    def _rest(self, readings: Readings) -> StartRecord | None:
        is_fault = readings.state == "fault"
        outcome = StartOutcome.TRIPPED if is_fault else StartOutcome.STOPPED
        if self._phase is not _Phase.REST or self._motor.rest_since_s is None:
            self._motor.rest_since_s = readings.at_s
        return self._leave(outcome, _Phase.REST)

    def _leave(self, outcome: StartOutcome, phase: _Phase) -> StartRecord | None:
        if self._start is None:
            self._phase = phase
            return None
        return self._finish(StartOutcome.FULL_VOLTAGE if self._phase is _Phase.AFTER else outcome, phase)

    def _begin(self, readings: Readings) -> _Start:
        motor, now_s = self._motor, readings.at_s
        rest_s = motor.rest_since_s
        was_found = self._phase is _Phase.UNSEEN
        start = self._start = _Start(
            earliest_s=None if was_found else motor.motion_s,
            seen_s=now_s,
            utc_offset_s=readings.time_s - now_s,
            standstill_s=None if rest_s is None else now_s - rest_s,
            thermal_before=motor.thermal_at(now_s),
            remote=None if was_found else motor.remote,  # who gave it was not seen
            was_found=was_found,
        )
        motor.rest_since_s = None
        return start

    def _sample(self, readings: Readings) -> None:
        if readings.values.keys().isdisjoint(self._points.columns):
            return
        numbers = [readings.number(name) for name in self._points.columns]
        if numbers.count(None) == len(numbers):
            return
        row = tuple([math.nan if number is None else number for number in numbers])
        thermal = numbers[COLUMNS.index("thermal")]
        if thermal is not None:
            self._motor.thermal = (readings.at_s, thermal)
        if not self._curve.at_s or self._curve.at_s[-1] < readings.at_s:
            self._curve.add(readings.at_s, row)
        if self._start is None and len(self._curve.at_s) > MOST_BEFORE:
            self._curve.cut_before(self._curve.at_s[1])

    def _finish(self, outcome: StartOutcome, phase: _Phase) -> StartRecord | None:
        start, curve = self._start, self._curve
        assert start is not None
        command = self._command_of(start)
        zero_s, resolution_s = _instant(_narrowed(start.began, command))
        # When the motor began to accelerate was not seen: between the last reply before and the first after.
        if math.isnan(zero_s):
            earliest_s = start.seen_s if start.earliest_s is None else start.earliest_s
            lower_s = earliest_s if command is None else max(earliest_s, min(command.at_s, start.seen_s))
            zero_s = (lower_s + start.seen_s) / 2 if start.began is None else start.seen_s
            resolution_s = math.nan
        seq = next(self._sequence)
        curve.cut_before(zero_s - BEFORE_S)
        largest_a = LARGEST * self.rated_a if self.rated_a else math.inf
        outliers = curve.drop_outliers(zero_s, largest_a=largest_a)
        record = StartRecord(
            starter=self._starter,
            id=f"{self._boot}-{seq}",
            time_s=zero_s + start.utc_offset_s,
            boot=self._boot,
            seq=seq,
            outcome=outcome,
            cause=_cause(command, start.remote),
            standstill_s=start.standstill_s,
            rated_a=self.rated_a,
            heating_pct=_rise(start.thermal_before, curve.latest("thermal")),
            own=start.own,
            outliers=outliers,
        )
        record = self._measured(record, start, curve, zero_s, resolution_s)
        self._start, self._curve, self._phase = None, Curve(), phase
        self._commands.clear()
        if phase is not _Phase.REST:
            self._motor.rest_since_s = None
        # A start that was given up, as at a lost line, and is found again under way is one start.
        before_s = self.given_up_s
        self.given_up_s = record.time_s if outcome is StartOutcome.GIVEN_UP else None
        if start.was_found and before_s is not None and 0.0 <= record.time_s - before_s <= LONGEST_S:
            return None  # it is recorded
        return replace(record, samples=curve.shown(zero_s))

    def _measured(
        self, record: StartRecord, start: _Start, curve: Curve, zero_s: float, resolution_s: float
    ) -> StartRecord:
        """Return the record with what the samples say of the start."""
        end_s, end_resolution_s = _instant(start.ended)
        acceleration_s, within_s = end_s - zero_s, resolution_s + end_resolution_s
        # No reply has shown the ramp: the high current says how long it took.
        if math.isnan(within_s) and start.began is None and self.rated_a:
            crossed = crossings(curve.currents(), RISEN * self.rated_a)
            if crossed is not None:
                zero_s, end_s = crossed
                rate_hz = rate_hz_of(curve.currents(*crossed), *crossed) or math.nan
                acceleration_s, within_s = end_s - zero_s, 1 / rate_hz
                resolution_s = end_resolution_s = within_s / 2
        # The integrals need both ends of the ramp, or the end that a stop or a trip has made.
        is_known = record.outcome is StartOutcome.FULL_VOLTAGE and not math.isnan(within_s)
        until_s = end_s if is_known else self._last_s
        samples = curve.currents(zero_s, until_s)
        was_cut = record.outcome in (StartOutcome.STOPPED, StartOutcome.TRIPPED)
        has_all = is_known or (was_cut and not math.isnan(resolution_s))
        sums = curve.sums(zero_s, until_s) if has_all else None
        return replace(
            record,
            acceleration_s=acceleration_s if is_known else None,
            resolution_s=within_s if is_known else None,
            peak_a=max((value for _, value in samples), default=None),
            mean_a=None if sums is None else sums.mean_a,
            i2t_a2s=None if sums is None else sums.i2t_a2s,
            i2t_error_pct=None if sums is None else i2t_error_pct_of(sums, resolution_s, end_resolution_s),
            rate_hz=rate_hz_of(samples, zero_s, until_s),
            lowest_v=curve.lowest("line_voltage", zero_s, until_s),
        )

    def _command_of(self, start: _Start) -> StartCommand | None:
        """Return the latest start command of the gateway that this can be."""
        earliest_s = start.seen_s if start.earliest_s is None else start.earliest_s
        since_s = min(earliest_s, start.seen_s - FITS_S)
        fitting = [each for each in self._commands if since_s <= each.at_s <= start.seen_s + BEFORE_S]
        return fitting[-1] if fitting else None


def _is_full(values: Mapping[str, object]) -> bool:
    return values.get("full_voltage") is True or values.get("bypass_closed") is True


def _narrowed(
    between: tuple[float, float] | None, command: StartCommand | None
) -> tuple[float, float] | None:
    """Return between which times the start began, given that our command was written before it."""
    if between is None or command is None or math.isnan(between[0]):
        return between
    return min(max(between[0], command.at_s), between[1]), between[1]


def _instant(between: tuple[float, float] | None) -> tuple[float, float]:
    """Return the middle of two times and half their distance; nan when they are not known."""
    if between is None:
        return math.nan, math.nan
    return (between[0] + between[1]) / 2, (between[1] - between[0]) / 2


def _cause(command: StartCommand | None, remote: bool | None) -> Cause:  # noqa: FBT001 - a reading
    if command is not None:
        return Cause(StartSource.COMMAND, command.client, command.id)
    if remote is None:
        return Cause()
    return Cause(StartSource.REMOTE if remote else StartSource.LOCAL)


def _rise(before: float | None, after: float | None) -> float | None:
    return None if before is None or after is None else after - before
