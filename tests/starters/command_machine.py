"""Random histories of commands: a start goes out once at most, lawfully; every command has one end.

Commands, repetitions, joined stops, stalled ways, reconnections, losses, crashes, standstills, local starts,
locks, slow disks and clock steps, also between two runs, come to a whole gateway over its broker, in virtual
time. `tests.starters.history` says what must hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from gateway.contract import Phase, rfc3339
from gateway.sim.weg.command_sources import P_START_DELAY
from gateway.system.stalls import SUSPEND_LIMIT_S
from tests.starters.history import TTL_S, History
from tests.starters.world import NAMES, PAUSE_S, START_PDU, GatewayWorld

ONLINE_S = 2.0
SETTLED_S = 15.0  # a stop has 10 s, a status after a crash as long
AHEAD_S = 2.0

starters, clients = st.sampled_from(NAMES), st.sampled_from(["alice", "bob", "mallory"])
flips = st.sampled_from([False, False, False, True])
waits = st.sampled_from([0.02, 0.05, 0.1, 0.3, 1.0, 3.0])
stalls = st.sampled_from([1.0, 4.0, TTL_S + 0.5, 12.0, 60.0])
proofs = st.sampled_from(["token", "token", "token", "earlier token", "issued", "boot", "nothing"])
NEVER_S = float("-inf")


@dataclass(frozen=True)
class Held:
    """A start on a way that stalls: it is decided upon and sent, and has not arrived."""

    starter: str
    id: str
    proof: dict[str, Any]
    until_s: float
    made_s: float


class CommandMachine(RuleBasedStateMachine):
    """The model keeps what was lawful when it was sent; the rest is read from the wire and the records."""

    def __init__(self) -> None:
        super().__init__()
        self.world = GatewayWorld()
        self.wait(ONLINE_S + PAUSE_S)
        self.ids = 0
        self.lawful: dict[tuple[str, str], float] = {}  # by starter and id: until when its frame may go out
        self.sent: list[tuple[str, str, str]] = []  # starts: starter, client and id
        self.tokens: list[str] = ["never given"]
        self.held: list[Held] = []  # on a way that stalls

    def new_id(self) -> str:
        self.ids += 1
        return str(self.ids)

    def proof(self, kind: str, age_s: float) -> tuple[dict[str, Any], float]:
        """Return what is sent to prove a command fresh, and until when it may be acted on (NEVER_S: never).

        The sender's clock is right; what the gateway's shows may not be.
        """
        world = self.world
        now_s = world.now_s()
        if kind == "token":
            made_s, token = world.token(max(age_s, 0.0))
            return {"token": token}, made_s + TTL_S if made_s >= world.connected_s else NEVER_S
        if kind == "earlier token":
            return {"token": self.tokens[-1], "boot": world.boot()}, NEVER_S
        if kind == "issued":
            is_fresh = -AHEAD_S < age_s < TTL_S and now_s - age_s > world.connected_s
            until_s = now_s - max(age_s, 0.0) + TTL_S
            return {"issued_at": rfc3339(world.true_utc_s() - age_s)}, until_s if is_fresh else NEVER_S
        return {"boot": world.boot()} if kind == "boot" else {}, NEVER_S

    @rule(starter=starters, client=clients, kind=proofs, age_s=st.floats(-4, 8), retained=flips)
    def start_somehow(self, starter: str, client: str, kind: str, age_s: float, retained: bool) -> None:
        id_, (proof, until_s) = self.new_id(), self.proof(kind, age_s)
        may = client == "alice" or (client == "bob" and starter == "a")
        if until_s >= self.world.now_s() and may and not retained:
            self.lawful[starter, id_] = until_s
        self.sent.append((starter, client, id_))
        self.world.publish(starter, client, "start", id=id_, retained=retained, **proof)

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
            ("alice", "token", TTL_S + 0.5, False),
            ("alice", "boot", 0.0, False),
            ("alice", "issued", 0.5, False),  # before the connection
        ):
            if kind != "token":
                self.reconnect()
            self.start_somehow(starter, client, kind, age_s, retained)
            self.wait(0.3)

    @rule(
        starter=starters,
        seconds=st.sampled_from([0.5, SUSPEND_LIMIT_S + 0.5, 20.0]),
        kind=st.sampled_from(["token", "issued"]),
    )
    def start_that_waited_in_the_socket(self, starter: str, seconds: float, kind: str) -> None:
        self.bring_to_rest(starter)
        id_, (proof, until_s) = self.new_id(), self.proof(kind, 0.0)
        if seconds < SUSPEND_LIMIT_S:
            self.lawful[starter, id_] = until_s
        self.sent.append((starter, "alice", id_))
        boot, token = self.world.boot(), self.world.token()[1]
        self.world.stand_still(seconds)
        self.world.publish(starter, "alice", "start", id=id_, **proof)
        if self.world.boot() != boot:
            self.tokens.append(token)
        self.wait(0.3)

    @rule(starter=starters, seconds=st.sampled_from([0.3, 1.0, 3.0, 10.0]))
    def start_another_device_in_its_place(self, starter: str, seconds: float) -> None:
        """Swap after a silence: an SSW-06, whose coil 100 means run too, gets no start from an SSW-07's."""
        self.bring_to_rest(starter)
        other = self.world.swap(starter)
        self.wait(seconds)
        id_, (proof, _) = self.new_id(), self.proof("token", 0.0)
        self.sent.append((starter, "alice", id_))
        self.world.publish(starter, "alice", "start", id=id_, **proof)
        self.wait(seconds)
        self.world.swap_back(starter, other)
        assert START_PDU not in [write.pdu for write in other.writes]
        assert not other.motor.is_turning

    @rule(starter=starters, kind=st.sampled_from(["token", "token", "issued", "boot"]))
    def send_a_start_into_a_way_that_stalls(self, starter: str, kind: str) -> None:
        """Whatever comes until it arrives happens meanwhile."""
        proof, until_s = self.proof(kind, 0.0)
        made_s = self.world.now_s()
        self.held.append(Held(starter, self.new_id(), {"boot": self.world.boot(), **proof}, until_s, made_s))

    @precondition(lambda self: self.held)
    @rule(seconds=stalls)
    def let_the_way_go_on(self, seconds: float) -> None:
        """Deliver all that it held, in its order."""
        self.bring_to_rest(self.held[0].starter)
        self.wait(seconds)
        self.deliver()
        self.wait(0.3)

    def deliver(self) -> None:
        world, held = self.world, self.held
        self.held = []
        for each in held:
            if each.until_s >= world.now_s() and each.made_s >= world.connected_s:
                self.lawful[each.starter, each.id] = each.until_s
            self.sent.append((each.starter, "alice", each.id))
            world.publish(each.starter, "alice", "start", id=each.id, **each.proof)

    @rule(starter=starters, client=clients, seconds=st.floats(0.0, 0.6), is_started=st.booleans())
    def stop_again_while_it_is_being_stopped(
        self, starter: str, client: str, seconds: float, is_started: bool
    ) -> None:
        self.stop(starter, "alice")
        self.wait(seconds)
        if is_started:
            self.world.operate_locally(starter, is_start=True)
        self.stop(starter, client)

    @rule(starter=starters, seconds=st.sampled_from([1.0, 3.0]))
    def restart(self, starter: str, seconds: float) -> None:
        self.start(starter, 1.0)
        self.stop(starter, "alice")
        self.wait(seconds)
        self.start(starter, 0.3)

    @rule(starter=starters, seconds=st.sampled_from([1.0, 3.2, 5.0, 8.0]))
    def start_a_starter_that_ignores_it(self, starter: str, seconds: float) -> None:
        """In its time after a stop it ignores a start without a word: that is taken back (S2)."""
        self.bring_to_rest(starter)
        settings = self.world.units[starter].settings  # type: ignore[attr-defined]  # of every SSW-07
        settings[P_START_DELAY] = 60
        self.restart(starter, 3.0)
        self.wait(seconds)
        settings[P_START_DELAY] = 0

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
        proof, until_s = self.proof("token", 0.0)
        if state == "ready":  # a start of what runs is unlawful in any case
            self.lawful[starter, id_] = until_s
        body = {**proof, "expect": {"state": state}}
        self.world.publish(starter, "alice", "start", id=id_, **body)

    @precondition(lambda self: self.sent)
    @rule(data=st.data())
    def repeat_a_start(self, data: st.DataObject) -> None:
        """Send a known id again, with the best of proofs: it may be lawful only as what it was at first."""
        starter, client, id_ = data.draw(st.sampled_from(self.sent[-5:]))
        if (starter, id_) not in self.lawful and not self.was_taken(client, id_):
            return  # one that was refused for its form may well be sent anew; that is another command
        proof, until_s = self.proof("token", 0.0)
        if not self.was_taken(client, id_):  # else it is the first one's time that counts
            self.lawful[starter, id_] = until_s
        self.world.publish(starter, client, "start", id=id_, **proof)

    def was_taken(self, client: str, id_: str) -> bool:
        return any(
            (each.client, each.id, each.phase) == (client, id_, Phase.ACCEPTED)
            for _, each in self.world.results(NAMES)
        )

    @rule(starter=st.sampled_from([*NAMES, "both"]), client=clients)
    def stop(self, starter: str, client: str) -> None:
        id_ = self.new_id()
        self.world.publish(starter, client, "stop", id=id_)

    @rule(starter=starters, is_locked=st.sampled_from([False, False, True]))
    def lock(self, starter: str, is_locked: bool) -> None:
        verb, (proof, _) = "lock" if is_locked else "unlock", self.proof("token", 0.0)
        body = {"id": self.new_id(), **proof, "args": {"reason": "belt"}}
        self.world.publish(starter, "alice", verb, **body)

    @rule(seconds=waits)
    def wait(self, seconds: float) -> None:
        self.world.wait(seconds)

    def bring_to_rest(self, starter: str) -> None:
        """Make it likely that nothing but what is being tried stands in the way of a start."""
        if self.world.units[starter].motor.is_turning:
            self.stop(starter, "alice")
            self.wait(1.0 + PAUSE_S)

    def reconnect(self) -> None:
        self.tokens.append(self.world.token()[1])
        self.world.reconnect()

    def crash(self, *, step_s: float = 0.0) -> None:
        self.tokens.append(self.world.token()[1])
        self.world.crash(step_s=step_s)

    @rule(starter=starters)
    def crash_and_start(self, starter: str) -> None:
        self.bring_to_rest(starter)
        self.crash()
        self.wait(ONLINE_S + PAUSE_S)
        self.start(starter, 0.3)

    @rule(starter=starters, until_s=waits, again_s=waits)
    def crash_and_again_while_it_recovers(self, starter: str, until_s: float, again_s: float) -> None:
        self.start(starter, until_s)
        self.crash()
        self.wait(again_s)
        self.crash()

    @rule(starter=starters)
    def start_on_a_slow_disk(self, starter: str) -> None:
        self.bring_to_rest(starter)
        self.world.disk_s = TTL_S + 1.0
        self.start(starter, TTL_S + 2.0)
        self.world.disk_s = 0.0

    @rule(starter=starters, step_s=st.sampled_from([-20.0, 20.0]), is_between_runs=st.booleans())
    def start_late_by_a_clock_that_was_set(self, starter: str, step_s: float, is_between_runs: bool) -> None:
        """Send a start that was held up for as long as the clock was set back; by that clock it is fresh."""
        self.bring_to_rest(starter)
        if is_between_runs:
            self.crash(step_s=step_s)
            self.wait(ONLINE_S + PAUSE_S)
        else:
            self.world.step_clock(step_s)
            self.wait(0.3)
        self.start_somehow(starter, "alice", "issued", 20.0, retained=False)
        self.wait(0.3)

    @rule(data=st.data())
    def disturb_again(self, data: st.DataObject) -> None:
        self.disturb(data)

    @rule(data=st.data())
    def disturb(self, data: st.DataObject) -> None:
        """Let one of the things happen that should not."""
        world, starter = self.world, data.draw(starters)
        match data.draw(
            st.sampled_from(
                ["gateway", "line", "people", "answers", "broker", "clock", "disk", "clock is put right"]
            )
        ):
            case "broker":
                self.reconnect()
            case "clock":
                step_s = data.draw(st.sampled_from([-86400.0, -20.0, -3.0, 3.0, 20.0, 86400.0]))
                if data.draw(st.booleans()):
                    self.crash(step_s=step_s)  # it is set between two runs
                else:
                    world.step_clock(step_s)
            case "clock is put right":
                world.put_clock_right()
            case "answers":
                kind = data.draw(st.sampled_from(["none", "writes", "all"]))
                world.impair(starter, kind)
            case "line":
                world.plug(is_plugged=not world.is_plugged)
            case "disk":
                world.disk_s = data.draw(st.sampled_from([0.0, 0.0, 0.0, 0.3, 6.0]))
            case "people":
                is_start = data.draw(st.booleans())
                world.operate_locally(starter, is_start=is_start)
            case _:
                self.crash()

    def teardown(self) -> None:
        try:
            self.deliver()
            self.settle()
            History(self.world, self.lawful).check()
        finally:
            self.world.close()

    def settle(self) -> None:
        self.world.disk_s = 0.0
        for name in NAMES:
            self.world.impair(name, "none")
        if not self.world.is_plugged:
            self.world.plug(is_plugged=True)
        self.wait(SETTLED_S)
