"""The map of the SSW900's words: what is mapped, what is written, and what a reply proves."""

from __future__ import annotations

import pytest

from gateway.families.mapped_registers import (
    MappedBlock,
    build_map,
    fast_block,
    mapped,
    plan_with,
    prepare_map,
    probes,
)
from gateway.families.profile.consistency import contradictions
from gateway.families.profile.decode import decode_points
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Confidence
from gateway.families.profile.schema import MappedWords, Profile, Variant
from gateway.families.reading import plan_blocks, rows_in
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister, WriteRegisters
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

PROFILE = load_profile("ssw900")
VARIANT = Variant(slot=1)


def planned(profile: Profile = PROFILE) -> MappedBlock:
    block = fast_block(profile, VARIANT)
    assert block is not None
    return block


def map_requests(block: MappedBlock, seen: dict[str, tuple[int, ...]]) -> list[Request]:
    return [step.request for step in build_map(PROFILE, block, seen=seen).steps]


def changed(**more: object) -> Profile:
    return PROFILE.model_copy(update=more)


def test_status_and_values_are_mapped_and_what_is_read_rarely_is_not() -> None:
    block = planned()

    groups = {point.code: point.group for point in PROFILE.points.values()}
    assert set(block.codes) == {code for code, group in groups.items() if group != "slow"}
    assert block.request == ReadHoldingRegisters(1500, len(block.map))
    assert len(block.map) <= 50


def test_a_row_of_32_bits_takes_two_neighbouring_words_of_the_same_net_id() -> None:
    block = planned()

    at = block.map.index(PROFILE.parameters["S1.1.4"].address)
    assert block.map[at : at + 2] == (24, 24)


def test_each_mapped_word_has_a_companion_that_reads_its_place_in_the_map() -> None:
    block = planned()

    half = len(block.map) // 2
    assert block.map[half:] == tuple(range(1300, 1300 + half))


def test_a_row_that_the_starter_lacks_is_not_mapped_but_still_read() -> None:
    block = fast_block(PROFILE, VARIANT, missing={"S1.1.4"})
    assert block is not None

    plan = plan_with(PROFILE, VARIANT, block)

    assert "S1.1.4" not in block.codes
    assert "S1.1.4" in {code for each in plan[1:] for code in each.codes}


def test_a_row_that_the_manual_does_not_vouch_for_is_not_mapped() -> None:
    row = PROFILE.parameters["S1.7.1"].model_copy(update={"confidence": Confidence.INFERRED})
    profile = changed(parameters={**PROFILE.parameters, row.code: row})

    assert row.code not in planned(profile).codes


def test_what_does_not_fit_is_read_as_before_and_the_status_goes_first() -> None:
    profile = changed(fast_words=MappedWords(read=1500, map=1300, words=20, write=1600, write_words=20))

    block = planned(profile)
    plan = plan_with(profile, VARIANT, block)

    assert {"S5.1.1", "D1.1.1", "S5.2.5"} <= set(block.codes)
    assert len(block.map) <= 20
    codes = [code for each in plan for code in each.codes]
    assert sorted(codes) == sorted({code for each in plan_blocks(profile, VARIANT) for code in each.codes})


@pytest.mark.parametrize("family", [family for family in FAMILIES if family != "ssw900"])
def test_other_families_have_no_words_to_map(family: str) -> None:
    profile = load_profile(family)

    assert fast_block(profile, Variant()) is None
    assert probes(profile, Variant()) == ()
    assert plan_with(profile, Variant(), None) == plan_blocks(profile, Variant())


def test_a_starter_without_a_point_to_map_has_no_fast_block() -> None:
    codes = {code for block in plan_blocks(PROFILE, VARIANT) for code in block.codes}

    assert fast_block(PROFILE, VARIANT, missing=codes) is None


def test_every_row_is_probed_by_a_read_so_short_that_what_is_missing_is_refused() -> None:
    reads = probes(PROFILE, VARIANT)

    assert [code for read in reads for code in read.codes] == list(planned().codes)
    assert max(read.request.count for read in reads if isinstance(read.request, ReadHoldingRegisters)) == 2


def test_only_what_differs_is_written_neighbours_in_one_request() -> None:
    block = planned()
    seen = mapped(PROFILE, block) | {"C8.1.1.6": (0,), "C8.1.1.9": (7,), "C8.1.1.10": (8,)}

    procedure = build_map(PROFILE, block, seen=seen)

    assert [step.request for step in procedure.steps] == [
        WriteRegister(1301, block.map[1]),
        WriteRegisters(1304, block.map[4:6]),
    ]
    assert procedure.wears == 3
    assert procedure.subjects == ("C8.1.1.6", "C8.1.1.9", "C8.1.1.10")


def test_a_map_that_stands_is_not_written() -> None:
    procedure = build_map(PROFILE, planned(), seen=mapped(PROFILE, planned()))

    assert procedure.is_unchanged
    assert procedure.steps == ()
    assert procedure.wears == 0


def test_before_the_map_is_written_map_and_standstill_are_read() -> None:
    preparation = prepare_map(PROFILE, planned())

    codes = {code for read in preparation.reads for code in read.codes}
    assert {"S5.1.1", "C8.1.1.5", "C8.1.1.50"} <= codes
    assert preparation.requires == ("is_stopped",)


def mapped_starter() -> tuple[Talk, MappedBlock]:
    """Return a simulated starter with its points mapped."""
    talk, block = Talk(make_unit("ssw900", 1)), planned()
    for request in map_requests(block, {}):
        talk.ask(request)
    return talk, block


def test_the_mapped_words_say_what_the_rows_themselves_say() -> None:
    talk, block = mapped_starter()
    blocks = plan_blocks(PROFILE, VARIANT)

    fast = block.rows_in(PROFILE, talk.ask(block.request))

    plain: dict[str, tuple[int, ...]] = {}
    for each in blocks:
        if each.group != "slow":
            plain |= each.rows_in(PROFILE, talk.ask(each.request)) or {}
    assert fast == plain
    assert decode_points(PROFILE, VARIANT, fast or {})["line_voltage"].value is not None


@pytest.mark.parametrize("place", [0, 6, 14, 22, 23, 40, 45])
def test_no_value_is_taken_from_a_map_that_somebody_has_changed_in_any_word(place: int) -> None:
    talk, block = mapped_starter()

    talk.ask(WriteRegister(1300 + place, 4))

    assert block.rows_in(PROFILE, talk.ask(block.request)) is None


def test_the_read_back_of_a_map_is_met_by_the_map_and_by_nothing_else() -> None:
    talk, block = mapped_starter()
    verify = build_map(PROFILE, block, seen={}).verify
    assert verify is not None

    rows = {
        code: words
        for read in verify.reads
        for code, words in rows_in(PROFILE, read, talk.ask(read.request)).items()
    }

    assert verify.is_met(rows)
    assert not verify.is_met({**rows, "C8.1.1.20": (1,)})


def test_a_map_on_registers_that_are_no_writable_rows_is_a_mistake_of_the_profile() -> None:
    assert contradictions(PROFILE) == []
    assert contradictions(
        changed(fast_words=MappedWords(read=1500, map=1349, words=2, write=1600, write_words=20))
    ) == ["fast_words: register 1350 of the map is no writable row of one word"]


def test_a_map_needs_a_layout() -> None:
    profile = load_profile("ssw07")
    block = MappedBlock("x", "status", ReadHoldingRegisters(0, 2), (), ())

    assert mapped(profile, block) == {}
