"""Problems in the starters' settings, read directly or through the gateway that holds their port."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from gateway.app.capacity import LineCapacity
from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.parameters.restore import identity_trouble
from gateway.config.convert import setups_of, timing_of
from gateway.config.schema import LineTable
from gateway.errors import BrokerError, CommandError, PortError, PortLostError
from gateway.families.devices import device_of
from gateway.families.devices.findings import Weight
from gateway.families.diagnosis.identify import identify
from gateway.families.diagnosis.readiness import as_delivered, readiness, readiness_codes, watchdogs
from gateway.families.profile.schema import Variant
from gateway.families.reading import bulk_reads
from gateway.line.client import LineClient
from gateway.line.direct import exclusive_line
from gateway.line.port.base import PortOpener
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.starters.setup import StarterSetup, merged
from gateway.system.clock import Clock
from gateway.system.instance_lock import may_use

BUSY = "busy"  # PortError's reason when another program holds the port

Rows = dict[str, tuple[int, ...]]


class LineCheckup:
    """One line's port and starters."""

    def __init__(
        self,
        prospect: LineCapacity,
        opener: PortOpener,
        *,
        broker: BrokerAccess,
        clock: Clock,
        state_dir: Path,
    ) -> None:
        self._table: LineTable = prospect.table
        self._gaps_s = {starter.table.name: starter.gap_s for starter in prospect.starters}
        self._opener = opener
        self._broker = broker
        self._clock = clock
        self._state_dir = state_dir
        self._where = f"line {prospect.table.name}"

    async def run(self, report: Callable[[DoctorFinding], None]) -> None:
        """Examine each starter; `report` gets each finding at once."""
        setups = [setup for setup in setups_of(self._table) if setup.is_enabled]
        if not may_use(self._table.port, self._state_dir):
            await self._ask_for_all(setups, report)
            return
        try:
            async with exclusive_line(
                self._table.name,
                self._opener,
                timing_of(self._table),
                allowance_s=self._table.adapter_allowance_s,
            ) as line:
                report(DoctorFinding(self._where, f"{self._table.port} opens"))
                for setup in setups:
                    await self._ask_directly(setup, line, report)
        except PortLostError as error:
            report(DoctorFinding(self._where, str(error), Weight.ERROR))
        except PortError as error:
            if error.reason != BUSY:
                report(DoctorFinding(self._where, str(error), Weight.ERROR))
                return
            await self._ask_for_all(setups, report)

    async def _ask_for_all(
        self, setups: Iterable[StarterSetup], report: Callable[[DoctorFinding], None]
    ) -> None:
        report(DoctorFinding(self._where, f"{self._table.port} is in use; the gateway is asked over MQTT"))
        for setup in setups:
            await self._ask_the_gateway(setup, report)

    async def _ask_directly(
        self, setup: StarterSetup, line: LineClient, report: Callable[[DoctorFinding], None]
    ) -> None:
        bench = OfflineStarter(setup, line=line, clock=self._clock)
        where = f"starter {setup.name}"
        try:
            await bench.identify()
            rows = (await bench.read(bulk_reads(setup.profile, readiness_codes(setup.profile)))).rows
        except CommandError as error:
            report(DoctorFinding(where, error.text, Weight.ERROR))
            return
        report(DoctorFinding(where, f"is {bench.variant.model or setup.profile.title}"))
        trouble = identity_trouble(self._state_dir, setup, bench.identity)
        if trouble:
            report(DoctorFinding(where, f"commands would be held: {trouble}", Weight.ERROR))
        self._judge(setup, bench.variant, rows, report)
        for watchdog in watchdogs(setup.profile, bench.variant, rows)[:1]:
            what = (
                f"{watchdog.code} runs since this look: the gateway must poll within {watchdog.after_s:g} s"
            )
            report(DoctorFinding(where, what, Weight.NOTE))

    async def _ask_the_gateway(self, setup: StarterSetup, report: Callable[[DoctorFinding], None]) -> None:
        where = f"starter {setup.name}"
        slots = device_of(setup.profile).slot_rows
        try:
            known = await self._broker.known(setup.name)
            if known:
                report(DoctorFinding(where, known, Weight.ERROR))
            if known.startswith("the gateway says: offline"):
                return  # every question would be refused
            rows = await self._broker.read(setup.name, readiness_codes(setup.profile))
        except BrokerError as error:
            report(DoctorFinding(where, f"cannot be asked: {error}", Weight.WARNING))
            return
        if not rows:
            what = "the gateway reads nothing of it: see its availability and its events"
            report(DoctorFinding(where, what, Weight.ERROR))
            return
        report(DoctorFinding(where, "answers the gateway"))
        variant = setup.variant
        if all(code in rows for code in slots) and slots:
            contents = tuple(rows[code][0] for code in slots)
            variant = merged(variant, identify(setup.profile, {"slots": contents}))
        self._judge(setup, variant, rows, report)

    def _judge(
        self, setup: StarterSetup, variant: Variant, rows: Rows, report: Callable[[DoctorFinding], None]
    ) -> None:
        gap_s = self._gaps_s.get(setup.name)
        findings = readiness(setup.profile, variant, rows, gap_s=gap_s, watchdog_s=setup.watchdog_s)
        for finding in findings:
            report(DoctorFinding(f"starter {setup.name}", finding.text, finding.weight))
        delivered = as_delivered(setup.profile, variant, rows)
        if delivered:
            report(DoctorFinding(f"starter {setup.name}", delivered))
