"""What each trick for speed gains: `python -m tests.bench.tricks [NAME ...] [--pairs N]`.

Runs of the line alone, with a trick and with it taken out, in turn: a busy machine is the same for both of a
pair. A trick stays when taking it out costs more than 0.3 % of efficiency or 10 % of processor time.
"""

from __future__ import annotations

import argparse
import os
import random
from collections.abc import Callable
from statistics import median
from typing import Any

from gateway.line import events, thread
from gateway.line.port import buffered, event_loop, tty
from gateway.system import gc_tuning
from tests.bench.account import account
from tests.bench.judge import Spec
from tests.bench.report import table
from tests.bench.runs import run_subject

ENVIRONMENT = "BENCH_WITHOUT"
SECONDS = 2.5
LEAST_EFFICIENCY, LEAST_CPU = 0.003, 0.10


def _plain_reader() -> None:
    loop = event_loop.PreciseLoop
    loop.add_quick_reader = loop.add_reader  # type: ignore[assignment,method-assign]
    loop.remove_quick_reader = loop.remove_reader  # type: ignore[assignment,method-assign]


def _no_early_wake_up() -> None:
    def begin(lead: buffered.EarlyWakeUp) -> None:
        lead.seconds = 0.0

    buffered.EarlyWakeUp.__init__ = begin  # type: ignore[method-assign]
    buffered.EarlyWakeUp.learn = lambda *_: None  # type: ignore[method-assign]


def _no_precise_time() -> None:
    del event_loop.PreciseLoop.time


def _no_collector() -> None:
    gc_tuning.TunedCollector.spare = lambda _: None  # type: ignore[method-assign]
    gc_tuning.TunedCollector.end = lambda _: None  # type: ignore[method-assign]


def _one_by_one() -> None:
    events.EventQueue.__init__.__kwdefaults__["polls_wait_s"] = 0.0  # type: ignore[index]


def _set(module: Any, name: str, value: object) -> Callable[[], None]:
    return lambda: setattr(module, name, value)


TRICKS: dict[str, tuple[bool, Callable[[], None]]] = {  # byte by byte or in one chunk, and its taking out
    "reading within the selector": (False, _plain_reader),
    "early wake-up and busy wait": (False, _no_early_wake_up),
    "loop.time without a method": (False, _no_precise_time),
    "sleep while a reply comes by bytes": (True, _set(tty, "DOZE_FROM", 10**9)),
    "results of polls in batches": (False, _one_by_one),
    "interpreter handed over after 0.1 ms": (False, _set(thread, "SWITCH_INTERVAL_S", 0.005)),
    "garbage collection tuned": (False, _no_collector),
}


def take_out(name: str) -> None:
    """Do without a trick in this process."""
    TRICKS[name][1]()


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.tricks", description=__doc__)
    parser.add_argument("names", nargs="*", help="all")
    parser.add_argument("--pairs", type=int, default=6)
    args = parser.parse_args()
    rows = [_row(name, args.pairs) for name in args.names or TRICKS]
    head = ["without", "efficiency", "CPU", "silences broken", ""]
    print(table("What each trick gains, as medians of pairs", head, rows))


def _row(name: str, pairs: int) -> list[str]:
    is_bytewise = TRICKS[name][0]
    with_it: list[tuple[float, float, int]] = []
    without: list[tuple[float, float, int]] = []
    chance = random.Random(name)
    for _ in range(pairs):
        for is_without in chance.sample((False, True), 2):
            (without if is_without else with_it).append(_run(name if is_without else "", is_bytewise))
    efficiency = median(b[0] - a[0] for a, b in zip(with_it, without, strict=True))
    cpu = median(b[1] / a[1] - 1 for a, b in zip(with_it, without, strict=True))
    is_worth_it = efficiency < -LEAST_EFFICIENCY or cpu > LEAST_CPU
    broken = f"{sum(a[2] for a in with_it)} -> {sum(b[2] for b in without)}"
    cells = [name, f"{efficiency:+.4f}", f"{cpu:+.0%}", broken, "stays" if is_worth_it else "too little"]
    print(*cells, sep=" | ", flush=True)
    return cells


def _run(without: str, is_bytewise: bool) -> tuple[float, float, int]:
    os.environ[ENVIRONMENT] = without
    run = run_subject("line", Spec(is_bytewise=is_bytewise), warm_s=0.5, seconds=SECONDS)
    found = account(run.seen, run.law)
    return found.efficiency, run.cpu_s, found.too_soon


if __name__ == "__main__":
    main()
