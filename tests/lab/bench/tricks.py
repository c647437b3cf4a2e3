"""What each trick for speed gains: `python -m tests.lab.bench.tricks [NAME ...] [--pairs N] [--gateway]`.

Runs of the line alone, with a trick and with it taken out, alternating: a busy machine is the same for
both of a pair. A trick stays when taking it out costs more than 0.3 % of efficiency, or 10 % of processor
time. With `--gateway` the two of a pair are whole gateways that run at the same time, each with its own line
and broker: only their processor time is compared then.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from typing import Any

from gateway.line import events, thread
from gateway.line.port import buffered, event_loop, tty
from gateway.system import gc_tuning
from tests.lab.bench.account import account
from tests.lab.bench.judge import Spec
from tests.lab.bench.plant import run_gateway
from tests.lab.bench.report import table
from tests.lab.bench.runs import run_subject
from tests.lab.bench.subjects import WITHOUT

SECONDS = 2.5
GATEWAY_WARM_S, GATEWAY_SECONDS = 9.0, 25.0
LEAST_EFFICIENCY, LEAST_CPU = 0.003, 0.10


def _plain_reader() -> None:
    loop = event_loop.PreciseLoop
    loop.add_quick_reader = loop.add_reader  # type: ignore[assignment,method-assign]
    loop.remove_quick_reader = loop.remove_reader  # type: ignore[assignment,method-assign]


class _Timers(dict[Callable[[], None], Any]):
    """Alarms as timers of the loop."""

    def __setitem__(self, call: Callable[[], None], at_s: float) -> None:
        super().__setitem__(call, asyncio.get_running_loop().call_at(at_s, call))

    def pop(self, call: Callable[[], None], *_: object) -> None:  # type: ignore[override]
        super().pop(call).cancel()


def _no_alarms() -> None:
    begin = event_loop.PreciseLoop.__init__

    def begin_with_timers(loop: event_loop.PreciseLoop, *args: Any) -> None:
        begin(loop, *args)
        loop.alarms = _Timers()

    event_loop.PreciseLoop.__init__ = begin_with_timers  # type: ignore[method-assign]


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
    "alarms within the selector": (False, _no_alarms),
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
    parser = argparse.ArgumentParser(prog="python -m tests.lab.bench.tricks", description=__doc__)
    parser.add_argument("names", nargs="*", help="all")
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--gateway", action="store_true", help="whole gateways: processor time alone")
    args = parser.parse_args()
    if args.gateway:
        for name in args.names or TRICKS:
            changes = sorted(_whole(name) for _ in range(args.pairs))
            each = ", ".join(f"{change:+.1%}" for change in changes)
            print(f"without {name}: CPU {median(changes):+.1%} ({each})", flush=True)
        return
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


def _whole(name: str) -> float:
    """Return by what share a gateway with eight starters takes more processor time without a trick."""

    def cpu_s(without: str) -> float:
        spec = Spec(family="ssw07", is_calm=True)
        module = "tests.lab.bench.without"
        return run_gateway(
            spec, warm_s=GATEWAY_WARM_S, seconds=GATEWAY_SECONDS, module=module, without=without
        ).cpu_s

    with ThreadPoolExecutor(2) as pool:
        with_it_s, without_s = pool.map(cpu_s, ("", name))
    return without_s / with_it_s - 1


def _run(without: str, is_bytewise: bool) -> tuple[float, float, int]:
    os.environ[WITHOUT] = without
    run = run_subject("line", Spec(is_bytewise=is_bytewise), warm_s=0.5, seconds=SECONDS)
    found = account(run.seen, run.law)
    return found.efficiency, run.cpu_s, found.too_soon


if __name__ == "__main__":
    main()
