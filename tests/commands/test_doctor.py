"""What on this machine or in the starters would bite."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli import main
from gateway.commands import doctor
from gateway.commands.doctor_box import clock_remark, clock_state, latency_remark, state_dir_remark
from gateway.commands.doctor_broker import BrokerAccess
from gateway.commands.doctor_remark import Remark
from gateway.commands.doctor_starters import LineCheckup
from gateway.config.load import parse
from gateway.config.prospects import prospects_of
from gateway.config.schema import Config
from gateway.config.setups import timing_of
from gateway.errors import BrokerError, PortError
from gateway.families.finding import Weight
from gateway.mqtt import sender
from gateway.sim.factory import make_unit
from gateway.sim.line import SimulatedLine
from gateway.sim.unit import Unit
from tests.conftest import StartMosquitto
from tests.virtual_time import VirtualClock, run_virtually

SITE = """
[gateway]
name = "plant"
state_dir = "{folder}"
[mqtt]
url = "mqtt://127.0.0.1:{port}"
{login}
[[line]]
name = "hall"
port = "/nowhere/tty"
baud = 19200
framing = "8N2"
{starters}
[[operator]]
client = "alice"
may = ["read"]
starters = ["pump*"]
"""
STARTER = '[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\n'


def site(*families: str, folder: str = "/tmp", port: int = 1, login: str = "") -> str:
    starters = [
        STARTER.format(name=f"pump-{address}", address=address, family=family)
        for address, family in enumerate(families or ("ssw07",), 1)
    ]
    return SITE.format(folder=folder, port=port, login=login, starters="\n".join(starters))


class NoBroker(BrokerAccess):
    """A running gateway as far as `read` goes: it gives these rows, or raises."""

    def __init__(self, config: Config, rows: dict[str, int] | Exception) -> None:
        super().__init__(config, Path("/tmp"))
        self._given = rows

    async def read(self, starter: str, codes: Iterable[str]) -> dict[str, tuple[int, ...]]:
        if isinstance(self._given, Exception):
            raise self._given
        return {code: (self._given[code],) for code in codes if code in self._given}


class Refusing:
    """A port that does not open."""

    name = "/nowhere/tty"

    def __init__(self, reason: str) -> None:
        self._reason = reason

    async def __call__(self) -> Any:
        raise PortError(self.name, self._reason)


def examine(
    text: str,
    *units: Unit,
    opener: Any = None,
    rows: dict[str, int] | Exception | None = None,
    spoil: Callable[[SimulatedLine], object] = lambda _: None,
) -> list[Remark]:
    """Return what is said of the one line of a site."""
    config = parse(text, "site.toml")
    found: list[Remark] = []

    async def run() -> None:
        (prospect,) = prospects_of(config)
        bus = SimulatedLine(timing_of(prospect.table), units)
        spoil(bus)
        broker = NoBroker(config, rows or {})
        clock = VirtualClock(asyncio.get_running_loop())
        await LineCheckup(prospect, opener or bus.opener(), broker=broker, clock=clock).run(found.append)

    run_virtually(run())
    return found


def biting(remarks: Iterable[Remark]) -> list[str]:
    return [f"{remark.where}: {remark.text}" for remark in remarks if remark.bites]


def test_starters_that_are_set_up_well_do_not_bite_and_nothing_is_written() -> None:
    units = [
        make_unit(family, address) for address, family in enumerate(("ssw06", "ssw07", "ssw900", "sst"), 1)
    ]

    found = examine(site("ssw06", "ssw07", "ssw900", "sst"), *units)

    assert biting(found) == []
    assert "line hall: /nowhere/tty opens" in [f"{remark.where}: {remark.text}" for remark in found]
    assert [list(unit.writes) for unit in units] == [[], [], [], []]


def test_what_would_refuse_a_start_bites() -> None:
    (bite,) = biting(examine(site(), make_unit("ssw07", 1, settings={230: 0})))

    assert bite.startswith("starter pump-1: a start is not executed")


def test_a_watchdog_that_the_polls_do_not_keep_bites_and_one_that_runs_from_now_on_is_noted() -> None:
    found = examine(site(*["ssw07"] * 8), make_unit("ssw07", 1, settings={314: 1}))

    assert any("it may act although all is well" in bite for bite in biting(found))
    assert any("P314 runs since this look" in remark.text for remark in found)


def test_a_starter_that_is_silent_or_another_one_bites_and_the_others_are_looked_at() -> None:
    found = examine(site("ssw07", "ssw06", "ssw07"), make_unit("ssw07", 2), make_unit("ssw07", 3))

    silent, other = biting(found)
    assert silent == "starter pump-1: pump-1 does not answer at address 1"
    assert other.startswith("starter pump-2: it is ssw07, not ssw06")
    assert any(remark.where == "starter pump-3" and not remark.bites for remark in found)


def test_a_port_that_does_not_open_bites() -> None:
    (bite,) = biting(examine(site(), opener=Refusing("not permitted")))

    assert bite == "line hall: port /nowhere/tty: not permitted"


def test_a_port_that_is_lost_on_the_way_bites() -> None:
    def pull_out(bus: SimulatedLine) -> None:
        asyncio.get_running_loop().call_later(0.05, bus.unplug)

    found = examine(site(), make_unit("ssw07", 1), spoil=pull_out)

    assert len(biting(found)) == 1


BUSY = Refusing("busy")
READY_900 = {
    "C3.1": 12,
    "C3.2": 0,
    "C3.3": 5,
    "C8.2.5.1": 0,
    "C8.2.5.2": 0,
    "C8.2.5.3": 0,
    "S3.5.1": 0,
    "S3.5.2": 2,
}


def test_where_a_gateway_holds_the_port_it_is_asked_instead() -> None:
    found = examine(site("ssw900"), opener=BUSY, rows=READY_900)

    assert biting(found) == []
    assert any("the gateway is asked over MQTT" in remark.text for remark in found)
    assert any(remark.text == "answers the gateway" for remark in found)


def test_the_slot_of_the_accessory_is_taken_from_what_the_gateway_reads() -> None:
    found = examine(site("ssw900"), opener=BUSY, rows={**READY_900, "S3.5.1": 2, "S3.5.2": 0})

    assert any("C3.3 = 5 (Slot 2) (set C3.3 = 4, Slot 1)" in bite for bite in biting(found))


def test_a_gateway_that_reads_nothing_of_a_starter_and_one_that_cannot_be_asked_bite() -> None:
    (nothing,) = biting(examine(site(), opener=BUSY))
    (unasked,) = biting(examine(site(), opener=BUSY, rows=BrokerError("no operator may read it")))

    assert "reads nothing of it" in nothing
    assert "cannot be asked: no operator may read it" in unasked


# This machine


@pytest.mark.parametrize(("milliseconds", "weight"), [("1", None), ("2", None), ("16", Weight.WARNING)])
def test_an_adapter_that_holds_replies_back_bites(
    milliseconds: str, weight: Weight | None, tmp_path: Path
) -> None:
    device = tmp_path / "ttyUSB0" / "device"
    device.mkdir(parents=True)
    (device / "latency_timer").write_text(f"{milliseconds}\n", "ascii")

    remark = latency_remark("/dev/ttyUSB0", "line hall", sysfs=tmp_path)

    assert remark is not None
    assert remark.weight is weight


def test_an_adapter_without_a_latency_timer_is_no_matter(tmp_path: Path) -> None:
    assert latency_remark("/dev/ttyS0", "line hall", sysfs=tmp_path) is None
    assert latency_remark("socket://box:4001", "line hall", sysfs=tmp_path) is None


@pytest.mark.parametrize(("state", "weight"), [(0, None), (5, Weight.WARNING), (None, Weight.NOTE)])
def test_a_clock_that_is_not_synchronised_bites(state: int | None, weight: Weight | None) -> None:
    assert clock_remark(lambda: state).weight is weight


def test_the_clock_of_this_machine_can_be_looked_at() -> None:
    assert clock_state() in (None, *range(6))


def test_a_state_directory_must_be_there_and_be_a_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()

    assert state_dir_remark(tmp_path).weight is None
    assert state_dir_remark(file).weight is Weight.ERROR
    assert state_dir_remark(tmp_path / "none").weight is Weight.ERROR


def test_a_state_directory_that_may_not_be_written_bites(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)

    assert "chown" in state_dir_remark(tmp_path).text


# The broker


def remarks_of(text: str, folder: Path) -> list[Remark]:
    access = BrokerAccess(parse(text, "site.toml"), folder)
    return asyncio.run(access.remarks())


def test_a_broker_that_is_away_bites() -> None:
    (bite,) = biting(remarks_of(site(port=1), Path("/tmp")))

    assert bite.startswith("broker 127.0.0.1:1: ")


def test_a_password_file_that_others_may_read_bites(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("secret\n", "utf-8")
    (tmp_path / "password").chmod(0o644)

    (bite,) = biting(remarks_of(site(login='username = "g"\npassword_file = "password"'), tmp_path))

    assert "chmod 600" in bite
    assert "secret" not in bite


@pytest.mark.mosquitto
def test_a_login_that_the_broker_takes_is_told_and_one_that_it_refuses_bites(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    broker = start_mosquitto(users={"g": "right"})
    login = 'username = "g"\npassword_file = "password"'
    bites = []
    for password in ("right", "wrong"):
        (tmp_path / "password").write_text(password, "utf-8")
        (tmp_path / "password").chmod(0o600)
        bites.append(biting(remarks_of(site(port=broker.port, login=login), tmp_path)))

    assert bites[0] == []
    assert len(bites[1]) == 1


def test_nothing_is_asked_of_a_broker_that_cannot_be_used() -> None:
    access = BrokerAccess(parse(site(), "site.toml"), Path("/tmp"))

    with pytest.raises(BrokerError, match="cannot be used"):
        asyncio.run(access.read("pump-1", ["P220"]))


@pytest.mark.mosquitto
def test_a_gateway_that_does_not_run_and_a_starter_that_nobody_may_read_cannot_be_asked(
    tmp_path: Path, start_mosquitto: StartMosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "STATUS_WITHIN_S", 0.05)
    access = BrokerAccess(parse(site(port=start_mosquitto().port), "site.toml"), tmp_path)
    assert biting(asyncio.run(access.remarks())) == []

    with pytest.raises(BrokerError, match="no operator may read it"):
        asyncio.run(access.read("fan", ["P220"]))
    with pytest.raises(BrokerError, match="no gateway has told its state"):
        asyncio.run(access.read("pump-1", ["P220"]))


# The command


@pytest.mark.parametrize("bites", [True, False])
def test_the_exit_code_says_whether_anything_bites(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, bites: bool
) -> None:
    path = tmp_path / "site.toml"
    path.write_text(site(folder=str(tmp_path)), "utf-8")

    class Checkup:
        def __init__(self, *_: object, **__: object) -> None: ...

        async def run(self, tell: Callable[[Remark], None]) -> None:
            tell(Remark("line hall", "is odd", Weight.WARNING if bites else Weight.NOTE))

    async def no_remarks(_self: BrokerAccess) -> list[Remark]:
        return []

    monkeypatch.setattr(doctor, "LineCheckup", Checkup)
    monkeypatch.setattr(doctor, "clock_remark", lambda: Remark("clock", "is synchronised"))
    monkeypatch.setattr(BrokerAccess, "remarks", no_remarks)

    assert main(["doctor", str(path)]) == (1 if bites else 0)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "ok      clock: is synchronised"
    assert lines[-1] == ("0 errors, 1 warning" if bites else "nothing bites")


def test_a_wrong_configuration_is_told_as_everywhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "site.toml").write_text("[gateway]\n", "utf-8")

    assert main(["doctor", str(tmp_path / "site.toml")]) == 78
    assert "name: is missing" in capsys.readouterr().err
