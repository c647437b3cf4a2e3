"""Which starters are on a line, found by reads alone; in virtual time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from gateway.app.capacity import check_watchdogs
from gateway.cli.command import Progress
from gateway.cli.scan.scan import addresses_in, config_text, stable_name
from gateway.cli.scan.search import Find, Search, SearchSettings, timings_in_order
from gateway.config.reading import parse
from gateway.families.devices.device import Identity
from gateway.families.devices.findings import Watchdog
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.modbus.adu import decode
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.faults import Impairment, Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.virtual_time import run_virtually

TIMING = LineTiming(19200, Framing.parse("8N2"))
READS = {3, 4, 43}  # what every family allows


def search(
    bus: SimulatedLine,
    *,
    timings: Sequence[LineTiming] = (TIMING,),
    addresses: str = "1-20",
    progress: Progress | None = None,
    **options: Any,
) -> list[Find]:
    wish = SearchSettings(tuple(timings), addresses_in(addresses), **options)

    async def run() -> list[Find]:
        quiet = progress or Progress(io.StringIO())
        return await Search(wish, lambda timing: bus.opener(timing=timing), quiet).run()

    return run_virtually(run())


def test_x_05_nothing_is_written_and_only_reads_that_every_family_allows_are_sent() -> None:
    bus = SimulatedLine(TIMING, [make_unit(family, address) for address, family in enumerate(FAMILIES, 3)])

    found = search(bus)

    assert len(found) == 4
    assert {decode(frame.data).pdu[0] for frame in bus.transcript if frame.sender == 0} <= READS
    assert [list(unit.writes) for unit in bus.units] == [[], [], [], []]
    assert bus.violations == []


def test_the_likeliest_setting_comes_first_and_none_is_left_out() -> None:
    timings = timings_in_order((9600, 19200), ("8N2", "8E1", "8O1"))

    assert (timings[0].baud, str(timings[0].framing)) == (19200, "8E1")
    assert len(set(timings)) == 6


def test_s9_18_a_watchdog_that_the_scan_has_started_does_not_act_while_it_lasts() -> None:
    unit = make_unit("ssw900", 1, settings={740: 1, 734: 10})  # fault F128 after 1.0 s

    bus = SimulatedLine(TIMING, [unit])
    (found,) = search(bus, addresses="1-100")

    assert [watchdog.after_s for watchdog in found.watchdogs] == [1.0]
    assert unit.trips == []
    asked = [frame for frame in bus.transcript if frame.sender == 0 and frame.data[0] == 1]
    assert len(asked) < 50  # in time, not at every step


class Corrupted(Impairment):
    """Every reply has a wrong CRC."""

    def apply(self, reply: Reply, dice: object) -> tuple[Reply, ...]:
        corrupted = bytes([*reply.adu[:-1], reply.adu[-1] ^ 0xFF])
        return (Reply(adu=corrupted, after_s=reply.after_s, deadline_s=reply.deadline_s),)


@pytest.mark.parametrize(
    ("product", "is_corrupted", "reason"),
    [(None, True, "not in Modbus"), ("PM-5000", False, "PM-5000")],
)
def test_what_is_no_starter_is_reported_with_what_it_says(
    product: str | None, reason: str, *, is_corrupted: bool
) -> None:
    bus = SimulatedLine(TIMING, [make_unit("ssw07", 5, product=product)])
    if is_corrupted:
        bus.impair(5, Corrupted())

    (found,) = search(bus)

    assert found.profile is None
    assert reason in found.identity.reason


def find(family: str | None, address: int, framing: str = "8N2", *watchdogs: Watchdog, **facts: Any) -> Find:
    profile = None if family is None else load_profile(family)
    return Find(address, LineTiming(19200, Framing.parse(framing)), profile, Identity(**facts), watchdogs)


def test_strangers_and_what_this_line_cannot_have_are_left_out_with_the_reason() -> None:
    tight = Watchdog("P314", 0.01, "stops the motor", is_felt=True)
    finds = [find("ssw07", 1, "8N2", tight), find("sst", 2, "8E1"), find(None, 3, reason="a\nb\x1b[2J")]

    text = config_text('/dev/tty"x', finds)

    (starter,) = parse(text, "x", check=check_watchdogs).lines[0].starters
    assert (starter.address, starter.watchdog_s) == (1, None)
    assert "# watchdog_s = 0.01 # P314: it stops the motor; this line is too slow for it\n" in text
    assert "# address 2 at 19200 8E1: Intecma SST (Intecma SST knows no framing 8E1)" in text
    assert "# address 3 at 19200 8N2: no known starter: a?b?[2J" in text


@pytest.mark.parametrize(("text", "expected"), [("7", (7,)), ("1-3", (1, 2, 3)), ("2,1-2,247", (2, 1, 247))])
def test_addresses_are_given_as_ranges(text: str, expected: tuple[int, ...]) -> None:
    assert addresses_in(text) == expected


def test_the_stable_name_of_an_adapter_is_preferred(tmp_path: Path) -> None:
    device, by_id = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.touch()
    by_id.mkdir()
    (by_id / "usb-FTDI").symlink_to(device)

    assert stable_name(str(device), by_id) == str(by_id / "usb-FTDI")
    assert stable_name(str(tmp_path / "ttyS0"), by_id) == str(tmp_path / "ttyS0")
    assert stable_name(str(device), tmp_path / "none") == str(device)
    assert stable_name("socket://box:4001", by_id) == "socket://box:4001"
