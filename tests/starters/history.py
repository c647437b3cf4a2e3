"""What a history of a world must look like, whatever happened in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from gateway.contract import Phase, ResultRecord, StateRecord
from gateway.starters.policy.motor_history import MOVING, STANDING
from tests.starters.world import NAMES, PAUSE_S, STAGGER_S, START_PDU, STARTS_PER_HOUR, STOP_PDU, GatewayWorld

STOP_BOUND_S = 1.0  # two starters at 19200 bit/s, one of which may be silent
REOPENED_S = 10.0  # after it was plugged in, the port is open for sure
TTL_S = 5.0
READINGS = 2  # that confirm a stop
BURST, BURST_S = 7, 1.0  # so many stop messages of one starter have frames of their own, in such a time
SLACK_S = 0.3  # what a frame may be later than the decision: a few transactions of the line


class History:
    """All that went over the wire and was published; `lawful` are the starts that may be, as starter and id,
    each with the time until which its frame may go out."""

    def __init__(self, world: GatewayWorld, lawful: Mapping[tuple[str, str], float]) -> None:
        self._world = world
        self._lawful = lawful

    def check(self) -> None:
        """AssertionError for what must never happen."""
        for name in NAMES:
            self._check_starts(name)
            self._check_stops(name)
        self._check_stagger()
        self._check_ends()

    def _check_starts(self, name: str) -> None:
        """Every start frame belongs to a lawful start that was under way, and is its only one."""
        frames = self._world.frames(name, START_PDU)
        accepted = [
            (at_s, str(each.id))
            for at_s, each in self._world.results([name])
            if each.verb == "start" and each.phase is Phase.ACCEPTED
        ]
        used: set[str] = set()
        for frame_s in frames:
            _, id_ = max(each for each in accepted if each[0] <= frame_s)
            assert (name, id_) in self._lawful
            assert id_ not in used, "two start frames for one id"
            assert frame_s <= self._lawful[name, id_] + SLACK_S, "a start that came late"
            used.add(id_)
            assert not self._was_locked(name, frame_s)
            assert len([each for each in frames if frame_s - 3600 < each <= frame_s]) <= STARTS_PER_HOUR
            assert self._stood_for_s(name, frame_s) >= PAUSE_S - SLACK_S

    def _was_locked(self, name: str, at_s: float) -> bool:
        """Return whether a lock had been confirmed, and no unlocking been accepted since."""
        is_locked = False
        for result_s, each in self._world.results([name]):
            if (each.verb, each.phase) == ("lock", Phase.CONFIRMED) and result_s + SLACK_S <= at_s:
                is_locked = True
            elif each.verb == "unlock" and result_s <= at_s:
                # An unlocking that was stored before a crash counts, although no result says so.
                is_locked = is_locked and each.phase is not Phase.ACCEPTED and each.code != "crashed"
        return is_locked

    def _stood_for_s(self, name: str, at_s: float) -> float:
        """Return how long the motor had been published as standing still."""
        since_s = None
        for state_s, record in self._world.of(StateRecord):
            if record.starter != name or state_s > at_s - SLACK_S:
                continue
            if record.state in MOVING:
                since_s = None
            elif record.state in STANDING and since_s is None:
                since_s = state_s
        return 0.0 if since_s is None else at_s - since_s

    def _check_stagger(self) -> None:
        frames = sorted((at_s, name) for name in NAMES for at_s in self._world.frames(name, START_PDU))
        for (one_s, one), (two_s, two) in pairwise(frames):
            assert one == two or two_s - one_s >= STAGGER_S - SLACK_S

    def _check_stops(self, name: str) -> None:
        """Every accepted stop leads to a frame soon, where the line is there; none is confirmed before."""
        frames = self._world.frames(name, STOP_PDU)
        readings = self._world.readings(name)
        unused = list(frames)
        came_s: list[float] = []
        accepted_s: dict[tuple[str, str | None], float] = {}
        for at_s, each in self._world.results([name]):
            if each.verb != "stop" or _is_number_of_stops(each):
                continue
            if each.phase is Phase.ACCEPTED:
                accepted_s[each.client, each.id] = at_s
                if self._is_line_there(at_s):
                    assert any(at_s <= frame_s <= at_s + STOP_BOUND_S for frame_s in frames)
                    self._take_own_frame(unused, came_s, at_s)
                came_s.append(at_s)
            elif each.phase is Phase.CONFIRMED:
                since_s = accepted_s.pop((each.client, each.id))
                first_s = next(frame_s for frame_s in frames if frame_s >= since_s)
                assert sum(first_s < read_s < at_s for read_s in readings) >= READINGS, (
                    "read before its frame"
                )

    def _take_own_frame(self, unused: list[float], came_s: Sequence[float], at_s: float) -> None:
        """Find the frame of one message among those that no earlier one has; beyond a burst they share."""
        if sum(at_s - BURST_S <= each for each in came_s) >= BURST:
            return
        own_s = next((each for each in unused if at_s <= each <= at_s + STOP_BOUND_S), None)
        assert own_s is not None, "a stop message without a frame of its own"
        unused.remove(own_s)

    def _is_line_there(self, at_s: float) -> bool:
        """Return whether the gateway could use its line just then."""
        world = self._world
        plugged = [is_plugged for plug_s, is_plugged in world.plugs if plug_s <= at_s]
        is_disturbed = any(
            at_s - REOPENED_S < disturbed_s <= at_s + STOP_BOUND_S for disturbed_s in world.disturbances_s
        )
        return plugged[-1] and not is_disturbed

    def _is_started(self, name: str, since_s: float, until_s: float) -> bool:
        """Return whether a start was written to a starter, or to any of a group."""
        names = [name] if name in NAMES else NAMES
        return any(
            since_s <= at_s <= until_s for each in names for at_s in self._world.frames(each, START_PDU)
        )

    def _check_ends(self) -> None:
        """Every command that was accepted has one end; a group's stands for its members' when cut short.

        One that was refused at the door leaves no trace: sent again with a good proof it is another command.
        """
        results = self._world.results([*NAMES, "both"])
        groups = {(each.client, each.id) for _, each in results if each.starter == "both"}
        accepted, forgotten, ends = set(), set(), []
        for at_s, each in results:
            key = (each.starter, each.client, each.id)
            if _is_number_of_stops(each) or (each.starter != "both" and key[1:] in groups):
                continue
            if each.phase is Phase.ACCEPTED:
                assert key not in accepted, "accepted twice"
                accepted.add(key)
                # A command is accepted before it is stored; a crash may come between where the disk is slow,
                # and until then nothing but a stop is written.
                crash_s = next((b for a, b in self._world.unstored if a <= at_s <= b), None)
                if crash_s is not None and not self._is_started(each.starter, at_s, crash_s):
                    forgotten.add(key)
            elif each.phase.is_final:
                if key in accepted:
                    ends.append(key)
                else:
                    # The crash may have come between what was stored and what was said. What a disk is too
                    # slow for is not said before the end.
                    assert each.phase is Phase.REJECTED or each.code in ("crashed", "not_kept")
        assert accepted <= set(ends) | forgotten | self._sent_ends()
        for key in accepted.intersection(ends):
            assert ends.count(key) == 1, [
                (a, r.phase, r.code, r.text, r.is_duplicate) for a, r in results if r.id == key[2]
            ]

    def _sent_ends(self) -> set[tuple[str, str, str | None]]:
        """Return the commands of which the broker has a final result.

        One that was stored right before a crash is not said again: the outbox sends it.
        """
        return {
            (*each.topic.split("/")[-2:], each.json["id"])
            for each in self._world.plant.broker.log
            if "/result/" in each.topic and Phase(each.json["phase"]).is_final
        }


def _is_number_of_stops(result: ResultRecord) -> bool:
    """Return whether this says how many more were sent with others; of the model's stops each has an id."""
    return result.verb == "stop" and result.id is None
