"""What holds of every command in whatever situation a starter is in."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare, verbs
from gateway.families.command.interlock import RULES
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import REFUSALS, Procedure
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import rows_in

RUN_COIL = {"ssw06": 100, "ssw07": 100, "sst": 0}
WORDS = st.integers(0, 0xFFFF)
SLOTS = st.sampled_from([Variant(), Variant(slot=1), Variant(slot=2)])
PROFILES = st.sampled_from([load_profile(family) for family in FAMILIES])
VALUES = st.one_of(
    st.integers(-10, 70000),
    st.floats(0, 1000, allow_nan=False),
    st.booleans(),
    st.text(max_size=4),
    st.none(),
)


@st.composite
def situations(draw: st.DrawFn) -> tuple[Profile, Variant, str, dict[str, Any], dict[str, tuple[int, ...]]]:
    """Draw a family, a verb other than start, arguments that may make sense, and rows as they may be seen."""
    profile = draw(PROFILES)
    codes = st.sampled_from([*profile.parameters, "P500", "nothing"])
    verb = draw(st.sampled_from([name for name in verbs(profile) if name != "start"]))
    args: dict[str, Any] = {}
    if verb in ("general_enable", "jog"):
        args = {"value": draw(st.booleans())}
    elif verb in ("direction", "local_remote"):
        args = {"value": draw(st.sampled_from(profile.commands[verb].values))}
    elif verb == "output":
        args = {"output": draw(st.sampled_from(sorted(profile.outputs))), "value": draw(VALUES)}
    elif verb == "reset":
        args = draw(st.sampled_from([{}, {"whole": True}]))
    elif verb == "read":
        several = st.fixed_dictionaries({"parameters": st.lists(codes, max_size=6)})
        args = draw(st.one_of(st.fixed_dictionaries({"parameter": codes}), several))
    elif verb == "set":
        single = st.fixed_dictionaries({"parameter": codes, "value": VALUES})
        several = st.fixed_dictionaries({"parameters": st.dictionaries(codes, VALUES, max_size=4)})
        args = draw(st.one_of(single, several))
    elif verb == "configure" and profile.family == "ssw06":
        args = {"leave": draw(st.sampled_from(["P202", "factory"]))}
    elif verb == "configure":
        args = draw(st.dictionaries(st.sampled_from([f"R{number}" for number in range(30, 43)]), VALUES))
    seen = draw(st.dictionaries(st.sampled_from(shown(profile)), WORDS.map(lambda word: (word,))))
    return profile, draw(SLOTS), verb, args, seen


def shown(profile: Profile) -> list[str]:
    """Return the rows of one word that a command may have seen."""
    first = [
        profile.status_word,
        *profile.command_word,
        "COIL1",
        "R19",
        "R41",
        "C8.2.5.1",
        "C8.2.5.3",
        "P314",
    ]
    return [code for code in first if code in profile.parameters]


def attempt(
    profile: Profile, variant: Variant, verb: str, args: dict[str, Any], seen: dict[str, tuple[int, ...]]
) -> Procedure | None:
    """Build a command, None when it is refused."""
    try:
        return build(profile, variant, verb, args, seen=seen)
    except CommandError:
        return None


def writes(procedure: Procedure) -> list[tuple[int, int, int]]:
    """Return function, address and word of each write, the ones that follow a failure included."""
    requests = [*(step.request for step in procedure.steps), *procedure.abandon]
    pdus = [request.encode() for request in requests]
    return [(pdu[0], int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")) for pdu in pdus]


def sets_run(profile: Profile, write: tuple[int, int, int], seen: dict[str, tuple[int, ...]]) -> bool:
    function, address, word = write
    if function == 5:
        return address == RUN_COIL.get(profile.family) and word == 0xFF00
    for code in profile.command_word:
        if address == profile.parameters[code].address and function == 6:
            if profile.family == "ssw900":
                return bool(word & 1) and not seen.get(code, (0,))[0] & 1
            return profile.family == "ssw07" or word & 0x0101 == 0x0101
    return False


@settings(max_examples=300)
@given(situations())
def test_a_command_keeps_the_rules_of_its_family_in_any_situation(situation: Any) -> None:
    """Only a start sets a run bit; what is forbidden is not set; an SST is configured in its mode only."""
    profile, variant, verb, args, seen = situation
    check_refusals_and_reads(profile, variant, verb, args, seen)

    procedure = attempt(*situation)

    if procedure is None:
        return
    written = writes(procedure)
    assert not any(sets_run(profile, write, seen) for write in written)
    if profile.family == "sst":
        check_configuration_mode(procedure)
    elif verb == "set":
        forbidden = {*range(100, 108), 5003, 5007, 308, 312, *range(681, 687), *range(730, 734)}
        own = [step.request for step in procedure.steps if not (step.is_run_off or step.may_be_refused)]
        assert not {int.from_bytes(request.encode()[1:3]) for request in own} & forbidden
    if profile.family == "ssw900":  # no reserved bits
        to_words = [each for each in written if each[1] in (685, 686)]
        assert all(
            word & ~0x9F == 0 if function == 6 else word | 5 == 0xFFFF for function, _, word in to_words
        )


def check_configuration_mode(procedure: Procedure) -> None:
    """Assert that a register is written only between entering and leaving the mode."""
    is_in_mode = False
    for step in procedure.steps:
        pdu = step.request.encode()
        if pdu[:3] == b"\x05\x00\x01":
            is_in_mode = pdu[3] == 0xFF
            assert step.then is not None
        assert pdu[0] == 5 or is_in_mode
    assert not is_in_mode
    leaves = [request.encode() == b"\x05\x00\x01\x00\x00" for request in procedure.abandon]
    assert any(leaves) == any(step.request.encode()[:3] == b"\x05\x00\x01" for step in procedure.steps)


def check_refusals_and_reads(
    profile: Profile, variant: Variant, verb: str, args: dict[str, Any], seen: dict[str, tuple[int, ...]]
) -> None:
    """Assert that refusals are of the closed list, rules exist, and reads are within the limits."""
    code = ""
    try:
        preparation = prepare(profile, variant, verb, args)
        assert set(preparation.requires) <= set(RULES)
        for read in preparation.reads:
            count = int.from_bytes(read.request.encode()[3:5], "big")
            assert count <= profile.limits.read_registers or read.request.function == 1
            assert set(rows_in(profile, read, (0,) * count)) == set(read.codes)
        build(profile, variant, verb, args, seen=seen)
    except CommandError as error:
        code = error.code
    assert code in ("", *REFUSALS)


@given(WORDS, WORDS)
def test_a_reset_of_an_ssw900_changes_nothing_that_is_in_force(status: int, last: int) -> None:
    seen = {"S5.1.1": (status,), "S5.2.5": (last,)}

    procedure = attempt(load_profile("ssw900"), Variant(slot=1), "reset", {}, seen)

    turning = sum(1 << bit for bit in (0, 3, 4, 12))  # running, initial test, ramp, time before start
    assert (procedure is None) == bool(status & turning)
    if procedure is None:
        return

    for _, _, word in writes(procedure):
        assert bool(word & 0x02) == bool(status & 1 << 1)  # general enable
        assert bool(word & 0x10) == bool(status & 1 << 8)  # remote
        assert bool(word & 0x08) == bool(status & 1 << 11)  # direction
        assert not word & 0x05  # neither run nor jog
