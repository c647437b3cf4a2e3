"""From readings to the record of a start: when it began and ended, who gave it, what the current did.

The theory, in the order in which it is applied:

1. A motor is at rest (ready, not_ready, fault), accelerating (starting), on (running) or stopping, by the
   state as of a reply that holds the points of motion; another reply only brings samples.
2. A start begins when a motor that was seen at rest or stopping is accelerating or on. It ends at full
   voltage (or bypass), at a trip, at a stop, or when the starter is lost: then what is known is recorded, and
   nothing is a new start until the motor was seen at rest again.
3. The instant of a change lies between two replies. It is taken in the middle, so it is known to plus or
   minus half the time between them; our command that was written between them narrows that down.
4. Samples go on for 5 s after full voltage, so that the current of the load is seen too.
5. A current above ten times the rated one, and a lone one that is four times as high as both its neighbours,
   is a reading that went wrong: it is counted, and enters nothing.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.contract import Cause, StartOutcome, StartRecord
from gateway.families import Profile, once_per_profile
from gateway.plugins.history.start_curve import COLUMNS, Curve, i2t_error_pct_of
from gateway.starters import Readings

BEFORE_S = 1.0  # samples begin so long before the start
AFTER_S = 5.0  # and go on for so long after full voltage
LONGEST_S = 300.0  # a motor that accelerates longer is given up
LARGEST = 10.0  # times the rated current, which is also as far as S1.1.4 goes [SSW900, table A.2]
FITS_S = 10.0  # from the write of a start until the motor is seen to start (verify, 5 s, and a poll)
THERMAL_VALID_S = 120.0  # a thermal level of the motor at rest
MOST_COMMANDS = 4
MOST_BEFORE = 32  # samples that are remembered of the time before a start

AT_REST = frozenset({"ready", "not_ready", "fault"})
_Command = tuple[str, str | None]  # its client and id
_NOT_A_START = ("jog", "braking", "reversing")  # on, but not by a start


@dataclass(frozen=True, slots=True)
class StartPoints:
    """Which points of a family the recorder looks at."""

    motion: frozenset[str]  # a reply with one of them shows whether the motor moves
    columns: tuple[str, ...]  # the point of each of `COLUMNS`

    @staticmethod
    @once_per_profile
    def of(profile: Profile) -> StartPoints:
        """Return those of a family."""
        motion = {name for name, state in profile.state.order.items() if state in ("starting", "running")}
        columns = (profile.thermal_point if name == "thermal" else name for name in COLUMNS)
        return StartPoints(frozenset(motion), tuple(columns))


class _Phase(enum.Enum):
    UNSEEN = "unseen"  # nothing is known yet
    REST = "rest"  # or it was when the starter was lost
    STARTING = "starting"  # the start was accepted; `_Start.began` says whether the motor accelerates
    AFTER = "after"  # at full voltage, still recorded
    ON = "on"  # or stopping, or it was when the starter was lost
    LOST = "lost"  # during a start, which was given up


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
    was_full: bool = False  # at full voltage, by the latest reply that showed it accelerating
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
        self._commands: dict[_Command, float] = {}  # of starts by the gateway: when each was written
        self._start: _Start | None = None
        self._curve = Curve()  # of the start under way; before it, of the latest samples
        self._last_s = -math.inf
        self._motion_s: float | None = None  # of the latest reply that showed whether the motor moves
        self._rest_since_s: float | None = None
        self._remote: bool | None = None
        self._thermal: tuple[float, float] | None = None  # time, level
        self.rated_a: float | None = None
        self.given_up_s: float | None = None  # UTC, when the latest start began, if that was given up

    def note_command(self, client: str, command_id: str | None, at_s: float) -> None:
        """Record that a start command of the gateway was just written."""
        self._commands[client, command_id] = at_s
        if len(self._commands) > MOST_COMMANDS:
            del self._commands[next(iter(self._commands))]

    def forget_command(self, client: str, command_id: str | None) -> None:
        """Record that the starter has refused a start command of the gateway."""
        self._commands.pop((client, command_id), None)

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
            self._remote = remote
        finished = self._follow(readings)
        self._sample(readings)
        if self._start is not None and readings.at_s - self._start.seen_s > LONGEST_S:
            return self.lose()
        return finished

    def lose(self) -> StartRecord | None:
        """Record that the starter is not read any more; return the start that is over by it."""
        match self._phase:
            case _Phase.STARTING:
                return self._finish("given_up", _Phase.LOST)
            case _Phase.AFTER:
                return self._finish("full_voltage", _Phase.ON)
            case _:
                self._rest_since_s = None  # it may have been started meanwhile
                return None

    def _follow(self, readings: Readings) -> StartRecord | None:
        match readings.state:
            case "unknown":
                return self.lose()
            case "fault":  # also from a reply without motion: the fault is what counts
                return self._leave(readings, _Phase.REST)
            case state if self._points.motion.isdisjoint(readings.values):
                if self._phase is _Phase.UNSEEN and state in AT_REST:
                    # as an earlier reply showed, which was not handed to us
                    self._phase, self._rest_since_s = _Phase.REST, readings.at_s
                return None
            case "starting":
                finished = self._accelerate(readings)
            case "running":
                finished = self._run(readings)
            case "stopping":
                finished = self._leave(readings, _Phase.ON)
            case _:
                finished = self._leave(readings, _Phase.REST)
        self._motion_s = readings.at_s
        return finished

    def _accelerate(self, readings: Readings) -> StartRecord | None:
        if self._phase is _Phase.LOST:
            return None  # the start that was given up; a motor that was on was started again meanwhile
        values, at_s = readings.values, readings.at_s
        is_full = values.get("full_voltage") is True or values.get("bypass_closed") is True
        start = self._start
        if start is None:
            start = self._begin(readings)
            self._phase, start.was_full = _Phase.STARTING, is_full
        elif self._phase is _Phase.AFTER:
            if is_full or start.began is None:
                return self._stay(start, readings)
            start.ended, self._phase = None, _Phase.STARTING  # it was not over
        if values.get("accelerating") is True and start.began is None:
            # Where the start was announced already, it accelerates since the reply before this one.
            is_announced = self._motion_s is not None and self._motion_s >= start.seen_s
            earliest_s = self._motion_s if is_announced else start.earliest_s
            start.began = (math.nan if earliest_s is None else earliest_s, at_s)
        elif is_full and not start.was_full and start.began is not None:
            self._reach_full_voltage(start, at_s)
        start.was_full = is_full
        return None

    def _run(self, readings: Readings) -> StartRecord | None:
        if any(readings.values.get(name) is True for name in _NOT_A_START):
            return self._leave(readings, _Phase.ON)
        if self._start is None and self._phase is not _Phase.REST:
            self._phase = _Phase.ON
            return None
        start = self._start or self._begin(readings)
        if self._phase is _Phase.AFTER:
            return self._stay(start, readings)
        self._reach_full_voltage(start, readings.at_s)
        return None

    def _stay(self, start: _Start, readings: Readings) -> StartRecord | None:
        """Record the time after full voltage, the reply that ends it too."""
        self._sample(readings)
        is_over = readings.at_s >= start.after_until_s
        return self._finish("full_voltage", _Phase.ON) if is_over else None

    def _reach_full_voltage(self, start: _Start, at_s: float) -> None:
        if start.began is not None and self._motion_s is not None:
            start.ended = (max(self._motion_s, start.began[1]), at_s)
        start.after_until_s = at_s + AFTER_S
        self._phase = _Phase.AFTER

    def _leave(self, readings: Readings, phase: _Phase) -> StartRecord | None:
        """End the start under way, if there is one, by a trip or a stop."""
        if phase is _Phase.REST and (self._phase is not phase or self._rest_since_s is None):
            self._rest_since_s = readings.at_s
        if self._start is None:
            self._phase = phase
            return None
        is_fault, is_up = readings.state == "fault", self._phase is _Phase.AFTER
        outcome: StartOutcome = "tripped" if is_fault else "stopped"
        return self._finish("full_voltage" if is_up else outcome, phase)

    def _begin(self, readings: Readings) -> _Start:
        now_s, rest_s, thermal = readings.at_s, self._rest_since_s, self._thermal
        is_warm = thermal is not None and now_s - thermal[0] <= THERMAL_VALID_S
        was_found = self._phase is _Phase.UNSEEN
        self._start = _Start(
            earliest_s=None if was_found else self._motion_s,
            seen_s=now_s,
            utc_offset_s=readings.time_s - now_s,
            standstill_s=None if rest_s is None else now_s - rest_s,
            thermal_before=thermal[1] if thermal is not None and is_warm else None,
            remote=None if was_found else self._remote,  # who gave it was not seen
            was_found=was_found,
        )
        self._rest_since_s = None
        return self._start

    def _sample(self, readings: Readings) -> None:
        if readings.values.keys().isdisjoint(self._points.columns):
            return
        numbers = [readings.number(name) for name in self._points.columns]
        if numbers.count(None) == len(numbers):
            return
        thermal = numbers[COLUMNS.index("thermal")]
        if thermal is not None:
            self._thermal = (readings.at_s, thermal)
        if not self._curve.at_s or self._curve.at_s[-1] < readings.at_s:
            row = tuple([math.nan if number is None else number for number in numbers])
            self._curve.add(readings.at_s, row)
        if self._start is None and len(self._curve.at_s) > MOST_BEFORE:
            self._curve.cut_before(self._curve.at_s[1])

    def _finish(self, outcome: StartOutcome, phase: _Phase) -> StartRecord | None:
        start, curve = self._start, self._curve
        assert start is not None
        earliest_s = start.seen_s if start.earliest_s is None else start.earliest_s
        command = self._command_of(start, earliest_s)
        since_s, until_s = start.began or (math.nan, math.nan)
        was_seen = not math.isnan(since_s)
        if not was_seen:  # when it began to accelerate: between the last reply before and the first after
            since_s, until_s = earliest_s, start.seen_s
        if command is not None:  # it began after the write of our command
            since_s = min(max(since_s, self._commands[command]), until_s)
        zero_s, end_s = _middle(since_s, until_s), _middle(*(start.ended or (math.nan, math.nan)))
        begin_within_s = until_s - zero_s if was_seen else math.nan
        end_within_s = math.nan if start.ended is None else start.ended[1] - end_s
        # The integrals need both ends of the ramp, or the end that a stop or a trip has made.
        is_known = outcome == "full_voltage" and was_seen and start.ended is not None
        was_cut = outcome in ("stopped", "tripped")
        ramp = zero_s, end_s if is_known else self._last_s
        seq = next(self._sequence)
        curve.cut_before(zero_s - BEFORE_S)
        outliers = curve.drop_outliers(zero_s, largest_a=LARGEST * self.rated_a if self.rated_a else math.inf)
        currents = curve.currents(*ramp)
        sums = curve.sums(*ramp) if is_known or (was_cut and was_seen) else None
        record = StartRecord(
            starter=self._starter,
            id=f"{self._boot}-{seq}",
            time_s=zero_s + start.utc_offset_s,
            boot=self._boot,
            seq=seq,
            outcome=outcome,
            cause=_cause(command, start.remote),
            standstill_s=start.standstill_s,
            acceleration_s=end_s - zero_s if is_known else None,
            resolution_s=begin_within_s + end_within_s if is_known else None,
            rated_a=self.rated_a,
            peak_a=max((value for _, value in currents), default=None),
            mean_a=None if sums is None else sums.mean_a,
            i2t_a2s=None if sums is None else sums.i2t_a2s,
            i2t_error_pct=None if sums is None else i2t_error_pct_of(sums, begin_within_s, end_within_s),
            rate_hz=len(currents) / (ramp[1] - zero_s) if currents and ramp[1] > zero_s else None,
            lowest_v=curve.lowest("line_voltage", *ramp),
            heating_pct=_rise(start.thermal_before, curve.latest("thermal")),
            own=start.own,
            outliers=outliers,
            samples=curve.shown(zero_s),
        )
        self._start, self._curve, self._phase = None, Curve(), phase
        self._commands.clear()
        if phase is not _Phase.REST:
            self._rest_since_s = None
        # A start that was given up, as at a lost line, and is found again under way is one start.
        before_s = self.given_up_s
        self.given_up_s = record.time_s if outcome == "given_up" else None
        is_same = start.was_found and before_s is not None and 0.0 <= record.time_s - before_s <= LONGEST_S
        return None if is_same else record

    def _command_of(self, start: _Start, earliest_s: float) -> _Command | None:
        """Return the latest start command of the gateway that this can be."""
        since_s = min(earliest_s, start.seen_s - FITS_S)
        until_s = start.seen_s + BEFORE_S
        fitting = [command for command, at_s in self._commands.items() if since_s <= at_s <= until_s]
        return fitting[-1] if fitting else None


def _middle(since_s: float, until_s: float) -> float:
    return (since_s + until_s) / 2


def _cause(command: _Command | None, remote: bool | None) -> Cause:  # noqa: FBT001 - a reading
    if command is not None:
        return Cause("command", *command)
    if remote is None:
        return Cause()
    return Cause("remote" if remote else "local")


def _rise(before: float | None, after: float | None) -> float | None:
    return None if before is None or after is None else after - before
