"""Problems in the starters' settings, read directly or through the gateway that holds their port."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gateway.app.capacity import LineCapacity
from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.parameters.restore import identity_trouble
from gateway.config.convert import setups_of, timing_of
from gateway.contract import CommandError
from gateway.errors import BrokerError, PortError, PortLostError
from gateway.families import Identity, Weight, device_of, diagnosis, reading
from gateway.line import LineClient, PortOpener, exclusive_line
from gateway.starters import StarterSetup, merged
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.system.clock import Clock
from gateway.system.instance_lock import may_use

BUSY = "busy"  # PortError's reason when another program holds the port

Rows = dict[str, tuple[int, ...]]


@dataclass(frozen=True)
class LineCheckup:
    """One line's port and starters; `report` gets each finding at once."""

    prospect: LineCapacity
    opener: PortOpener
    report: Callable[[DoctorFinding], None]
    broker: BrokerAccess
    clock: Clock
    state_dir: Path

    async def run(self) -> None:
        """Examine each starter."""
        table, where = self.prospect.table, f"line {self.prospect.table.name}"
        setups = [setup for setup in setups_of(table) if setup.is_enabled]
        if may_use(table.port, self.state_dir):
            try:
                async with exclusive_line(
                    table.name, self.opener, timing_of(table), allowance_s=table.adapter_allowance_s
                ) as line:
                    self._say(where, f"{table.port} opens")
                    for setup in setups:
                        await self._ask_directly(setup, line)
            except PortError as error:
                if isinstance(error, PortLostError) or error.reason != BUSY:
                    self._say(where, str(error), Weight.ERROR)
                    return
            else:
                return
        self._say(where, f"{table.port} is in use; the gateway is asked over MQTT")
        for setup in setups:
            await self._ask_the_gateway(setup)

    def _say(self, where: str, text: str, weight: Weight | None = None) -> None:
        self.report(DoctorFinding(where, text, weight))

    async def _ask_directly(self, setup: StarterSetup, line: LineClient) -> None:
        bench = OfflineStarter(setup, line=line, clock=self.clock)
        where = f"starter {setup.name}"
        try:
            await bench.identify()
            rows = (
                await bench.read(reading.bulk_reads(setup.profile, diagnosis.readiness_codes(setup.profile)))
            ).rows
        except CommandError as error:
            self._say(where, error.text, Weight.ERROR)
            return
        self._say(where, f"is {bench.variant.model or setup.profile.title}")
        trouble = identity_trouble(self.state_dir, setup, bench.identity)
        if trouble:
            self._say(where, f"commands would be held: {trouble}", Weight.ERROR)
        self._judge(setup, bench.identity, rows)
        for watchdog in diagnosis.watchdogs(setup.profile, bench.variant, rows)[:1]:
            within = f"the gateway must poll within {watchdog.after_s:g} s"
            self._say(where, f"{watchdog.code} runs since this look: {within}", Weight.NOTE)

    async def _ask_the_gateway(self, setup: StarterSetup) -> None:
        where = f"starter {setup.name}"
        slots = device_of(setup.profile).slot_rows
        try:
            known = await self.broker.known(setup.name)
            if known:
                self._say(where, known, Weight.ERROR)
            if known.startswith("the gateway says: offline"):
                return  # every question would be refused
            rows = await self.broker.read(setup.name, diagnosis.readiness_codes(setup.profile))
        except BrokerError as error:
            self._say(where, f"cannot be asked: {error}", Weight.WARNING)
            return
        if not rows:
            what = "the gateway reads nothing of it: see its availability and its events"
            self._say(where, what, Weight.ERROR)
            return
        self._say(where, "answers the gateway")
        identity = Identity()
        if all(code in rows for code in slots) and slots:
            identity = diagnosis.identify(setup.profile, {"slots": tuple(rows[code][0] for code in slots)})
        self._judge(setup, identity, rows)

    def _judge(self, setup: StarterSetup, identity: Identity, rows: Rows) -> None:
        variant = merged(setup.variant, identity)
        gaps_s = {starter.table.name: starter.gap_s for starter in self.prospect.starters}
        gap_s = gaps_s.get(setup.name)
        findings = diagnosis.readiness(
            setup.profile,
            variant,
            rows,
            gap_s=gap_s,
            watchdog_s=setup.watchdog_s,
            slot_trouble=diagnosis.slot_trouble(setup.profile, setup.variant, identity),
        )
        for finding in findings:
            self._say(f"starter {setup.name}", finding.text, finding.weight)
        delivered = diagnosis.as_delivered(setup.profile, variant, rows)
        if delivered:
            self._say(f"starter {setup.name}", delivered)
