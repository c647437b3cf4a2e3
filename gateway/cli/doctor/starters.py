"""Findings of the starters' settings, read directly or through the gateway that holds their port."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gateway.app.capacity import LineCapacity
from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.parameters.through_gateway import LiveStarter
from gateway.client import Client
from gateway.config import setups_of, timing_of
from gateway.contract import AvailabilityRecord, CommandError, ResultCode, rfc3339
from gateway.errors import BrokerError, NoResultError, PortError, PortLostError, StoreError
from gateway.families import Identity, Weight, device_of, diagnosis, reading
from gateway.line import Garbled, Outcome, PortOpener, Silent, Survey
from gateway.modbus import Request
from gateway.starters import (
    FINGERPRINTS,
    KNOWN,
    StarterSetup,
    identified,
    merged,
    mismatch_in,
    read_in_bulk,
)
from gateway.starters.parameters.model import entries_of
from gateway.store import STATE_FILE, read_document
from gateway.system.instance_lock import may_use

BUSY = "busy"  # PortError's reason when another program holds the port
KNOWN_WITHIN_S = 2.0
COUNTERS = 4  # of telegrams and errors, where a starter has them
MOST_CORRUPTED = 0.01  # of the requests; more of them are a problem
FEW = 1000  # requests that a share is taken of at least: the counters are cyclic

Rows = dict[str, tuple[int, ...]]


@dataclass(frozen=True)
class LineCheckup:
    """One line's port and starters; where a gateway holds the port it is asked, as an operator would.

    `operator` is None when the broker cannot be used.
    """

    prospect: LineCapacity
    opener: PortOpener
    findings: Findings
    operator: Client | None
    state_dir: Path

    async def run(self) -> None:
        """Examine each starter."""
        table, where = self.prospect.table, f"line {self.prospect.table.name}"
        setups = [setup for setup in setups_of(table) if setup.is_enabled]
        timing, allowance_s = timing_of(table), table.adapter_allowance_s
        if may_use(table.port, self.state_dir):
            try:
                async with Survey(self.opener, timing, allowance_s=allowance_s) as survey:
                    self._say(where, f"{table.port} opens")
                    for setup in setups:
                        await self._ask_directly(setup, survey)
                    if survey.is_echoing:
                        self._say(where, "its adapter echoes what it sends; the gateway drops the echo")
                    return
            except PortError as error:
                if isinstance(error, PortLostError) or error.reason != BUSY:
                    self._say(where, str(error), Weight.ERROR)
                    return
        self._say(where, f"{table.port} is in use; the gateway is asked over MQTT")
        for setup in setups:
            await self._ask_the_gateway(setup)

    def _say(self, where: str, text: str, weight: Weight | None = None, remedy: str = "") -> None:
        self.findings.add(Finding(where, text, weight, remedy))

    async def _ask_directly(self, setup: StarterSetup, survey: Survey) -> None:
        async def put(request: Request) -> Outcome:
            within_s = setup.response_time_of(request)
            outcome = await survey.ask(setup.address, request, response_time_s=within_s)
            if isinstance(outcome, Silent | Garbled) and not outcome.is_sent:  # nothing ever will be
                raise PortLostError(self.prospect.table.port, outcome.reason, "what else is on this line?")
            return outcome

        where, codes = f"starter {setup.name}", _codes(setup)
        try:
            identity = await identified(setup, lambda question: put(question.request))
            rows = (await read_in_bulk(put, setup.profile, reading.bulk_reads(setup.profile, codes))).rows
        except CommandError as error:
            self._say(where, error.text, Weight.ERROR)
            return
        variant = merged(setup.variant, identity)
        self._say(where, f"is {variant.model or setup.profile.title}")
        if trouble := _identity_trouble(self.state_dir, setup, identity):
            self._say(where, f"commands would be held: {trouble}", Weight.ERROR)
        self._judge(setup, identity, rows)
        for watchdog in diagnosis.watchdogs(setup.profile, variant, rows)[:1]:
            within = f"the gateway must poll within {watchdog.after_s:g} s"
            self._say(where, f"{watchdog.code} runs since this look: {within}", Weight.NOTE)

    async def _ask_the_gateway(self, setup: StarterSetup) -> None:
        where, slots = f"starter {setup.name}", device_of(setup.profile).slot_rows
        if self.operator is None:
            self._say(where, "cannot be asked: the broker cannot be used", Weight.WARNING, "see above")
            return
        live = LiveStarter(setup.name, setup.profile, self.operator)
        try:
            asking = self.operator.connection()
            known = await asking.retained(AvailabilityRecord, within_s=KNOWN_WITHIN_S, starter=setup.name)
            if known is not None and known.state != "online":
                since = f" since {at}" if (at := rfc3339(known.since_s)) else ""
                text = f"the gateway says: {known.state}{since}: {known.reason or 'no reason given'}"
                self._say(where, text, Weight.ERROR)
            if known is not None and known.state == "offline":
                return  # every question would be refused
            rows = (await live.read(_codes(setup))).rows
        except (BrokerError, NoResultError) as error:
            is_refused = ResultCode.NOT_ALLOWED in str(error)
            remedy = "--client NAME asks as another operator" if is_refused else ""
            self._say(where, f"cannot be asked: {error}", Weight.WARNING, remedy)
            return
        if not rows:
            what = "the gateway reads nothing of it: see its availability and its events"
            self._say(where, what, Weight.ERROR)
            return
        self._say(where, "answers the gateway")
        identity = Identity()
        if slots and all(code in rows for code in slots):
            identity = diagnosis.identify(setup.profile, {"slots": tuple(rows[code][0] for code in slots)})
        self._judge(setup, identity, rows)

    def _judge(self, setup: StarterSetup, identity: Identity, rows: Rows) -> None:
        profile, variant, where = setup.profile, merged(setup.variant, identity), f"starter {setup.name}"
        entries = entries_of(profile, variant, rows)
        sources = [code for code in device_of(profile).source_rows if code in entries]
        if sources:
            shown = ", ".join(f"{code} = {entries[code].shown}" for code in sources)
            self._say(where, f"its command sources: {shown}")
        gaps_s = {starter.table.name: starter.gap_s for starter in self.prospect.starters}
        found = diagnosis.readiness(
            profile,
            variant,
            rows,
            gap_s=gaps_s.get(setup.name),
            watchdog_s=setup.watchdog_s,
            slot_trouble=diagnosis.slot_trouble(profile, setup.variant, identity),
        )
        for finding in found:
            self._say(where, finding.text, finding.weight)
        counters = [rows[code][0] for code in device_of(profile).counter_rows if code in rows]
        self.findings.add(telegrams_finding(where, *counters) if len(counters) == COUNTERS else None)


def telegrams_finding(where: str, received: int, sent: int, crc_errors: int, other_errors: int) -> Finding:
    """Return how the starter has received its requests, by its own counters.

    Errors there are of the way to the starter; of the way back the gateway counts the garbled replies.
    """
    text = f"it has counted {received} requests, {sent} replies, {crc_errors} requests with a wrong CRC"
    text += f" and {other_errors} bytes with other errors"
    if not crc_errors + other_errors:
        return Finding(where, text)
    is_bad = crc_errors > MOST_CORRUPTED * max(received, FEW)
    # Months of few errors look like a bad share of the requests since the counter last began again.
    remedy = "each count begins again after 65535; if errors still come, look at the cable to it"
    return Finding(where, text, Weight.WARNING if is_bad else Weight.NOTE, remedy)


def _codes(setup: StarterSetup) -> tuple[str, ...]:
    return (*diagnosis.readiness_codes(setup.profile), *device_of(setup.profile).counter_rows)


def _identity_trouble(state_dir: Path, setup: StarterSetup, identity: Identity) -> str:
    """Return why this may be another starter; empty when it is the known one, or the first one seen here."""
    try:
        known = read_document(state_dir / STATE_FILE, FINGERPRINTS, KNOWN) or {}
    except StoreError as error:
        return f"whether it is the starter that the gateway knows is unknown: {error}"
    mismatch = mismatch_in(known.get(setup.name), setup, identity)
    return "" if mismatch is None else mismatch.event.text
