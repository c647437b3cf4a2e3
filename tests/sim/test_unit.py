"""What all simulated units have in common, shown on a unit without any table."""

from __future__ import annotations

from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.core.power import MotorTrip
from gateway.sim.core.unit import SimulatedUnit, Trip
from tests.sim.wire import Talk


class Bare(SimulatedUnit):
    """A unit that serves functions, but has nothing behind them."""

    family = "bare"
    functions = frozenset({1, 2, 3, 5, 6, 43})

    def trip(self, number: int) -> None:
        self._catch_up()
        self.trips.append(Trip(self.now_s, str(number)))

    def _motor_tripped(self, cause: MotorTrip) -> None:
        self.trip(0)


def make() -> Talk:
    return Talk(Bare(1, response_s=(0.001, 0.002), restart_s=1.0))


def test_tables_without_rows_answer_exception_2() -> None:
    talk = make()

    for request in (
        ReadCoils(0, 1),
        ReadDiscreteInputs(0, 1),
        ReadHoldingRegisters(0, 1),
        WriteCoil(0, is_on=True),
        WriteRegister(0, 0),
        ReadDeviceIdentification(4, 0),
    ):
        assert talk.code(request) == 2


def test_timers_act_at_their_times_in_order_even_in_one_leap() -> None:
    talk = make()
    seen: list[tuple[float, str]] = []
    for name, due_s in (("late", 7.0), ("soon", 2.0)):
        talk.unit._at(name, due_s, lambda name=name: seen.append((talk.unit.now_s, name)))  # type: ignore[misc]

    talk.wait(10.0)

    assert seen == [(2.0, "soon"), (7.0, "late")]


def test_a_timer_may_set_another_one() -> None:
    talk = make()
    seen: list[float] = []
    talk.unit._at("a", 1.0, lambda: talk.unit._at("b", 3.0, lambda: seen.append(talk.unit.now_s)))

    talk.wait(10.0)

    assert seen == [3.0]


def test_time_never_goes_back() -> None:
    talk = make()
    talk.wait(5.0)
    talk.unit.advance(3.0)

    assert talk.unit.now_s == 5.0


def test_any_speed_will_do_for_a_unit_without_such_a_setting() -> None:
    talk = make()
    timing = LineTiming(9600, Framing.parse("8N2"))
    talk.unit.join(timing)
    talk.unit.note_reception_error(is_crc=True, byte_count=1)

    assert talk.unit.listens_to(timing)


def test_silence_lasts_from_power_off_until_the_start_up_is_over() -> None:
    talk = make()
    talk.unit.power_off()
    assert talk.pdu(ReadCoils(0, 1)) is None
    talk.wait(5.0)
    talk.unit.power_on()
    talk.wait(0.9)
    assert talk.pdu(ReadCoils(0, 1)) is None
    talk.wait(0.1)

    assert talk.code(ReadCoils(0, 1)) == 2


def test_the_mains_may_fail_and_come_back() -> None:
    talk = make()
    talk.unit.motor.start()
    talk.unit.set_mains(is_present=False)
    assert not talk.unit.motor.is_turned_on

    talk.unit.set_mains(is_present=True)
    talk.unit.motor.start()
    assert talk.unit.motor.is_turned_on


def test_a_trip_of_the_motor_reaches_its_unit() -> None:
    talk = make()
    talk.unit.motor.start()
    talk.wait(20.0)
    talk.unit.motor.load_pct = 400.0
    talk.wait(5.0)

    assert [trip.code for trip in talk.unit.trips] == ["0"]
