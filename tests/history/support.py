"""A motor with an analytic start, and the replies in which a gateway reads it."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from types import MappingProxyType

from gateway.contract import Record, StartRecord
from gateway.families.profile.load import load_profile
from gateway.plugins.history.delivery import StoredRecords
from gateway.plugins.history.start_recorder import StartPoints, StartRecorder
from gateway.starters import Readings, Value

UTC_S = 1_795_222_000.0  # minus the steady clock
POINTS = StartPoints.of(load_profile("ssw07"))
RATED_A = 100.0
READ_BACK_S = 0.05  # after a start was written


@dataclass(frozen=True)
class AnalyticStart:
    """A ramp: 150 A at once, up to the peak in a tenth of the ramp, down to the load in the last 15 %."""

    begin_s: float
    ramp_s: float = 8.0
    peak_a: float = 350.0
    load_a: float = 80.0
    first_a: float = 150.0

    @property
    def end_s(self) -> float:
        return self.begin_s + self.ramp_s

    def current_a(self, at_s: float) -> float:
        part = (at_s - self.begin_s) / self.ramp_s
        if part < 0:
            return 0.0
        if part < 0.1:
            return self.first_a + (self.peak_a - self.first_a) * part / 0.1
        if part <= 0.85:
            return self.peak_a
        return self.load_a + (self.peak_a - self.load_a) * max(0.0, 1 - part) / 0.15

    def i2t_a2s(self) -> float:
        def straight(one: float, other: float, part: float) -> float:
            return (one * one + one * other + other * other) / 3 * part * self.ramp_s

        up, flat = straight(self.first_a, self.peak_a, 0.1), straight(self.peak_a, self.peak_a, 0.75)
        return up + flat + straight(self.peak_a, self.load_a, 0.15)

    def mean_a(self) -> float:
        up, down = (self.first_a + self.peak_a) / 2 * 0.1, (self.peak_a + self.load_a) / 2 * 0.15
        return up + 0.75 * self.peak_a + down


@dataclass
class ReadMotor:
    """A motor as it is read: status and current in replies of their own, faster while it starts."""

    start: AnalyticStart
    end_state: str = "running"  # after the ramp
    idle_s: float = 1.0
    fast_s: float = 0.25
    jitter: float = 0.2  # of a period, to either side
    noise: float = 0.0  # of the current
    seed: int = 1
    cut_s: float | None = None  # the ramp is cut to `cut_state` at this time
    cut_state: str = "stopping"
    is_ours: bool = False  # then the start is read back at once
    lost: tuple[float, float] | None = None  # no replies
    random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)

    def state(self, at_s: float) -> str:
        if self.cut_s is not None and at_s >= self.cut_s:
            return self.cut_state
        if at_s < self.start.begin_s:
            return "ready"
        return "starting" if at_s < self.start.end_s else self.end_state

    def replies(self, since_s: float, until_s: float) -> Iterator[Readings]:
        """Give status and then values, each period with some jitter."""
        at_s, values_s, seen = since_s, -1e9, "ready"
        while at_s < until_s:
            is_lost = self.lost is not None and self.lost[0] <= at_s < self.lost[1]
            if not is_lost:
                state = seen = self.state(at_s)
                motion: dict[str, Value] = {
                    "running": state in ("starting", "running"),
                    "accelerating": state == "starting",
                    "full_voltage": state == "running",
                    "bypass_closed": False,
                    "remote": True,
                    "fault": state == "fault",
                }
                yield Readings(at_s, UTC_S + at_s, state, motion)
                is_due = seen != "ready" or at_s - values_s >= 3 * self.idle_s
                if is_due:
                    values_s = at_s + min(0.03, 0.4 * self.fast_s)
                    is_fed = self.cut_s is None or values_s < self.cut_s
                    current_a = self.start.current_a(values_s) if is_fed else 0.0
                    current_a *= 1 + self.noise * self.random.gauss(0, 1)
                    yield Readings(values_s, UTC_S + values_s, seen, {"current": current_a})
            period_s = self.idle_s if seen == "ready" else self.fast_s
            next_s = at_s + period_s * (1 + self.jitter * self.random.uniform(-1, 1))
            is_between = at_s < self.start.begin_s < next_s
            at_s = self.start.begin_s + READ_BACK_S if self.is_ours and is_between else next_s


def stored_at_once(_: Record) -> Future[None]:
    """Stand for an outbox that stores at once."""
    done: Future[None] = Future()
    done.set_result(None)
    return done


async def no_payloads(_: Sequence[str]) -> dict[str, bytes]:
    return {}


NO_OUTBOX = StoredRecords(keep=stored_at_once, payloads=no_payloads, let_go=lambda _: None)


def recorder() -> StartRecorder:
    made = StartRecorder("pump", POINTS, boot="boot", sequence=itertools.count(1))
    made.rated_a = RATED_A
    return made


def records(
    motor: ReadMotor,
    *,
    until_s: float = 60.0,
    one: StartRecorder | None = None,
    wrong: Mapping[int, float] = MappingProxyType({}),
) -> list[StartRecord]:
    """Return what a recorder makes of a motor, of which some currents since the start are read wrongly.

    A start of ours is a command of Alice's, c1.
    """
    one, found, numbers = one or recorder(), [], itertools.count()
    if motor.is_ours:
        one.note_command("alice", "c1", motor.start.begin_s)
    for readings in motor.replies(0.0, until_s):
        values = readings.values
        if "current" in values and readings.at_s >= motor.start.begin_s:
            values = {"current": wrong.get(next(numbers), values["current"])}
        found.append(one.take(readings._replace(values=values)))
    return [each for each in found if each is not None]


def sole(found: list[StartRecord]) -> StartRecord:
    (record,) = found
    return record
