"""A whole gateway with two starters of a simulated line, entered by its doors; records have their moments."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

from gateway.contract import Record, RecordWriter, ResultRecord
from gateway.modbus.writes import WriteCoil
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.store.database import Database
from tests.rig import RigPlant
from tests.rig.sites import ALICE, QUICK, line, operator, starter, table
from tests.scenarios.commands import LostWrites

NAMES = ("a", "b")
PAUSE_S, STAGGER_S, STARTS_PER_HOUR = 2.0, 1.5, 5
SILENCE_S = 12.0  # so many polls are lost in it that a starter is offline
READS = (1, 2, 3, 4)  # function codes
START_PDU, STOP_PDU = WriteCoil(100, True).encode(), WriteCoil(100, False).encode()  # ssw07 4.2.2
RULES: dict[str, Any] = {"starts_per_hour": STARTS_PER_HOUR, "minimum_pause_s": PAUSE_S}
SITE = (
    table("gateway", name="plant", state_dir="state", clock="auto")
    + line("x")
    + "".join(starter(name, address, "ssw07") for address, name in enumerate(NAMES, 1))
    + table("[rules]", starters=["*"], feeder="f", stagger_s=STAGGER_S, **RULES)
    + table("[group]", name="both", starters=["*"])
    + ALICE
    + operator("bob", may=("start", "stop"), starters=("a",))
)


class GatewayWorld:
    """The starters on their line, the gateway of the moment, and its broker; times are the scenario's."""

    def __init__(self) -> None:
        self.records: list[tuple[float, Record]] = []
        self.plugs: list[tuple[float, bool]] = [(0.0, True)]
        self.disturbances_s: list[float] = []  # crashes, and the port going away
        self.connected_s = 0.0
        self.disk_s = 0.0  # how long a transaction takes
        self.unstored: list[tuple[float, float]] = []  # what was said between these was not stored: a crash
        self._stored_s = 0.0  # when the last transaction that is done began
        self._bus: RecordWriter | None = None  # of the gateway of the moment
        self._stack = ExitStack()
        self.plant = RigPlant(SITE, sim=dict.fromkeys(NAMES, QUICK))
        self._note_calls(RecordWriter, "connect", lambda bus, *_: setattr(self, "_bus", bus))
        self._note_calls(RecordWriter, "put", self._note_record)
        self._note_calls(Database, "transact", lambda *_, **__: self._await_disk())
        self._note_calls(self.plant.broker, "join", lambda _: setattr(self, "connected_s", self.now_s()))
        self._stack.enter_context(self.plant)
        self.units = {name: self.plant.starter(name).unit for name in NAMES}

    def _note_calls(self, owner: Any, name: str, note: Callable[..., object]) -> None:
        """Have a method's calls noted before it is carried out."""
        carry_out = getattr(owner, name)

        def noting(*args: Any, **options: Any) -> Any:
            note(*args, **options)
            return carry_out(*args, **options)

        self._stack.enter_context(patch.object(owner, name, noting))

    def _note_record(self, bus: RecordWriter, record: Record) -> None:
        if bus is self._bus:  # a process that was killed says nothing
            self.records.append((self.now_s(), record))

    def _await_disk(self) -> None:
        begun_s = self.now_s()
        if self.disk_s:
            threading.Event().wait(self.disk_s)
        self._stored_s = begun_s

    def close(self) -> None:
        self._stack.close()

    # Time, and what proves a command fresh

    def now_s(self) -> float:
        return self.plant.world.now_s()

    def wait(self, seconds: float) -> None:
        self.plant.run(until=self.now_s() + seconds)

    def step_clock(self, by_s: float) -> None:
        """Set the gateway's wall clock; an honest kernel says whether that is right."""
        self.plant.world.stepped_s += by_s
        self.plant.is_clock_synchronised = self.plant.world.stepped_s == 0.0

    def put_clock_right(self) -> None:
        self.step_clock(-self.plant.world.stepped_s)

    def true_utc_s(self) -> float:
        """Return the time by everybody else's clock."""
        return self.plant.world.utc_s() - self.plant.world.stepped_s

    def token(self, age_s: float = 0.0) -> tuple[float, str]:
        """Return the newest token that is at least so old, after the time when it was made."""
        topic, due_s = self.plant.topic("gateway/fresh"), self.now_s() - age_s
        made = (each for each in reversed(self.plant.broker.log) if each.topic == topic and each.payload)
        return next(
            ((each.at_s, each.json["token"]) for each in made if each.at_s <= due_s),
            (float("-inf"), "never made"),
        )

    def boot(self) -> str:
        """Return what names the present run, or its connection."""
        return str(self.plant.last("gateway/status").get("boot", ""))

    def publish(self, starter: str, client: str, verb: str, *, retained: bool = False, **body: Any) -> None:
        self.plant.publish(f"command/{starter}/{client}/{verb}", body, client=client, retain=retained)
        self.wait(0.001)  # it has been received

    # Disturbances

    def reconnect(self) -> None:
        """Lose the connection, and wait until there is another."""
        self.plant.broker.drop()
        self._until_connected()

    def crash(self, *, step_s: float = 0.0) -> None:
        """End the gateway in the middle of whatever it does, and start it again with a clock that was set."""
        self.disturbances_s.append(self.now_s())
        if self.disk_s:
            self.unstored.append((self._stored_s, self.now_s()))
        self._bus = None
        self.plant.kill()
        self.step_clock(step_s)
        self.plant.start()
        self._until_connected()

    def _until_connected(self) -> None:
        known_s, begun_s = self.token()[0], self.now_s()
        while self.token()[0] <= known_s:
            assert self.now_s() < begun_s + 60.0, "it does not connect"
            self.wait(0.05)

    def stand_still(self, seconds: float) -> None:
        """Let the machine do something else for so long; what comes next has waited in the socket."""
        self.disturbances_s.append(self.now_s())
        self.plant.stand_still(seconds)
        self.disturbances_s.append(self.now_s())

    @property
    def is_plugged(self) -> bool:
        return self.plugs[-1][1]

    def plug(self, *, is_plugged: bool) -> None:
        self.disturbances_s.append(self.now_s())
        self.plugs.append((self.now_s(), is_plugged))
        wires = self.plant.lines["x"]
        self.plant.do(wires.plug if is_plugged else wires.unplug)

    def swap(self, starter: str) -> SimulatedUnit:
        """Put an SSW-06 in a starter's place, with a silence between; return it."""
        other = make_unit("ssw06", self.units[starter].address)
        self._exchange(self.units[starter], other)
        return other

    def swap_back(self, starter: str, other: SimulatedUnit) -> None:
        """Put the right starter back in its place, with a silence between."""
        self._exchange(other, self.units[starter])

    def _exchange(self, before: SimulatedUnit, after: SimulatedUnit) -> None:
        wires = self.plant.lines["x"].bus
        self.disturbances_s.append(self.now_s())
        self.plant.do(lambda: wires.remove(before))
        self.wait(SILENCE_S)
        self.plant.do(lambda: wires.add(after))
        self.disturbances_s.append(self.now_s())

    def impair(self, starter: str, kind: str) -> None:
        wires = self.plant.lines["x"]
        wires.heal(starter)
        if kind == "writes":
            wires.impair(starter, LostWrites())
        elif kind == "all":
            wires.lose(starter)

    def operate_locally(self, starter: str, *, is_start: bool) -> None:
        """Switch to local, press a key, switch back to remote."""
        unit: Any = self.units[starter]

        def operate() -> None:
            unit._set_remote(is_remote=False)
            (unit.keypad_start if is_start else unit.keypad_stop)()
            unit._set_remote(is_remote=True)

        self.plant.do(operate)

    # What came of it

    def frames(self, starter: str, pdu: bytes) -> list[float]:
        """Return when such a write reached a starter."""
        return [at_s for at_s, asked in self.plant.starter(starter).asked if asked == pdu]

    def readings(self, starter: str) -> list[float]:
        """Return when a read reached a starter."""
        return [at_s for at_s, asked in self.plant.starter(starter).asked if asked[0] in READS]

    def of(self, kind: type[Any]) -> list[tuple[float, Any]]:
        return [(at_s, record) for at_s, record in self.records if isinstance(record, kind)]

    def results(self, starters: Iterable[str]) -> list[tuple[float, ResultRecord]]:
        """Return the results, without what was only sent again."""
        results = self.of(ResultRecord)
        return [(at_s, each) for at_s, each in results if each.starter in starters and not each.is_duplicate]
