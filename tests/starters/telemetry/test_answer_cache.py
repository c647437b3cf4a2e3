from __future__ import annotations

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import Block, plan_blocks
from gateway.starters.telemetry.decoding import AnswerCache, PointSources

SSW07, SST = load_profile("ssw07"), load_profile("sst")
KNOWN = Variant(model="SSW-07 85A", rated_current_a=85.0)


def block_with(profile: Profile, code: str) -> Block:
    return next(block for block in plan_blocks(profile, KNOWN) if code in block.codes)


def test_the_same_words_say_the_same_again_without_being_decoded() -> None:
    answers, block = AnswerCache(SSW07, PointSources(SSW07)), block_with(SSW07, "VB01")
    words = (3,) * block.request.count

    first = answers.read("key", block, KNOWN, words)

    assert first is not None
    assert first.decoded is not None
    assert first.decoded.points["running"].value is True
    assert answers.read("key", block, KNOWN, tuple(words)) is first


def test_other_words_another_variant_or_another_block_are_read_anew() -> None:
    answers, block = AnswerCache(SSW07, PointSources(SSW07)), block_with(SSW07, "VB01")
    words = (3,) * block.request.count
    first = answers.read("key", block, KNOWN, words)

    second = answers.read("key", block, KNOWN, (2,) * len(words))

    assert second is not None
    assert second.decoded is not None
    assert second.decoded.points["running"].value is False
    assert answers.read("key", block, KNOWN, words) is not first
    again = answers.read("key", block, KNOWN, words)
    assert answers.read("key", block, Variant(), words) is not again
    assert (
        answers.read("key", Block(block.name, block.group, block.request, block.rows), KNOWN, words)
        is not again
    )


def test_points_that_need_rows_of_another_poll_are_decoded_elsewhere() -> None:
    answers = AnswerCache(SST, PointSources(SST))
    single = next(row for row in block_with(SST, "COIL7").rows if row.code == "COIL7")
    whole = block_with(SST, "COIL7")
    block = Block("single", whole.group, type(whole.request)(single.address, 1), (single,))

    said = answers.read("key", block, KNOWN, (True,))

    assert said is not None
    assert said.rows == {"COIL7": (1,)}
    assert said.decoded is None
