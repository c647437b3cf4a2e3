"""Whatever happens, in whatever order: a start goes out once at most, lawfully; every command has one end.

Random commands, repetitions, reconnections, losses, crashes, local operations, locks and clock steps come
over a real commander with a simulated line under it, in virtual time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from itertools import pairwise
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from gateway.mqtt.json_out import rfc3339
from gateway.starters.logbook import MOVING, STANDING
from gateway.starters.records import Phase, StateRecord
from tests.starters.world import NAMES, PAUSE_S, STAGGER_S, START_PDU, STARTS_PER_HOUR, STOP_PDU, World
from tests.virtual_time import VirtualTimeLoop

STOP_BOUND_S = 1.0  # two starters at 19200 bit/s, one of which may be silent
REOPENED_S = 10.0  # after it was plugged in, the port is open for sure
ONLINE_S = 2.0
SETTLED_S = 15.0  # a stop has 10 s, a status after a crash as long
TTL_S = 5.0
AHEAD_S = 2.0
SLACK_S = 0.3  # what a frame may be later than the decision: a few transactions of the line

starters, clients = st.sampled_from(NAMES), st.sampled_from(["alice", "bob", "mallory"])
flips = st.sampled_from([False, False, False, True])
waits = st.sampled_from([0.02, 0.05, 0.1, 0.3, 1.0, 3.0])
proofs = st.sampled_from(["token", "token", "token", "earlier token", "issued", "nothing"])


class CommandMachine(RuleBasedStateMachine):
    """The model keeps what was lawful when it was sent; the rest is read from the wire and the records."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = VirtualTimeLoop()
        self.world: World = self.run(self.begin())
        self.ids = 0
        self.lawful: set[tuple[str, str]] = set()  # starts: starter and id
        self.sent: list[tuple[str, str, str]] = []  # starts: starter, client and id
        self.tokens: list[str] = ["never given"]

    def run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return self.loop.run_until_complete(work)

    async def begin(self) -> World:
        world = World()
        await asyncio.sleep(ONLINE_S + PAUSE_S)
        return world

    def do(self, act: Any) -> None:
        """Do something on the loop, and let what it sets going be begun."""

        async def acting() -> None:
            outcome = act()
            if asyncio.iscoroutine(outcome):
                await outcome
            await asyncio.sleep(0.001)

        self.run(acting())

    def new_id(self) -> str:
        self.ids += 1
        return str(self.ids)

    def proof(self, kind: str, age_s: float) -> tuple[dict[str, Any], bool]:
        """Return what is sent to prove a command fresh, and whether it does."""
        world = self.world
        now_s = world.clock.now_s()
        if kind == "token":
            return {"boot": world.boot.token}, True
        if kind == "earlier token":
            return {"boot": self.tokens[-1]}, False
        if kind == "issued":
            is_fresh = -AHEAD_S < age_s < TTL_S and now_s - age_s > world.connected_s
            return {"issued_at": rfc3339(world.clock.utc_s() - age_s)}, is_fresh
        return {}, False

    @rule(starter=starters, client=clients, kind=proofs, age_s=st.floats(-4, 8), retained=flips)
    def start_somehow(self, starter: str, client: str, kind: str, age_s: float, retained: bool) -> None:
        id_, (proof, is_fresh) = self.new_id(), self.proof(kind, age_s)
        may = client == "alice" or (client == "bob" and starter == "a")
        if is_fresh and may and not retained:
            self.lawful.add((starter, id_))
        self.sent.append((starter, client, id_))
        self.do(lambda: self.world.publish(starter, client, "start", id=id_, is_retained=retained, **proof))

    @rule(starter=starters, seconds=waits)
    def start(self, starter: str, seconds: float) -> None:
        self.start_somehow(starter, "alice", "token", 0.0, retained=False)
        self.wait(seconds)

    @rule(starter=starters)
    def start_unlawfully(self, starter: str) -> None:
        """Send starts that would be right but for one thing each."""
        self.bring_to_rest(starter)
        for client, kind, age_s, retained in (
            ("alice", "token", 0.0, True),
            ("mallory", "token", 0.0, False),
            ("alice", "issued", TTL_S + 1.0, False),
            ("alice", "earlier token", 0.0, False),
            ("alice", "issued", 0.5, False),  # before the connection
        ):
            if kind != "token":
                self.reconnect()
            self.start_somehow(starter, client, kind, age_s, retained)
            self.wait(0.3)

    @rule(starter=starters, seconds=st.sampled_from([1.0, 3.0]))
    def restart(self, starter: str, seconds: float) -> None:
        self.start(starter, 1.0)
        self.stop(starter, "alice")
        self.wait(seconds)
        self.start(starter, 0.3)

    @rule()
    def start_both_at_once_and_stop_them(self) -> None:
        for starter in NAMES:
            self.bring_to_rest(starter)
        for starter in NAMES:
            self.start(starter, 0.0)
        self.wait(1.0)
        self.stop("both", "alice")
        self.wait(1.0)

    @rule(starter=starters, state=st.sampled_from(["ready", "running"]))
    def start_expecting(self, starter: str, state: str) -> None:
        id_ = self.new_id()
        if state == "ready":  # a start of what runs is unlawful in any case
            self.lawful.add((starter, id_))
        proof = {"boot": self.world.boot.token, "expect": {"state": state}}
        self.do(lambda: self.world.publish(starter, "alice", "start", id=id_, **proof))

    @precondition(lambda self: self.sent)
    @rule(data=st.data())
    def repeat_a_start(self, data: st.DataObject) -> None:
        """Send a known id again, with the best of proofs: it may be lawful only as what it was at first."""
        starter, client, id_ = data.draw(st.sampled_from(self.sent[-5:]))
        if (starter, id_) not in self.lawful and not self.was_taken(client, id_):
            return  # one that was refused for its form may well be sent anew; that is another command
        self.do(lambda: self.world.publish(starter, client, "start", id=id_, boot=self.world.boot.token))

    def was_taken(self, client: str, id_: str) -> bool:
        return any(
            (each.client, each.id, each.phase) == (client, id_, Phase.ACCEPTED)
            for _, each in self.world.results(NAMES)
        )

    @rule(starter=st.sampled_from([*NAMES, "both"]), client=clients)
    def stop(self, starter: str, client: str) -> None:
        id_ = self.new_id()
        self.do(lambda: self.world.publish(starter, client, "stop", id=id_))

    @rule(starter=starters, is_locked=st.sampled_from([False, False, True]))
    def lock(self, starter: str, is_locked: bool) -> None:
        verb, token = "lock" if is_locked else "unlock", self.world.boot.token
        body = {"id": self.new_id(), "boot": token, "args": {"reason": "belt"}}
        self.do(lambda: self.world.publish(starter, "alice", verb, **body))

    @rule(seconds=waits)
    def wait(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    def bring_to_rest(self, starter: str) -> None:
        """Make it likely that nothing but what is being tried stands in the way of a start."""
        if self.world.units[starter].motor.is_turning:
            self.stop(starter, "alice")
            self.wait(1.0 + PAUSE_S)

    def reconnect(self) -> None:
        self.tokens.append(self.world.boot.token)
        self.do(self.world.boot.disconnected)
        self.do(self.world.connect)

    def crash(self) -> None:
        self.tokens.append(self.world.boot.token)
        self.do(self.world.crash)

    @rule(starter=starters)
    def crash_and_start(self, starter: str) -> None:
        self.bring_to_rest(starter)
        self.crash()
        self.wait(ONLINE_S + PAUSE_S)
        self.start(starter, 0.3)

    @rule(starter=starters)
    def start_on_a_slow_disk(self, starter: str) -> None:
        self.bring_to_rest(starter)
        self.world.journal.disk_s = TTL_S + 1.0
        self.start(starter, TTL_S + 2.0)
        self.world.journal.disk_s = 0.0

    @rule(data=st.data())
    def disturb_again(self, data: st.DataObject) -> None:
        self.disturb(data)

    @rule(data=st.data())
    def disturb(self, data: st.DataObject) -> None:
        """Let one of the things happen that should not."""
        world, starter = self.world, data.draw(starters)
        match data.draw(st.sampled_from(["gateway", "line", "people", "answers", "broker", "clock", "disk"])):
            case "broker":
                self.reconnect()
            case "clock":
                world.clock.epoch_s += data.draw(st.sampled_from([-86400.0, -3.0, 3.0, 86400.0]))
            case "answers":
                kind = data.draw(st.sampled_from(["none", "writes", "all"]))
                self.do(lambda: world.impair(starter, kind))
            case "line":
                self.do(lambda: world.plug(is_plugged=not world.is_plugged))
            case "disk":
                world.journal.disk_s = data.draw(st.sampled_from([0.0, 0.0, 0.0, 0.3, 6.0]))
            case "people":
                is_start = data.draw(st.booleans())
                self.do(lambda: world.operate_locally(starter, is_start=is_start))
            case _:
                self.crash()

    def teardown(self) -> None:
        self.run(self.settle())
        for name in NAMES:
            self.check_starts(name)
            self.check_stops(name)
        self.check_stagger()
        self.check_ends()
        self.run(self.world.close())
        self.loop.close()

    async def settle(self) -> None:
        for name in NAMES:
            self.world.impair(name, "none")
        if not self.world.is_plugged:
            self.world.plug(is_plugged=True)
        await asyncio.sleep(SETTLED_S)

    def check_starts(self, name: str) -> None:
        """Every start frame belongs to a lawful start that was under way, and is its only one."""
        frames = self.world.frames(name, START_PDU)
        accepted = [
            (at_s, str(each.id))
            for at_s, each in self.world.results([name])
            if each.verb == "start" and each.phase is Phase.ACCEPTED
        ]
        used: set[str] = set()
        for frame_s in frames:
            at_s, id_ = max(each for each in accepted if each[0] <= frame_s)
            assert (name, id_) in self.lawful
            assert id_ not in used, "two start frames for one id"
            assert frame_s - at_s <= TTL_S + SLACK_S, "a start that came late"
            used.add(id_)
            assert not self.was_locked(name, frame_s)
            assert len([each for each in frames if frame_s - 3600 < each <= frame_s]) <= STARTS_PER_HOUR
            assert self.stood_for_s(name, frame_s) >= PAUSE_S - SLACK_S

    def was_locked(self, name: str, at_s: float) -> bool:
        """Return whether a lock had been confirmed, and no unlocking been accepted since."""
        is_locked = False
        for told_s, each in self.world.results([name]):
            if (each.verb, each.phase) == ("lock", Phase.CONFIRMED) and told_s + SLACK_S <= at_s:
                is_locked = True
            elif (each.verb, each.phase) == ("unlock", Phase.ACCEPTED) and told_s <= at_s:
                is_locked = False
        return is_locked

    def stood_for_s(self, name: str, at_s: float) -> float:
        """Return how long the motor had been told to stand still."""
        since_s = None
        for told_s, record in self.world.sink.of(StateRecord):
            if record.starter != name or told_s > at_s - SLACK_S:
                continue
            if record.state in MOVING:
                since_s = None
            elif record.state in STANDING and since_s is None:
                since_s = told_s
        return 0.0 if since_s is None else at_s - since_s

    def check_stagger(self) -> None:
        frames = sorted((at_s, name) for name in NAMES for at_s in self.world.frames(name, START_PDU))
        for (one_s, one), (two_s, two) in pairwise(frames):
            assert one == two or two_s - one_s >= STAGGER_S - SLACK_S

    def check_stops(self, name: str) -> None:
        """Every accepted stop leads to a stop frame soon, where the line is there and none is under way."""
        frames = self.world.frames(name, STOP_PDU)
        under_way: set[str | None] = set()
        for at_s, each in self.world.results([name]):
            if each.verb != "stop":
                continue
            if each.phase is Phase.ACCEPTED:
                if not under_way and self.is_line_there(at_s):
                    assert any(at_s <= frame_s <= at_s + STOP_BOUND_S for frame_s in frames)
                under_way.add(each.id)
            elif each.phase.is_final:
                under_way.discard(each.id)

    def is_line_there(self, at_s: float) -> bool:
        """Return whether nothing kept the gateway from its line just then."""
        world = self.world
        plugged = [is_plugged for plug_s, is_plugged in world.plugs if plug_s <= at_s]
        is_disturbed = any(
            at_s - REOPENED_S < disturbed_s <= at_s + STOP_BOUND_S for disturbed_s in world.disturbances_s
        )
        return plugged[-1] and not is_disturbed

    def check_ends(self) -> None:
        """Every command that was accepted has one end; a group's stands for its members' when cut short."""
        told = self.world.results([*NAMES, "both"])
        groups = {(each.client, each.id) for _, each in told if each.starter == "both"}
        accepted, ends = set(), []
        for _, each in told:
            key = (each.starter, each.client, each.id)
            if each.starter != "both" and key[1:] in groups:
                continue
            if each.phase is Phase.ACCEPTED:
                accepted.add(key)
            elif each.phase.is_final and each.code != "too_many":
                ends.append(key)
        assert accepted <= set(ends)
        for key in accepted:
            assert ends.count(key) == 1, key


CommandMachine.TestCase.settings = settings(
    max_examples=25,
    stateful_step_count=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
TestCommands = CommandMachine.TestCase
