"""Kills a process that records starts, and looks at what the file has after that."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from gateway.contract import StartRecord, read_stored
from gateway.plugins.history.baseline import FIRST, values_of
from gateway.plugins.history.starts import CURVES, SUMMARIES
from gateway.store import STATE, STATE_FILE, OutboxTable, read_file, read_history

LONGEST_S = 0.4
MOST_BETWEEN = 2  # starts that the outbox has and the history has not: one is recorded at a time
STARTERS = ("pump", "fan")


def kill_history_writer(
    write_until_killed: Callable[[str, Path, int, random.Random, float], list[str]],
    folder: Path,
    *,
    kills: int,
    dice: random.Random,
) -> int:
    """Kill the writer at any moment; return how many starts it named; AssertionError for a lost one."""
    named: dict[str, list[str]] = {starter: [] for starter in STARTERS}
    for kill in range(kills):
        for line in write_until_killed("history_writer", folder, kill, dice, LONGEST_S):
            starter, id_ = line.split()  # an event has more words: nothing was lost or set aside
            named[starter].append(id_)
        for starter in STARTERS:
            _check(folder, starter, named[starter])
    return sum(map(len, named.values()))


def _check(folder: Path, starter: str, named: list[str]) -> None:
    """Demand that everything that was named is there, and at most one more of each run."""
    rows = read_history(folder, starter)
    records = [read_stored(StartRecord, row.data, starter=starter) for row in rows if row.kind == "start"]
    starts = [start.id for start in records]
    curves = [row.id for row in rows if row.kind == "curve" and row.data["t_s"]]
    months = [row.data["outcomes"]["full_voltage"] for row in rows if row.kind == "month"]
    assert len(starts) == len(set(starts)) <= SUMMARIES
    known = [id_ for id_ in starts if id_ in set(named)]
    assert known == named[-len(known) :], f"{starter}: {known[-3:]} instead of {named[-3:]}"
    assert len(known) >= min(len(named), SUMMARIES - kills_of(starts))
    assert curves == starts[-CURVES:], "a start and its curve are stored together"
    assert sum(months) >= len(starts), "and so is the month's count"
    counted = [row.data["totals"]["starts"] for row in rows if row.kind == "counters"]
    assert sum(counted) == sum(months), "and so is that of the counters"
    ids = _waiting(folder, starter)
    upto = ids.index(starts[-1]) + 1
    assert starts == ids[:upto][-len(starts) :], "what the history has, the outbox had before it"
    assert sum(counted) == upto, "each start is counted once, also those that were taken over"
    assert len(ids) - upto <= MOST_BETWEEN
    if len({start.id for start in records if values_of(start) is not None} & set(named)) >= FIRST:
        assert [row.kind for row in rows].count("baseline") == 1


def _waiting(folder: Path, starter: str) -> list[str]:
    """Return the starts that wait for a broker, which there never was: all of them."""
    keys = read_file(folder / STATE_FILE, STATE, OutboxTable().keys)
    begin = f"{starter}:start/"
    return [key.removeprefix(begin) for key in keys if key.startswith(begin)]


def kills_of(starts: list[str]) -> int:
    """Return of how many runs there are starts: each may have stored one that it did not name."""
    return len({id_.partition("-")[0] for id_ in starts})
