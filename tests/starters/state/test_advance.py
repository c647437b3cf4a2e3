"""What follows from one reading after another: tables of words read, and of events with their times."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.starters.state.decoding import sources_of
from gateway.starters.state.readings import Moment, stale
from gateway.starters.state.starter_state import Happening, NewReadings, StarterState, advance, unread

REST, RUN, TRIP = "VB01=4102", "VB01=5123", "VB01=8100"
LOCAL, RAMP = "VB01=4002", "VB01=410B"
Step = tuple[float, str]


def happened(state: StarterState, *steps: Step, family: str = "ssw07") -> tuple[StarterState, list[str]]:
    """Return the state after these readings (hexadecimal words) and what has happened.

    Without words time passes; `lost`: nothing is good any more.
    """
    profile, said = load_profile(family), list[str]()
    for at_s, words in steps:
        rows = {
            code: (int(word, 16),)
            for code, word in (each.split("=") for each in words.split() if "=" in each)
        }
        points = sources_of(profile).decode(Variant(), rows).points
        lost = stale(state.points, state.points) if words == "lost" else {}
        state, happenings = advance(state, NewReadings(at_s, Moment(at_s, at_s), points, lost), profile)
        for each in happenings:
            if isinstance(each, Happening):
                said.append(f"{each.time_s:g} {each.event.text}")
            else:
                said.append(f"{each.alarm.code} {'on' if each.is_active else 'off'}")
    return state, said


def after(*steps: Step, family: str = "ssw07") -> list[str]:
    return happened(unread(load_profile(family)), *steps, family=family)[1]


BEGUN: tuple[Step, ...] = ((0, f"{REST} P014=0"), (1, f"{REST} P014=0"))
OVERLOAD = "fault E05 Motor overload"

MOTION = [
    ((), []),
    (((2, RUN),), []),  # a single reading is no event
    (((2, RUN), (3, RUN)), ["2 the motor has started (previous state: ready)"]),
    (((2, RUN), (2, RUN)), []),  # nor is one that is looked at twice
    (((2, RUN), (3, REST), (4, RUN)), []),
    (((2, RAMP), (3, RUN)), ["2 the motor has started (previous state: ready)"]),  # both are on
    (
        ((2, RUN), (3, RUN), (12, REST), (13, REST)),
        ["2 the motor has started (previous state: ready)", "12 the motor has stopped"],
    ),
    (
        ((2, LOCAL), (3, LOCAL), (4, "lost"), (30, LOCAL), (31, LOCAL), (33, REST), (34, REST)),
        ["2 the starter was switched to local operation", "33 the starter accepts remote commands again"],
    ),
    (((2, "lost"), (30, RUN), (31, RUN)), ["30 the motor has started (previous state: ready)"]),
    (((2, "lost"), (30, REST), (31, REST)), []),
]

TRIPS = [
    (((2, TRIP), (2.1, REST), (5, "")), []),  # a single reading
    (((2, TRIP), (2.1, TRIP), (2.2, "P014=5"), (2.4, "P014=5")), ["e05 on", f"2 {OVERLOAD}"]),
    (((2, TRIP), (2.1, "P014=5"), (2.2, "P014=5"), (2.3, TRIP)), ["e05 on", f"2 {OVERLOAD}"]),
    (  # the number of the fault before is not its own
        ((1.5, "P014=7"), (1.7, "P014=7"), (2, TRIP), (2.1, TRIP), (2.2, "P014=5"), (2.4, "P014=5")),
        ["e05 on", f"2 {OVERLOAD}"],
    ),
    (((2, TRIP), (2.1, TRIP), (2.2, "P014=5"), (3.9, "")), []),  # its number has been read once
    (((2, TRIP), (2.1, TRIP), (4, "")), ["fault on", "2 fault, its number is not known"]),
    (((2, TRIP), (2.1, TRIP), (2.2, "lost"), (4, "")), ["2 fault with an unknown number"]),
    (
        ((2, TRIP), (2.1, TRIP), (3, REST), (3.1, REST)),  # gone before its number came
        [
            "fault on",
            "fault off",
            "2 fault, its number is not known",
            "3 cleared: Fault, its number is not known",
        ],
    ),
    (
        ((2, TRIP), (2.1, TRIP), (4, ""), (5, "P014=5"), (5.2, "P014=5")),  # its number comes late
        ["fault on", "2 fault, its number is not known", "e05 on", "fault off", f"5 {OVERLOAD}"],
    ),
    (  # so does the same one as that of the fault before
        ((1.5, "P014=5"), (1.7, "P014=5"), (2, TRIP), (2.1, TRIP), (4, ""), (5, "P014=5"), (5.2, "P014=5")),
        ["fault on", "2 fault, its number is not known", "e05 on", "fault off", f"5 {OVERLOAD}"],
    ),
    (
        (
            (2, f"{TRIP} P014=5"),
            (3, f"{TRIP} P014=5"),
            (4, f"{TRIP} P014=0"),
            (5, f"{TRIP} P014=0"),
            (9, TRIP),
        ),
        ["e05 on", f"2 {OVERLOAD}"],  # it keeps its number
    ),
    (
        ((2, f"{TRIP} P014=5"), (3, f"{TRIP} P014=5"), (4, "P014=6"), (5, "P014=6")),  # a further fault
        ["e05 on", f"2 {OVERLOAD}", "e06 on", "e05 off", "4 fault E06 (not in the manual)"],
    ),
    (
        ((2, f"{TRIP} P014=5"), (3, f"{TRIP} P014=5"), (4, f"{REST} P014=0"), (5, REST), (6, "P014=0")),
        ["e05 on", f"2 {OVERLOAD}", "e05 off", "4 cleared: E05 Motor overload"],
    ),
    (
        ((2, f"{TRIP} P014=5"), (3, f"{TRIP} P014=5"), (4, "lost"), (90, TRIP), (91, TRIP), (91.1, "P014=5")),
        ["e05 on", f"2 {OVERLOAD}"],  # it has been there all the time
    ),
    (
        ((2, f"{RUN}"), (3, f"{RUN}"), (8, f"{TRIP} P014=5"), (9, f"{TRIP} P014=5"), (10, REST), (11, REST)),
        [
            "2 the motor has started (previous state: ready)",
            "e05 on",
            f"8 {OVERLOAD}",
            "e05 off",
            "10 cleared: E05 Motor overload",
        ],
    ),
]


@pytest.mark.parametrize(("steps", "said"), MOTION + TRIPS)
def test_events_follow_from_two_readings_in_a_row(steps: tuple[Step, ...], said: list[str]) -> None:
    assert after(*BEGUN, *steps) == said


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        (((0, RUN), (1, RUN)), []),
        (((0, REST), (1, RUN), (2, RUN)), ["1 the motor has started (previous state: ready)"]),
        (
            ((0, f"{TRIP} P014=5"), (1, f"{TRIP} P014=5")),
            ["e05 on", f"0 {OVERLOAD}, present at the first reading"],
        ),
        (((0, f"{REST} P014=5"), (1, f"{REST} P014=5")), []),  # the number of the last fault, long over
    ],
)
def test_the_first_readings_say_what_is_there(steps: tuple[Step, ...], said: list[str]) -> None:
    assert after(*steps) == said


@pytest.mark.parametrize(("known", "events"), [(("e05",), 0), (("e42",), 1), ((), 1)])
def test_a_fault_that_an_earlier_run_has_published_is_an_alarm_but_no_event(
    known: tuple[str, ...], events: int
) -> None:
    state = unread(load_profile("ssw07"), known)

    state, said = happened(state, (0, f"{TRIP} P014=5"), (1, f"{TRIP} P014=5"))

    assert len([each for each in said if OVERLOAD in each]) == events
    assert "e05 on" in said
    assert state.published_faults == ("e05",)


def test_the_faults_whose_event_was_published_are_open_while_a_trip_waits_or_nothing_is_known() -> None:
    state = unread(load_profile("ssw07"))
    found = [state.published_faults]
    for step in (*BEGUN, (2.0, TRIP), (2.1, TRIP), (4.0, ""), (5.0, "lost"), (6.0, REST), (7.0, REST)):
        state, _ = happened(state, step)
        found.append(state.published_faults)

    assert found == [None, (), (), None, None, ("fault",), None, ("fault",), ()]


def test_the_state_shows_the_number_of_the_present_fault_only() -> None:
    state = unread(load_profile("ssw07"))
    numbers = []
    for step in (*BEGUN, (1.5, "P014=7"), (2.0, TRIP), (2.2, "P014=5"), (3.0, REST)):
        state, _ = happened(state, step)
        numbers.append(state.status.number)

    assert numbers == [None, None, None, None, 5, None]


def test_an_event_carries_the_values_before_its_first_reading() -> None:
    profile = load_profile("ssw07")
    state, _ = happened(unread(profile), *BEGUN, (2, RUN))
    state, happenings = advance(state, NewReadings(3, Moment(3, 3)), profile)
    assert happenings == ()

    points = sources_of(profile).decode(Variant(), {"VB01": (0x5123,)}).points
    _, (started,) = advance(state, NewReadings(4, Moment(4, 4), points), profile)

    assert isinstance(started, Happening)
    assert started.first is not None
    before = started.first.earlier[-1]
    assert before.at_s == 2
    assert before.points["running"].value is False


def test_a_reading_that_is_handled_late_counts_where_nothing_newer_was_read() -> None:
    profile = load_profile("ssw07")
    points = sources_of(profile).decode(Variant(), {"VB01": (0x5123,)}).points
    state, _ = advance(unread(profile), NewReadings(5, Moment(5, 5), {"running": points["running"]}), profile)

    assert state.fresh(points, 4).keys() == points.keys() - {"running"}
    assert state.fresh(points, 5) == points
