"""Simulate the starters of a configuration, with real byte times, on pseudo-terminals. A port that does not
exist yet is made (a link), so that `run` works with the same configuration.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
import uuid
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from gateway.cli.command import flag
from gateway.cli.demo.knobs import simulator_topics
from gateway.client import broker_at
from gateway.config import Config, LineTable, SimulatedMotorTable, StarterTable, load, timing_of
from gateway.errors import UsageError
from gateway.families import Table, load_profile, parameters
from gateway.mqtt import Version
from gateway.sim.bus.bus import Bus
from gateway.sim.bus.pty import PtyLine
from gateway.sim.controls import KNOBS
from gateway.sim.core.motor import PHASES
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit

TOLERANCE_S = 0.0002  # two programs never wake on the spot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="the site's TOML file")
    parser.add_argument(
        "--knobs",
        metavar="URL",
        help="a broker on loopback (mqtt://127.0.0.1:1883) where simulator/STARTER/KNOB trips, clears and"
        f" switches the simulated starters; KNOB is one of {', '.join(KNOBS)}",
    )
    flag(parser, "--companion", about=argparse.SUPPRESS)  # ends with its stdin


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or Ctrl-C."""
    work = simulate(load(args.config), knobs_at=args.knobs, is_companion=args.companion)
    asyncio.run(work)
    return 0


async def simulate(config: Config, *, knobs_at: str | None = None, is_companion: bool = False) -> None:
    """Serve every line on a pty until SIGTERM or SIGINT, or as a companion until stdin ends.

    PortError when the link of a port cannot be made.
    """
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ending.set)
    if is_companion:
        loop.add_reader(sys.stdin, ending.set)
    units = {each.name: simulated_unit(each) for each in config.starters if each.enabled}
    async with AsyncExitStack() as stack:
        if knobs_at is not None:  # before the links: who waits for these may use the knobs
            broker = broker_at(knobs_at, client_id=f"simulator-{uuid.uuid4().hex[:8]}")
            if is_companion and config.mqtt.version != "auto":  # amqtt takes seconds to refuse 5
                broker = replace(broker, version=Version(config.mqtt.version))
            await stack.enter_async_context(simulator_topics(units, broker))
            print(f"knobs: simulator/STARTER/KNOB at {broker.address}; {', '.join(KNOBS)}", flush=True)
        for table in config.lines:
            on_line = [units[each.name] for each in table.starters if each.enabled]
            bus = Bus(timing_of(table), on_line, name=table.name, chunk_bytes=None, tolerance_s=TOLERANCE_S)
            link = _link(table)
            line = PtyLine(bus, link=link)
            await line.start()
            stack.push_async_callback(line.stop)
            if link is None:
                print(_beside_a_real_port(table, line.path), file=sys.stderr, flush=True)
            way = line.path if link is None else f"{link} -> {line.path}"
            there = ", ".join(f"{each.name} ({each.family} at {each.address})" for each in table.starters)
            print(f"line {table.name}: {way}, {table.baud} {table.framing}: {there}", flush=True)
        await ending.wait()


def simulated_unit(starter: StarterTable) -> SimulatedUnit:
    """Return a starter as the configuration describes it: model, slot, its table `simulated`; UsageError."""
    simulated = starter.simulated
    profile = load_profile(starter.family)
    rows = profile.parameters
    options: dict[str, Any] = {"firmware": simulated.firmware, "slot": starter.slot}
    options = {key: value for key, value in options.items() if value is not None}
    options["settings"] = {rows[code].address: value for code, value in simulated.parameters.items()}
    if simulated.markers:
        markers = [(parameters.find(profile, code), is_on) for code, is_on in simulated.markers.items()]
        for name, table in (("coils", Table.COIL), ("discrete_inputs", Table.DISCRETE)):
            options[name] = {row.address: is_on for row, is_on in markers if row.table is table}
    try:
        unit = make_unit(
            starter.family, starter.address, seed=starter.address, model=starter.model, **options
        )
    except ValueError as error:
        raise UsageError(f"{starter.name} cannot be simulated: {error}") from None
    if simulated.braking_s:
        unit.motor.data = replace(unit.motor.data, braking_s=simulated.braking_s)
    _fit_motor(unit, simulated.motor)
    return unit


def _fit_motor(unit: SimulatedUnit, table: SimulatedMotorTable) -> None:
    supply = {"line_voltage_pct", "lost_phase"}
    unit.motor.become(replace(unit.motor.data, **table.model_dump(exclude=supply, exclude_none=True)))
    unit.motor.set_line_voltage(table.line_voltage_pct)
    unit.motor.lost_phase = None if table.lost_phase is None else PHASES.index(table.lost_phase)


def _beside_a_real_port(table: LineTable, path: str) -> str:
    """Return the warning that `run` with the same configuration does not talk to the simulated starters."""
    return (
        f"WARNING: line {table.name}: {table.port} IS A REAL PORT and is not simulated: a gateway with this "
        f'configuration moves REAL MOTORS (for the simulated starters give a copy of it port = "{path}")'
    )


def _link(table: LineTable) -> Path | None:
    path = Path(table.port)
    if "://" in table.port or (path.exists() and not path.is_symlink()):
        return None
    if path.is_symlink() and not str(path.readlink()).startswith("/dev/pts/"):
        return None  # a stable name of a real adapter
    return path
