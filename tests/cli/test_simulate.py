"""What `simulate` makes of a starter's tables in the configuration; the topics of its knobs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.demo.demo import CONFIG
from gateway.cli.demo.knobs import answer_to, simulator_topics
from gateway.cli.demo.simulate import simulate, simulated_unit
from gateway.cli.main import main
from gateway.config.reading import load, parse
from gateway.errors import UsageError
from gateway.families import FAMILIES
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.sim.factory import make_unit
from tests.config.sites import changed
from tests.sim.wire import Talk
from tests.waiting import until


def talk_to(family: str, more: str) -> Talk:
    text = changed(
        ('family = "ssw07"', f'family = "{family}"\n{more}'), ('framing = "8E1"', 'framing = "8N2"')
    )
    return Talk(simulated_unit(parse(text, "site.toml").lines[0].starters[0]))


def word(talk: Talk, register: int) -> int:
    return int(talk.ask(ReadHoldingRegisters(register, 1))[0])


def test_the_slot_of_the_configuration_is_the_accessorys() -> None:
    talk: Any = talk_to("ssw900", "slot = 2")

    talk.ask(WriteRegister(686, 0x0013))
    talk.wait(20.0)

    assert talk.unit.motor.is_turned_on
    assert word(talk, 680) & 1


def test_firmware_parameters_motor_and_supply_are_the_configurations() -> None:
    talk = talk_to(
        "ssw07",
        '[line.starter.simulated]\nfirmware = "1.30"\nparameters = { P630 = 30, P314 = 9 }\n'
        "[line.starter.simulated.motor]\nload_pct = 50.0\nramp_up_s = 12.0\nfriction_pct = 10.0\n"
        'wear_per_start_pct = 2.0\nthermal_pct = 40.0\nline_voltage_pct = 95.0\nlost_phase = "t"\n',
    )
    motor = talk.unit.motor

    assert [word(talk, register) for register in (23, 630, 314)] == [130, 30, 9]
    assert (motor.load_pct, motor.friction_pct, motor.thermal_pct) == pytest.approx(
        (50.0, 10.0, 40.0), abs=0.1
    )
    assert (motor.data.ramp_up_s, motor.data.wear_per_start_pct) == pytest.approx((12.0, 2.0))
    assert motor.line_voltage_pct == pytest.approx(95.0)
    assert motor.lost_phase == 2


def test_a_model_that_the_family_does_not_have_cannot_be_simulated() -> None:
    with pytest.raises(UsageError, match="cannot be simulated: model 'SST999' is not one of SST330i"):
        talk_to("sst", 'model = "SST999"')


async def test_a_real_port_is_warned_of_loudly_and_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    config = parse(changed(("/dev/rs485-pumps", "/dev/null")), "site.toml")

    simulating = asyncio.create_task(simulate(config))
    reported = ""
    while "line pumps" not in reported:
        await asyncio.sleep(0.01)
        captured = capsys.readouterr()
        reported += captured.err
    simulating.cancel()
    await asyncio.wait((simulating,))

    assert reported.startswith("WARNING: line pumps: /dev/null IS A REAL PORT and is not simulated")
    assert "moves REAL MOTORS" in reported


async def test_a_line_comes_only_with_its_knobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link, is_connected, is_there = tmp_path / "tty", asyncio.Event(), []

    @asynccontextmanager
    async def topics(*_: object) -> AsyncIterator[None]:
        is_there.append(link.exists())
        is_connected.set()
        yield

    monkeypatch.setattr("gateway.cli.demo.simulate.simulator_topics", topics)
    config = parse(changed(("/dev/rs485-pumps", str(link))), "site.toml")
    simulating = asyncio.create_task(simulate(config, knobs_at="mqtt://127.0.0.1"))
    await is_connected.wait()
    await until(link.exists)
    simulating.cancel()
    await asyncio.wait((simulating,))

    assert is_there == [False]


def test_forty_points_of_all_families_are_in_the_demo_whose_line_has_time_for_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "demo.toml"
    path.write_text(CONFIG.read_text("utf-8").format(folder=tmp_path, port=1883, version="auto"), "utf-8")

    assert main(["check", str(path), "--json"]) == 0

    (line,) = json.loads(capsys.readouterr().out)["lines"]
    asked = {each.family: len(each.asked) for each in load(path).starters}
    assert asked.keys() == set(FAMILIES)
    assert line["extra_points"]["count"] == sum(asked.values()) == 40
    assert line["load"] < 0.9


@pytest.mark.parametrize(
    ("topic", "payload", "said"),
    [
        ("pump/trip", b"E05", "tripped: E05"),
        ("pump/trip", b"\xff\xfe", "no number"),
        ("pump/explode", b"", "no knob 'explode'"),
        ("fan/trip", b"", "no simulated starter 'fan' (one of pump)"),
        ("pump/done", b"{}", ""),  # an answer of its own
    ],
)
@pytest.mark.parametrize("is_retained", [False, True])
def test_a_knob_is_turned_and_the_answer_says_what_was_done_or_why_not(
    topic: str, payload: bytes, said: str, *, is_retained: bool
) -> None:
    unit = make_unit("ssw07", 1)

    asked = Incoming(f"simulator/{topic}", payload, is_retained=is_retained)
    answer = answer_to({"pump": unit}, asked)

    assert (answer is None) is (not said)
    if answer is not None:
        assert answer.topic == f"simulator/{topic.split('/')[0]}/done"
        assert ("retained" if is_retained and topic.startswith("pump") else said) in answer.payload.decode()
    assert len(unit.trips) == (said.startswith("tripped") and not is_retained)


async def test_only_a_broker_on_loopback_may_carry_them() -> None:
    with pytest.raises(UsageError, match="loopback"):
        async with simulator_topics({}, BrokerSettings("broker.plant", 1883, "simulator")):
            pytest.fail("connected")
