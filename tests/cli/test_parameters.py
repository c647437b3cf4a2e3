"""A starter's parameters, saved, compared and put back; in virtual time."""

from __future__ import annotations

import asyncio
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.command import Progress
from gateway.cli.parameters.live import LiveStarter, save
from gateway.errors import CommandError, PortError, UsageError
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.rtu.reply_times import ALLOWANCE_S
from gateway.modbus.adu import decode
from gateway.sim.factory import make_unit
from gateway.starters.parameters.toml_file import from_toml, to_toml
from gateway.starters.policy.write_budget import WEAR_FILE
from gateway.starters.setup import StarterSetup
from gateway.system.instance_lock import instance_lock
from tests.cli.parameters_place import TIMING, ParametersPlace
from tests.virtual_time import VirtualClock, run_virtually

pytestmark = pytest.mark.usefixtures("one_loop")


@pytest.mark.parametrize("family", FAMILIES)
def test_everything_that_a_starter_reports_is_saved_and_read_back_from_the_file(family: str) -> None:
    place = ParametersPlace(make_unit(family, 1))

    saved = place.save()

    profile = load_profile(family)
    readable = {code for code, row in profile.parameters.items() if row.access.value != "none"}
    assert set(saved.parameters) | set(saved.refused) == readable
    assert len(saved.parameters) >= 0.95 * len(readable)
    assert saved.family == family
    assert saved.model
    assert from_toml(to_toml(saved), "a.toml") == saved
    assert place.written == []
    assert place.bus.violations == []


def test_a_full_save_of_an_ssw900_at_19200_takes_less_than_1_3_of_its_wire_time() -> None:
    place = ParametersPlace(make_unit("ssw900", 1))

    saved = place.save()

    wire_s = sum(frame.end_s - frame.start_s for frame in place.bus.transcript)
    assert len(saved.parameters) == 501
    assert saved.refused == {}
    assert place.took_s < 1.3 * wire_s


def test_rows_that_the_starter_refuses_are_noted() -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    del place.unit.settings[277]

    saved = place.save()

    assert saved.refused == {"P277": "illegal data address"}
    assert "P278" in saved.parameters


def test_parameters_without_a_name_are_saved_as_raw_words_when_asked_for() -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.unit.fixed[500] = 77
    place.unit.settings[500] = 77

    saved = place.save(with_unnamed=True)

    assert saved.parameters["P500"].raw == (77,)
    assert "P501" in saved.refused


def test_a_port_that_a_gateway_holds_is_refused_with_the_hint() -> None:
    class Busy:
        name = "/dev/ttyUSB0"

        async def __call__(self) -> Any:
            raise PortError(self.name, "busy", "another program holds it: stop that one")

    class Missing(Busy):
        async def __call__(self) -> Any:
            raise PortError(self.name, "no such port")

    async def try_with(opener: Any) -> None:
        setup = StarterSetup("pump", "pumps", 1, load_profile("ssw07"), Variant())
        clock = VirtualClock(asyncio.get_running_loop())
        await save(LiveStarter(setup, opener, TIMING, ALLOWANCE_S, clock, Path()), Progress(io.StringIO()))

    with pytest.raises(PortError, match="stop the gateway"):
        run_virtually(try_with(Busy()))
    with pytest.raises(PortError, match="no such port"):
        run_virtually(try_with(Missing()))


def test_a_port_that_several_could_open_is_refused_too_while_the_gateway_of_this_state_runs(
    tmp_path: Path,
) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = tmp_path

    with instance_lock(tmp_path), pytest.raises(PortError, match="a gateway or another program holds it"):
        place.restore({"P314": 30})

    assert place.written == []
    assert place.bus.opened == 0
    assert place.restore({"P314": 30}) == 0


def test_a_restore_without_a_gateway_keeps_no_count(tmp_path: Path) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = tmp_path / "none"

    assert place.restore({"P314": 30}) == 0

    assert not place.state_dir.exists()


def test_a_restore_says_when_its_writes_cannot_be_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / WEAR_FILE).write_text("damaged")
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = tmp_path

    assert place.restore({"P314": 30}) == 0

    assert "writes to the memory of pump that are not counted: 1" in capsys.readouterr().out
    assert (tmp_path / WEAR_FILE).read_text() == "damaged"


def test_a_restored_starter_differs_in_nothing_any_more() -> None:
    place = ParametersPlace(make_unit("ssw900", 1))
    wanted = {"C8.2.5.3": 1.5, "C8.2.5.1": "Alarm A128", "C8.2.5.2": "Ramp Stop"}
    place.restore(wanted)
    writes = len(place.written)

    assert place.restore(wanted) == 0
    assert (writes, len(place.written)) == (3, 3)


