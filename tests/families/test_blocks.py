"""Many rows in few reads, which touch nothing that could refuse them: of the polls, and of a copy."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.families.profile.extension import SitePoint, extended, matching
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Access, Table
from gateway.families.profile.schema import Point, Profile
from gateway.families.reading import (
    GROUPS,
    LEAST_DELAY_S,
    Block,
    bulk_reads,
    is_set_by_people,
    is_setting,
    plan_blocks,
    readable_codes,
)
from gateway.modbus.timing import Framing, LineTiming
from tests.families.notation import rows, shown, table

UNKNOWN = rows("slot=0")[0]
POLLED = {
    "ssw900": "status:D1.1.1=h90*6 status:S5.1.1=h680*7 values:S1.1.5=h2*24 slow:S4.2.1=h50*11"
    " slow:S3.1.2=h232*1",
    "ssw07": "status:VB01=h5001*1 values:P002=h2*2 values:P014=h14*1 slow:P005=h5*3 slow:P011=h11*1"
    " slow:P030=h30*3 slow:P050=h50*1 slow:P081=h81*1",
    "ssw06": "status:VB01=h5001*1 values:P002=h2*2 values:VB06=h5006*1 slow:P010=h10*2 slow:P030=h30*3"
    " slow:P006=h6*1",
    "sst": "status:COIL1=c0*26 status:R12=i12*9 slow:R41=i41*2",
}
READABLE = {
    family: sorted(row.code for row in load_profile(family).parameters.values() if row.access != "none")
    for family in FAMILIES
}


def line(baud: int) -> LineTiming:
    return LineTiming(baud, Framing.parse("8E1"))


def count(block: Block) -> int:
    request: Any = block.request
    assert request.address == block.address
    return int(request.count)


def polling(family: str, codes: set[str]) -> Profile:
    """Return a profile that polls exactly these rows."""
    points = {f"x{place}": Point(code=code) for place, code in enumerate(sorted(codes))}
    return load_profile(family).model_copy(update={"points": points})


def joined(family: str, codes: str, baud: int | None = None) -> str:
    """Return the reads of these rows."""
    timing = None if baud is None else line(baud)
    blocks = plan_blocks(polling(family, set(codes.split())), UNKNOWN, timing=timing)
    return " ".join(shown(each.request) for each in sorted(blocks, key=lambda each: each.address))


@pytest.mark.parametrize("family", FAMILIES)
def test_a_family_is_polled_in_few_reads_each_point_in_its_group_or_an_earlier_one(family: str) -> None:
    profile = load_profile(family)
    blocks = plan_blocks(profile, UNKNOWN)
    group_of = {code: block.group for block in blocks for code in block.codes}

    assert sorted(f"{b.name}={shown(b.request)}" for b in blocks) == sorted(POLLED[family].split())
    for point in profile.points.values():
        if point.code:
            assert GROUPS.index(group_of[point.code]) <= GROUPS.index(point.group)


@given(st.data())
def test_a_plan_keeps_every_rule_of_the_family_whatever_the_line_costs(
    data: st.DataObject,
) -> None:
    family = data.draw(st.sampled_from(FAMILIES))
    profile = polling(family, data.draw(st.sets(st.sampled_from(READABLE[family]), max_size=60)))
    timing = line(data.draw(st.sampled_from([1200, 9600, 19200, 57600])))
    plain, by_cost = (plan_blocks(profile, UNKNOWN, timing=each) for each in (None, timing))

    for blocks in (plain, by_cost):
        codes = [code for block in blocks for code in block.codes]
        assert sorted(codes) == sorted(point.code for point in profile.points.values())
        for block in blocks:
            covered = set(range(block.address, block.address + count(block)))
            wanted = {row.address + place for row in block.rows for place in range(row.words)}
            is_coil = block.table is Table.COIL
            assert count(block) <= (profile.limits.read_bits if is_coil else profile.limits.read_registers)
            assert covered == wanted or profile.limits.max_gap  # an unknown register could refuse it
            assert covered == wanted or family != "ssw900" or count(block) >= 3  # shorter must be valid (7.3)
            assert wanted <= covered
            for row in profile.parameters.values():
                own = set(range(row.address, row.address + row.words))
                if blocks is plain and row.table is block.table:
                    assert own <= covered or not own & covered  # no long value is cut
    for block in by_cost:
        for one, other in pairwise(block.rows):
            gap = other.address - one.address - one.words
            another_s = timing.wire_s(8 + 5) + timing.silence_s + LEAST_DELAY_S
            assert gap <= 0 or timing.wire_s(2 * gap) <= another_s


@pytest.mark.parametrize(
    ("family", "codes", "baud", "expected"),
    [
        # a row from elsewhere does not endanger the read of one that the manual names
        ("ssw07", "P001 P002 P003", None, "h1*1 h2*2"),
        # a long run is broken where the family takes no more
        ("sst", " ".join(f"R{number}" for number in range(43)), None, "i0*24 i24*19"),
        ("sst", " ".join(f"R{number}" for number in (*range(4), *range(8, 28))), 19200, "i0*24 i24*4"),
        # registers between are read where that takes less time than another request
        ("ssw900", "S1.1.5 S1.6.2", 57600, "h2*16"),
        ("ssw900", "S1.1.5 S1.6.2", 19200, "h2*1 h17*1"),
        ("ssw900", "S1.1.5 S3.1.2", 57600, "h2*1 h232*1"),
        # but not where an unknown register may refuse the read
        ("ssw07", "P002 P005", 57600, "h2*1 h5*1"),
    ],
)
def test_rows_are_joined(family: str, codes: str, baud: int | None, expected: str) -> None:
    assert joined(family, codes, baud) == expected


def extra(family: str, asked: str, every_s: float = 1.0, *, baud: int = 19200) -> str:
    """Return which reads are other ones once rows are asked for (`S1.1.1 D6.2@2`), each with its rows."""
    points = []
    for word in asked.split():
        pattern, _, period = word.partition("@")
        points += [
            SitePoint(code=code, every_s=float(period or 10.0))
            for code in matching(load_profile(family), pattern)
        ]
    profile = extended(load_profile(family), (), tuple(points))
    plain, more = (
        plan_blocks(each, UNKNOWN, timing=line(baud), every_s=every_s)
        for each in (load_profile(family), profile)
    )
    return " ".join(
        f"{each.name}={shown(each.request)}/{len(each.rows)}" for each in more if each not in plain
    )


ASKED = """
ssw900 | S1.6.1 | 1 | values:S1.1.5=h2*24/11  # a row that a read passes anyway
ssw900 | S1.1.6 | 1 | slow:S1.1.6=h1*1/1  # one beside it is read with the slow ones
ssw900 | S1.1.1 S1.1.2 S1.1.3 | 1 | slow:S1.1.1=h26*6/3  # which becomes longer where another costs more
ssw900 | D6.1 D6.2 | 1 | slow:D6.1=h42*19/5
ssw900 | S1.6.1@2 | 1 | extra:S1.6.1=h16*1/1  # a read that is made less often than the row is wanted
ssw900 | S1.6.1@10 | 4 | extra:S1.6.1=h16*1/1
ssw06 | VB00 | 0.1 | slow:VB00=h5000*1/1  # the status stays as it is, whatever is beside it
ssw900 | S5.2.1@1 | 1 | status:S5.1.1=h680*7/4
ssw06 | P308 P312 P313 P314@2 | 1 | slow:P308=h308*1/1 slow:P312=h312*2/2 extra:P314=h314*1/1  # of one period
ssw06 | P314@0.5 P313@30 | 1 | extra:P314=h314*1/1 extra:P313=h313*1/1
ssw900 | S4.3.1 S4.3.2 | 1 | slow:S4.3.1=h63*1/1 slow:S4.3.2=h64*1/1  # an accessory's: a 0 would say nothing
ssw07 | P093 P094 | 1 | slow:P093=h93*2/2  # where a refusal says it
sst | COIL22 R31 R33@5 | 1 | status:COIL1=c0*26/23 slow:R31=i31*12/3 extra:R33=i33*1/1  # coils and registers
ssw07 | P003 VB01.0 P030 | 1 |  # a point of the family is none besides
"""  # family, rows (with their periods), the starter's period, the reads that are other ones


@pytest.mark.parametrize(("family", "asked", "every_s", "expected"), table(ASKED))
def test_rows_that_are_asked_for_are_joined_into_the_reads_that_are_there(
    family: str, asked: str, every_s: str, expected: str
) -> None:
    assert extra(family, asked, float(every_s)) == expected


@given(st.data())
def test_each_row_that_is_asked_for_is_read_once_and_often_enough(data: st.DataObject) -> None:
    family = data.draw(st.sampled_from(FAMILIES))
    periods = st.sampled_from([0.5, 2.0, 10.0, 60.0])
    asked = data.draw(st.dictionaries(st.sampled_from(READABLE[family]), periods, max_size=60))
    every_s = data.draw(st.sampled_from([0.0, 0.5, 1.0, 5.0]))
    plain = load_profile(family)
    points = tuple(SitePoint(code=code, every_s=period_s) for code, period_s in asked.items())
    profile, timing = extended(plain, (), points), line(data.draw(st.sampled_from([1200, 19200, 57600])))
    blocks = plan_blocks(profile, UNKNOWN, timing=timing, every_s=every_s)

    placed = [row.code for block in blocks for row in block.rows]
    assert len(placed) == len(set(placed))
    status = [
        [b.request for b in plan if b.group == "status"] for plan in (blocks, plan_blocks(plain, UNKNOWN))
    ]
    assert status[0] == status[1]
    assert len({block.name for block in blocks}) == len(blocks)
    for point in profile.points.values():
        if point.every_s is not None:
            row = profile.parameters[point.code]
            (block,) = (block for block in blocks if point.code in block.codes)
            assert block.slowest_s(every_s) <= point.every_s
            limits = profile.limits
            assert count(block) <= (limits.read_bits if row.table.is_bits else limits.read_registers)
            assert row.is_sure or family != "ssw900" or count(block) <= 2


@pytest.mark.parametrize("family", FAMILIES)
def test_every_readable_row_is_read_once_and_within_the_limits(family: str) -> None:
    profile = load_profile(family)
    codes = readable_codes(profile)

    reads = bulk_reads(profile, codes)

    read = [code for each in reads for code in each.codes]
    assert sorted(read) == sorted(codes)
    assert not any(profile.parameters[code].access is Access.NONE for code in codes)
    longest = max(profile.limits.read_registers, profile.limits.read_bits)
    assert all(int(each.request.count) <= longest for each in reads)  # type: ignore[attr-defined]  # all are runs
    assert all(not each.request.is_write for each in reads)


SETTINGS = {  # 2: a parameter that people set; 1: one that also changes by itself; 0: a reading or an output
    "ssw07": {"P314": 2, "P003": 0, "VB08": 0},
    "ssw900": {"C3.1": 2, "C8.1.1.5": 2, "C11.3.1": 1, "C6.3.1": 0, "S5.3.1": 0, "S5.2.5": 0},
    "sst": {"R41": 2, "COIL1": 0},
}


@pytest.mark.parametrize("family", SETTINGS)
def test_settings_are_distinguished_from_readings_outputs_and_commands(family: str) -> None:
    profile = load_profile(family)
    rows = {code: profile.parameters[code] for code in SETTINGS[family]}

    found = {code: is_setting(profile, row) + is_set_by_people(profile, row) for code, row in rows.items()}

    assert found == SETTINGS[family]
