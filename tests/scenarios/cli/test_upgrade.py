"""The first start after an upgrade: what an earlier version has stored is imported, and its files stay."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.errors import StoreError
from gateway.store.import_0_2 import import_files, is_import_due
from tests.rig import RigPlant, command, event, frames, never, played, result, row, seen
from tests.rig.rows import Action, act
from tests.rig.sites import ALICE, FOUR, HOME_ASSISTANT, QUICK
from tests.rig.state import fail_disk, heal_disk
from tests.scenarios.cli.lines import cli
from tests.store.golden.state import unpack_golden

BOOT = "e110bd14c3ad0c6b"  # the run of 0.2.0 that wrote the files
FIRST_HASH = "3466bdf1f2ac779c566c4a8037670646efbc2a6f6b148d8bc65389b180e2dfdb"  # of its audit


def left_by_0_2(plant: RigPlant) -> None:
    unpack_golden(plant.folder / "state")


def on_a_full_disk(plant: RigPlant) -> None:
    left_by_0_2(plant)
    fail_disk()


def looked_at(plant: RigPlant) -> None:
    """Ask before the first start, by what 0.2.0 knew of the watchdogs."""
    left_by_0_2(plant)
    wrong = cli("check CONFIG --upgrade --json", json={"starters/0/watchdog_s": 30.0})(plant)
    assert not wrong, wrong


def damaged(*names: str) -> Action:
    """Let some files of the state be none."""

    def damage(plant: RigPlant) -> None:
        for name in names:
            (plant.folder / "state" / name).write_text("Dear diary, " * 1000)

    return damage


def with_damaged(*names: str) -> Action:
    """Let this be what 0.2.0 has left, with some files that are none."""
    return lambda plant: (left_by_0_2(plant), act(plant, damaged(*names)))


def with_a_long_audit(plant: RigPlant) -> None:
    """Let the audit that 0.2.0 has left be in four files, and the last line cut short by a crash."""
    left_by_0_2(plant)
    folder = plant.folder / "state" / "audit"
    lines = (folder / "audit-00000001.jsonl").read_text().splitlines(keepends=True)
    for number in range(4):
        part = "".join(lines[3 * number : 3 * number + 3 if number < 3 else None])
        (folder / f"audit-{number + 1:08d}.jsonl").write_text(part)
    with (folder / "audit-00000004.jsonl").open("a") as file:
        file.write('{"kind":')


def untouched(plant: RigPlant) -> str:
    """Say which files of 0.2.0 are not as it left them, or what stands beside them."""
    golden = unpack_golden(plant.folder / "golden")
    state = plant.folder / "state"
    names = [path.relative_to(golden) for path in golden.rglob("*") if path.is_file()]
    changed = [str(name) for name in names if _hash(state / name) != _hash(golden / name)]
    beside = [str(path) for name in names for path in state.glob(f"{name}?*")]
    return f"{changed} {beside}" if changed or beside else ""


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def locked_under_0_2(plant: RigPlant) -> None:
    """Run 0.2.0 once more: an operator locks the pump."""
    state = plant.folder / "state"
    stored: dict[str, Any] = json.loads((state / "precautions.json").read_text())
    stored["starters"]["pump"]["lock"] = {"by": "bob", "since": 1.0, "reason": "belt", "operator": None}
    (state / "precautions.json").write_text(json.dumps(stored))
    with closing(sqlite3.connect(state / "gateway.sqlite")) as connection, connection:
        connection.execute("UPDATE meta SET value = value + 1000")


UPGRADES = [
    row(
        "commands, locks, messages, audit and history of 0.2.0 are imported, and its files stay",
        given=FOUR + ALICE + HOME_ASSISTANT,
        sim={"pump": QUICK},
        before=looked_at,
        at={
            3.0: command("mill/alice/start", id="1"),
            4.0: command("pump/alice/start", id="c2"),  # carried out by 0.2.0
        },
        then={
            3.5: result("start rejected locked"),
            6.0: [
                result("start confirmed ok"),
                lambda plant: "" if not plant.starter("pump").writes else "it was started again",
                seen("starter/mill/history", boot=BOOT),
                never("gateway/event", code="gap"),
                never("gateway/event", code="memory_damaged"),
                cli("audit show CONFIG", out=("version 0.2.0", "c4", "which 0.2.0 has written")),
                cli(f"audit verify CONFIG --contains {FIRST_HASH}", out="chain whole"),
                cli("history CONFIG belt", out="full voltage, 3.9151 s"),
                cli("doctor CONFIG", code=None, out="pump: this gateway has written 1 time"),
                cli("restore DIR/state/before-upgrade.tar.gz --to DIR/back", out="11 files in"),
                untouched,
            ],
        },
    ),
    row(
        "who went back to 0.2.0 and comes forward again has what happened meanwhile",
        given=FOUR + ALICE,
        before=left_by_0_2,
        at={
            3.0: command("mill/alice/unlock"),
            4.0: "end",
            5.0: [locked_under_0_2, "start"],
            8.0: command("pump/alice/start"),
            9.0: command("mill/alice/start"),
        },
        then={
            4.0: result("unlock confirmed ok"),
            8.5: result("start rejected locked"),
            9.5: result("start rejected locked"),
        },
    ),
    row(
        "a state that is damaged after the upgrade is lost: what 0.2.0 had stored does not take its place",
        given=FOUR + ALICE,
        before=left_by_0_2,
        at={4.0: ["end", damaged("state.sqlite"), "start"], 8.0: command("mill/alice/start", id="1")},
        then={9.0: [event("store_lost"), result("start rejected locked"), untouched]},
    ),
    row(
        "a damaged document and damaged commands of 0.2.0 are left out and said, the rest is imported",
        given=FOUR + ALICE,
        before=with_damaged("gateway.sqlite", "precautions.json"),
        at={3.0: command("pump/alice/unlock"), 4.0: command("pump/alice/unlock", id="c2")},
        then={
            3.5: result("unlock confirmed ok"),
            6.0: [
                event("memory_damaged", severity="error"),
                seen("starter/mill/history", boot=BOOT),
                cli("history CONFIG belt", out="full voltage, 3.9151 s"),
                cli(f"audit verify CONFIG --contains {FIRST_HASH}", out="chain whole"),
            ],
        },
    ),
    row(
        "of a long audit of 0.2.0 the newest part is imported, and the chain goes on",
        given=FOUR + ALICE,
        before=with_a_long_audit,
        then={
            3.0: [
                cli("audit verify CONFIG", out=("8 entries", "chain whole")),
                cli(f"audit verify CONFIG --contains {FIRST_HASH}", code=1, out="no line has the hash"),
            ]
        },
    ),
    row(
        "on a full disk no start is taken until all of 0.2.0 could be imported, and then all is known",
        given=FOUR + ALICE,
        sim={"pump": QUICK},
        before=on_a_full_disk,
        at={
            8.0: [command("pump/alice/start", id="c2"), command("pump/alice/stop")],
            12.0: heal_disk,
            25.0: command("pump/alice/start", id="c2"),  # carried out by 0.2.0
            26.0: command("mill/alice/start", id="1"),
        },
        then={
            12.0: [
                seen("result/pump/alice", phase="rejected", code="not_stored"),
                result("stop confirmed ok"),
                event("store_unavailable"),
            ],
            25.5: result("start confirmed ok"),
            30.0: [
                result("start rejected locked"),
                frames("pump", "05 00 64 00 00"),
                seen("starter/mill/history", boot=BOOT),
                never("gateway/event", code="store_lost"),
                cli("history CONFIG belt", out="full voltage, 3.9151 s"),
                cli(f"audit verify CONFIG --contains {FIRST_HASH}", out="chain whole"),
                untouched,
            ],
        },
    ),
    row(
        "damaged messages, history and audit of 0.2.0 cost nothing else",
        given=FOUR + ALICE,
        before=with_damaged("outbox.sqlite", "history.db", "audit/audit-00000001.jsonl"),
        at={70.0: command("mill/alice/start", id="1")},
        then={
            70.5: [
                result("start rejected locked"),
                never("starter/mill/history", boot=BOOT),
                cli("audit verify CONFIG", out="chain whole"),
            ]
        },
    ),
]


test_an_upgrade = played(UPGRADES)


def test_an_import_for_which_the_disk_has_no_room_is_not_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    state = unpack_golden(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=10, f_frsize=4096))

        with pytest.raises(StoreError, match=r"needs 0\.2 MiB"):
            import_files(state)

    assert not list(state.glob("*.sqlite.new*"))
    import_files(state)
    assert not is_import_due(state)
    assert caplog.records == []  # nothing was left out
