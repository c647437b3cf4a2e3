"""What `fast_words` would spare a line: the same values in fewer requests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gateway.config.schema import LineTable
from gateway.config.setups import setups_of, timing_of
from gateway.line.forecast import forecast
from gateway.line.job import Poll
from gateway.starters.polling import fast_polls_of, polls_of


@dataclass(frozen=True, slots=True)
class FastGain:
    """One starter's status and values, read as they stand in the starter and by mapped words."""

    starter: str
    requests: tuple[int, int]  # before and after
    sweep_s: tuple[float, float]  # to ask for all of them once


def fast_gains(line: LineTable) -> tuple[FastGain, ...]:
    """Return what the starters of a line with `fast_words` gain by them."""
    gains = []
    for setup in setups_of(line):
        if setup.has_fast_words and setup.is_enabled:
            before, after = _often(polls_of(setup)), _often(fast_polls_of(setup))
            sweeps_s = _sweep_s(line, before), _sweep_s(line, after)
            gains.append(FastGain(setup.name, (len(before), len(after)), sweeps_s))
    return tuple(gains)


def fast_lines(line: LineTable) -> tuple[str, ...]:
    """Return the same in words, a line for each starter."""
    return tuple(
        f"  fast words: {gain.starter}'s status and values take {gain.requests[1]} of {gain.requests[0]}"
        f" requests, {gain.sweep_s[1]:.3f} s of {gain.sweep_s[0]:.3f} s (once they are mapped)"
        for gain in fast_gains(line)
    )


def _often(polls: Sequence[Poll]) -> list[Poll]:
    return [poll for poll in polls if poll.group != "slow"]


def _sweep_s(line: LineTable, polls: Sequence[Poll]) -> float:
    return forecast(polls, timing_of(line), allowance_s=line.adapter_allowance_s).sweep_s
