"""What waits for the broker, and the motors' history, outlive SIGKILL: a writer is killed at any moment."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

from gateway.contract import StartRecord, read_stored
from gateway.plugins.history.baseline import FIRST, values_of
from gateway.plugins.history.starts import CURVES, SUMMARIES
from gateway.store import STATE_FILE, OutboxTable, read_history
from gateway.store.database import read_file
from gateway.store.schema import STATE

KILLS = 8
LONGEST_S = 0.4  # after the first lines
LINES = (1, 41)  # that are waited for, now few and now many, however quick the machine is
MOST_BETWEEN = 2  # starts that the outbox has and the history has not: one is recorded at a time
STARTERS = ("pump", "fan")


def test_no_start_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(5)
    named: dict[str, list[str]] = {starter: [] for starter in STARTERS}
    for kill in range(KILLS):
        for line in write_until_killed(tmp_path, kill, dice):
            starter, id_ = line.split()  # an event has more words: nothing was lost or set aside
            named[starter].append(id_)
        for starter in STARTERS:
            _check(tmp_path, starter, named[starter], has_gone_on=kill % 2 == 1)
        assert not list(tmp_path.glob("*aside*"))
    assert sum(map(len, named.values())) > 20 * KILLS


def write_until_killed(path: Path, number: int, dice: random.Random) -> list[str]:
    """Let the writer write LINES and a while longer, and kill it; return what it printed."""
    command = [sys.executable, "-m", "tests.end_to_end.history_writer", str(path), f"run{number}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        written = [writer.stdout.readline().strip() for _ in range(LINES[number % len(LINES)])]
        try:
            writer.wait(dice.uniform(0.0, LONGEST_S))
        except subprocess.TimeoutExpired:
            writer.kill()
        written += writer.stdout.read().splitlines()
    assert writer.returncode == -signal.SIGKILL
    return written


def _check(folder: Path, starter: str, named: list[str], *, has_gone_on: bool) -> None:
    """Demand that all that was published is stored for the broker, and that the history has all up to one.

    A run that `has_gone_on` for long enough has stored what earlier ones had only for the broker.
    """
    rows = read_history(folder, starter)
    records = [read_stored(StartRecord, row.data, starter=starter) for row in rows if row.kind == "start"]
    starts = [start.id for start in records]
    curves = [row.id for row in rows if row.kind == "curve" and row.data["t_s"]]
    months = [row.data["outcomes"]["full_voltage"] for row in rows if row.kind == "month"]
    counted = [row.data["totals"]["starts"] for row in rows if row.kind == "counters"]
    ids = _waiting(folder, starter)
    assert [id_ for id_ in ids if id_ in set(named)] == named, "what was published waits for the broker"
    upto = ids.index(starts[-1]) + 1 if starts else 0
    assert starts == ids[:upto][-SUMMARIES:], "the history has each of them once, up to one"
    assert curves == starts[-CURVES:], "a start and its curve are stored together"
    assert sum(months) == upto, "and so is the month's count"
    assert sum(counted) == upto, "and so is that of the counters"
    if has_gone_on:
        assert len(ids) - upto <= MOST_BETWEEN
        if len({start.id for start in records if values_of(start) is not None}) > FIRST:
            assert [row.kind for row in rows].count("baseline") == 1


def _waiting(folder: Path, starter: str) -> list[str]:
    """Return the starts that wait for a broker, which there never was: all of them."""
    keys = read_file(folder / STATE_FILE, STATE, OutboxTable().keys)
    begin = f"{starter}:start/"
    return [key.removeprefix(begin) for key in keys if key.startswith(begin)]
