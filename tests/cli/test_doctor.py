"""Problems in the starters, and the command that reports all problems."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.doctor import doctor
from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.main import main
from gateway.families.devices.findings import Weight
from tests.cli.doctor_site import site


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
