"""How well the records of single starts agree with the motors of the demo, in real time."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from gateway.cli.demo.demo import CONFIG
from gateway.cli.demo.simulate import simulated_unit
from gateway.config.load import parse
from gateway.sim.core.start_curve import StartCurve, start_curve
from tests.end_to_end.demo_site import demo

ROUNDS = 10
STARTERS = ("pump", "mill")  # an SSW-07 and an SSW900
OVER_S = 60.0


async def demo_starts(rounds: int) -> None:
    """Print a line for each start, and the largest deviations."""
    print(f"load before: {os.getloadavg()[0]:.2f}", flush=True)
    worst: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        async with demo(Path(folder)) as scada:
            for number in range(rounds):
                for name in STARTERS:
                    known = scada.latest.get(f"starter/{name}/start", {}).get("id")
                    await scada.command(name, "start", f"{name}-{number}")
                    record = await scada._until(
                        f"starter/{name}/start",
                        lambda seen, known=known: seen["id"] != known,  # type: ignore[misc]
                        "was new",
                        within_s=OVER_S,
                    )
                    await scada.command(name, "stop", f"{name}-stop-{number}")
                    await scada.until(f"starter/{name}/state", within_s=OVER_S, state="ready", quality="good")
                    off = _deviations(record, _true(name))
                    worst.setdefault(name, []).append(max(off))
                    print(
                        f"{name}: {off[0]:.2f} % in time, {off[1]:.2f} % in peak, {off[2]:.2f} % in I2t; "
                        f"{record['rate_hz']} samples/s, within {record['resolution_s']} s said, "
                        f"load {os.getloadavg()[0]:.1f}",
                        flush=True,
                    )
    for name, each in worst.items():
        print(
            f"{name}: at most {max(each):.2f} %; {sum(one <= 3.0 for one in each)} of {len(each)} within 3 %"
        )


def _true(name: str) -> StartCurve:
    """Return how this motor of the demo starts."""
    config = parse(CONFIG.format(folder="/nowhere", port=1883), "demo.toml")
    table = next(each for line in config.lines for each in line.starters if each.name == name)
    return start_curve(simulated_unit(table).motor.data)


def _deviations(record: dict[str, Any], true: StartCurve) -> tuple[float, float, float]:
    """Return how far acceleration time, peak and I2t are from the motor's own, in percent."""
    return (
        100 * abs(record["acceleration_s"] / true.duration_s - 1),
        100 * abs(record["peak_a"] / true.peak_a - 1),
        100 * abs(record["i2t_a2s"] / true.i2t_a2s - 1) if "i2t_a2s" in record else float("inf"),
    )
