"""`starter-gateway doctor`: looks for problems of the machine and the starters' settings."""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from gateway.app import io
from gateway.app.capacity import prospects_of
from gateway.cli.command import counted
from gateway.cli.doctor.broker import OWN_NAME, BrokerAccess
from gateway.cli.doctor.machine import (
    DoctorFinding,
    box_remarks,
    clock_remark,
    dated_remark,
    latency_remark,
    state_dir_remark,
    wear_remarks,
)
from gateway.cli.doctor.starters import LineCheckup
from gateway.cli.operator_login import add_login, checked_client, user_name
from gateway.config.convert import timing_of
from gateway.config.load import load
from gateway.config.schema import Config
from gateway.families import Weight
from gateway.line import new_precise_loop
from gateway.system.clock import SystemClock


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Look for problems: timers and disk of this machine, ports, adapters, clock, state"
        " directory, broker, and in the starters command sources and communication watchdogs. Nothing is"
        " changed; exit code 1 when there is a problem. Run it as the gateway's user."
    )
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    who = f"the operator as whom a running gateway is asked, else --username, else {OWN_NAME}"
    add_login(parser, client=who)


def run(args: argparse.Namespace) -> int:
    """Print one finding a line, then the number of errors and warnings."""
    config = load(args.config)
    folder = Path(args.config).parent
    client = checked_client(args.client or args.username or OWN_NAME)
    broker = BrokerAccess(config, folder, client, args.username, args.password_file)
    print(f"{args.config}, looked at by user {user_name() or 'without a name'}")
    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        remarks = runner.run(_examine(config, folder, broker))
    return verdict(remarks)


def verdict(remarks: list[DoctorFinding]) -> int:
    """Print the number of problems and return the exit code."""
    errors = sum(remark.weight is Weight.ERROR for remark in remarks)
    warnings = sum(remark.weight is Weight.WARNING for remark in remarks)
    if not any(remark.is_problem for remark in remarks):
        print("no problems")
        return 0
    print(f"{counted(errors, 'error')}, {counted(warnings, 'warning')}")
    return 1


async def _examine(config: Config, folder: Path, broker: BrokerAccess) -> list[DoctorFinding]:
    remarks: list[DoctorFinding] = []

    def report(remark: DoctorFinding | None) -> None:
        if remark is not None:
            remarks.append(remark)
            print(remark, flush=True)

    report(clock_remark())
    report(dated_remark(config))
    state_dir = folder / config.gateway.state_dir
    report(state_dir_remark(state_dir))
    prospects = prospects_of(config)
    for remark in (*await box_remarks(state_dir), *wear_remarks(state_dir)):
        report(remark)
    for remark in await broker.remarks():
        report(remark)
    for prospect in prospects:
        table = prospect.table
        opener = io.MACHINE.make_opener(table.port, timing_of(table))
        await LineCheckup(prospect, opener, report, broker, SystemClock(), state_dir).run()
        report(latency_remark(table.port, f"line {table.name}"))
    return remarks