def test_an_sst_is_configured_once_for_all_its_registers() -> None:
    place = ParametersPlace(make_unit("sst", 1))

    assert place.restore({"R41": 9, "R42": 20, "R36": 40}) == 0

    assert [place.unit.settings[register] for register in (36, 41, 42)] == [40, 9, 20]
    entered = [pdu for pdu in place.written if pdu == bytes.fromhex("0500 01ff 00")]
    assert len(entered) == 1
    assert place.unit.is_configured


@pytest.mark.parametrize(
    ("family", "code", "value"), [("ssw07", "P314", 30), ("ssw900", "C8.2.5.3", 2), ("sst", "R41", 9)]
)
def test_nothing_is_written_while_the_motor_turns(
    family: str, code: str, value: int, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ParametersPlace(make_unit(family, 1))
    place.unit.motor.start()

    assert place.restore({code: value}) == 1

    assert place.written == []
    assert place.unit.motor.is_turned_on
    out = capsys.readouterr().out
    assert f"rejected: {code}: the motor is not stopped (" in out
    assert "written and read back: nothing" in out


def test_the_first_failure_ends_a_restore_with_an_account(capsys: pytest.CaptureFixture[str]) -> None:
    place = ParametersPlace(make_unit("ssw900", 1))
    owners = place.unit._map.owners
    stubborn = owners[741]

    def ignore(owner: Any, words: Any, *, taken: Any = place.unit._set) -> None:
        if owner is not stubborn:
            taken(owner, words)

    place.unit._set = ignore

    assert place.restore({"C8.2.5.3": 1.5, "C8.2.5.2": "Ramp Stop", "C8.2.5.1": "Alarm A128"}) == 1

    out = capsys.readouterr().out
    assert "written and read back: C8.2.5.3" in out
    assert "unconfirmed: C8.2.5.2: " in out
    assert "not tried: C8.2.5.1" in out


def test_who_commands_the_motor_is_left_as_it_is_unless_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))

    assert place.restore({"P230": "DI"}) == 0
    assert place.unit.settings[230] == 2
    assert "--command-sources" in capsys.readouterr().out

    assert place.restore({"P230": "DI"}, with_sources=True) == 0
    assert "run = 0 was written first" in capsys.readouterr().out
    assert place.unit.settings[230] == 1


def test_a_set_of_another_model_is_refused_unless_asked_for() -> None:
    place = ParametersPlace(make_unit("ssw07", 1))

    with pytest.raises(UsageError, match="--other-model"):
        place.restore({"P314": 3}, model="SSW-07 17.0A")
    assert place.written == []

    assert place.restore({"P314": 3}, model="SSW-07 17.0A", is_other_model=True) == 0


def test_no_motor_starts_by_a_restore() -> None:
    for family in FAMILIES:
        place = ParametersPlace(make_unit(family, 1))
        everything = place.save()
        settings = {
            code: entry.value for code, entry in everything.parameters.items() if entry.value is not None
        }

        place.restore(settings, with_sources=True)

        assert place.unit.start_frames == []
        assert not place.unit.motor.is_turned_on
        functions = {decode(frame.data).pdu[0] for frame in place.bus.transcript if frame.sender == 0}
        assert functions <= {1, 3, 4, 43}


def test_a_restore_sets_no_watchdog_that_the_line_cannot_keep_and_leaves_others_to_the_next_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = tmp_path
    place.setup = replace(place.setup, timing=place.timing)
    others = tuple(replace(place.setup, name=f"fan-{at}", address=at) for at in range(2, 61))
    watching = tuple(replace(each, watchdog_s=2.0) for each in others[:15])
    place.neighbours = (place.setup, *watching, *others[15:])

    with pytest.raises(CommandError, match="the shortest that can be met is") as refusal:
        place.restore({"P314": 1})
    assert refusal.value.code == "watchdog_unkept"
    assert place.restore({"P314": 1}, is_dry=True) == 0
    assert "would be refused" in capsys.readouterr().out
    assert place.written == []

    assert place.restore({"P314": 60}) == 0
    stored = json.loads((tmp_path / "watchdogs.json").read_text())
    assert stored["starters"]["pump"]["rows"]["P314"] == [60]
    assert (tmp_path / "watchdogs.json").stat().st_mode & 0o777 == 0o600
