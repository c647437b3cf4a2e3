from __future__ import annotations

from pathlib import Path

import pytest

from gateway.cli.main import main
from gateway.records import AuditRecord
from gateway.storage.audit.log import AuditLog
from gateway.storage.audit.segments import ANCHOR, segment_path
from tests.small_site import small_site

CONFIG = small_site(("pump", "ssw07"))


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """A state directory with a start of the gateway and three decisions."""
    log = AuditLog(tmp_path / "state" / "audit", boot="boot-1")
    log.note("gateway_started", "version 1")
    common = {"time_s": 1_760_000_000.0, "starter": "pump"}
    log.put(
        AuditRecord(
            client="bob",
            operator=None,
            verb="start",
            args={},
            decision="rejected",
            code="not_allowed",
            seq=1,
            **common,
        )
    )
    log.put(
        AuditRecord(
            client="alice",
            operator="Alice A.",
            verb="set",
            args={"parameter": "P102", "value": 5},
            decision="confirmed",
            code="ok",
            seq=2,
            before={"P102": 3, "P001": 1},
            after={"P102": 5, "P001": 1},
            id="7f",
            reason="as agreed",
            **common,
        )
    )
    log.start(lambda _: None)
    assert log.close(within_s=10.0)
    return tmp_path / "state"


def test_fewer_than_one_cannot_be_shown(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["audit", "show", str(state), "--last", "0"]) == 2
    assert "--last 0 shows nothing" in capsys.readouterr().err


def test_a_hash_that_was_noted_earlier_must_still_be_there(
    state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["audit", "verify", str(state)]) == 0
    noted = capsys.readouterr().out.split("hash ")[1].strip()
    segment = segment_path(state / "audit", 1)

    assert main(["audit", "verify", str(state), "--contains", noted]) == 0
    segment.write_text("".join(segment.read_text().splitlines(keepends=True)[:-1]))  # the newest cut off
    assert main(["audit", "verify", str(state)]) == 0
    assert main(["audit", "verify", str(state), "--contains", noted]) == 1

    reported = capsys.readouterr().out
    assert f"no line has the hash {noted}" in reported
    assert "broken" not in reported
    assert "chain whole" in reported


def test_an_unreadable_anchor_is_a_problem(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (state / "audit" / ANCHOR).write_text("nonsense")

    assert main(["audit", "verify", str(state)]) == 1

    assert "anchor" in capsys.readouterr().out


@pytest.mark.parametrize("line", ["nonsense", "[]"])
def test_what_is_no_entry_is_shown_as_such(
    state: Path, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    with segment_path(state / "audit", 1).open("a") as file:
        file.write(f"{line}\n")

    assert main(["audit", "show", str(state), "--last", "1"]) == 0

    assert capsys.readouterr().out == f"?  {line!r}\n"


def test_an_empty_segment_is_an_empty_chain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "audit-00000001.jsonl").touch()

    assert main(["audit", "verify", str(tmp_path)]) == 0

    assert capsys.readouterr().out == f"{tmp_path}: 0 entries from line 1 on, chain whole\n"
