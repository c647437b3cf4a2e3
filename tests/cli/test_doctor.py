"""Problems in the starters, and the command that reports all problems."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.doctor import doctor
from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.main import main
from gateway.errors import BrokerError, PortError
from gateway.families.devices.findings import Weight
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from gateway.system.instance_lock import instance_lock
from tests.cli.doctor_site import NoBroker, examine, problems_in, site


class Refusing:
    """A port that does not open."""

    name = "/nowhere/tty"

    def __init__(self, reason: str) -> None:
        self._reason = reason

    async def __call__(self) -> Any:
        raise PortError(self.name, self._reason)


def test_a_watchdog_that_the_polls_do_not_keep_is_a_problem_and_one_that_runs_from_now_on_is_noted() -> None:
    found = examine(site(*["ssw07"] * 8), make_unit("ssw07", 1, settings={314: 1}))

    assert any("it may act although all is well" in problem for problem in problems_in(found))
    assert any("P314 runs since this look" in remark.text for remark in found)


def test_a_port_that_is_lost_on_the_way_is_a_problem() -> None:
    def pull_out(bus: SimulatedLine) -> None:
        asyncio.get_running_loop().call_later(0.05, bus.unplug)

    found = examine(site(), make_unit("ssw07", 1), corrupt=pull_out)

    assert len(problems_in(found)) == 1


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

    assert problems_in(found) == []
    assert any("the gateway is asked over MQTT" in remark.text for remark in found)
    assert any(remark.text == "answers the gateway" for remark in found)


def test_a_port_that_several_could_open_is_left_to_the_gateway_that_runs_with_this_state(
    tmp_path: Path,
) -> None:
    lines: list[SimulatedLine] = []
    with instance_lock(tmp_path):
        found = examine(
            site("ssw900"),
            make_unit("ssw900", 1),
            rows=READY_900,
            corrupt=lines.append,
            state_dir=tmp_path,
        )

    assert any("the gateway is asked over MQTT" in remark.text for remark in found)
    assert any(remark.text == "answers the gateway" for remark in found)
    assert lines[0].opened == 0
    examine(site("ssw900"), make_unit("ssw900", 1), corrupt=lines.append, state_dir=tmp_path)
    assert lines[1].opened == 1


def test_the_slot_of_the_accessory_is_taken_from_what_the_gateway_reads() -> None:
    found = examine(site("ssw900"), opener=BUSY, rows={**READY_900, "S3.5.1": 2, "S3.5.2": 0})

    assert any("C3.3 = 5 (Slot 2) (set C3.3 = 4, Slot 1)" in problem for problem in problems_in(found))


def test_a_gateway_that_reads_nothing_of_a_starter_and_one_that_cannot_be_asked_are_problems() -> None:
    (nothing,) = problems_in(examine(site(), opener=BUSY))
    (unasked,) = problems_in(examine(site(), opener=BUSY, rows=BrokerError("no operator may read it")))

    assert "reads nothing of it" in nothing
    assert "cannot be asked: no operator may read it" in unasked


@pytest.mark.parametrize(
    ("trouble", "more"),
    [
        ("the gateway says: offline since 2026-11-22T01:00:00.000Z: no reply", 0),
        ("the gateway says: degraded: values are not usable: it is ssw06, not ssw07", 1),
    ],
)
def test_what_the_gateway_knows_of_a_silent_or_wrong_starter_is_said(
    trouble: str, more: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NoBroker, "trouble", trouble)

    problems = problems_in(examine(site(), opener=BUSY, rows=BrokerError("the gateway refuses to read it")))

    assert problems[0] == f"starter pump-1: {trouble}"
    assert len(problems) == 1 + more  # of one that is offline nothing is asked


# The command


@pytest.mark.parametrize("is_a_problem", [True, False])
def test_the_exit_code_says_whether_anything_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, is_a_problem: bool
) -> None:
    path = tmp_path / "site.toml"
    path.write_text(site(folder=str(tmp_path)), "utf-8")

    class Checkup:
        def __init__(self, *given: Any) -> None:
            self._report: Callable[[DoctorFinding], None] = given[2]

        async def run(self) -> None:
            self._report(
                DoctorFinding("line hall", "is odd", Weight.WARNING if is_a_problem else Weight.NOTE)
            )

    async def no_remarks(_self: BrokerAccess) -> list[DoctorFinding]:
        return []

    async def no_measurement(*_: object) -> list[DoctorFinding]:
        return []

    monkeypatch.setattr(doctor, "LineCheckup", Checkup)
    monkeypatch.setattr(doctor, "box_remarks", no_measurement)
    monkeypatch.setattr(doctor, "clock_remark", lambda: DoctorFinding("clock", "is synchronised"))
    monkeypatch.setattr(BrokerAccess, "remarks", no_remarks)

    assert main(["doctor", str(path)]) == (1 if is_a_problem else 0)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "ok      clock: is synchronised"
    assert lines[-1] == ("0 errors, 1 warning" if is_a_problem else "no problems")
