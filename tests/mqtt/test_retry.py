from __future__ import annotations

from gateway.mqtt.retry import Backoff, Version, VersionChoice


def test_the_pauses_double_to_their_ceiling() -> None:
    backoff = Backoff(first_s=0.5, last_s=30.0, seed=1)

    pauses_s = [backoff.next_s() for _ in range(10)]

    for pause_s, longest_s in zip(pauses_s, [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30], strict=True):
        assert max(0.5, 0.75 * longest_s) <= pause_s <= longest_s


def test_gateways_with_different_seeds_come_back_at_different_times() -> None:
    pauses_s = set()
    for seed in range(5):
        backoff = Backoff(first_s=0.5, last_s=30.0, seed=seed)
        backoff.next_s()
        pauses_s.add(backoff.next_s())

    assert len(pauses_s) == 5


def test_a_connection_that_held_makes_the_next_pause_short() -> None:
    backoff = Backoff(first_s=0.5, last_s=30.0, seed=1)
    for _ in range(5):
        backoff.next_s()

    backoff.reset()

    assert backoff.next_s() == 0.5


def test_mqtt_5_is_tried_first_and_3_1_1_at_once_when_the_broker_does_not_take_it() -> None:
    choice = VersionChoice()
    first = choice.version

    assert choice.is_guess
    assert choice.unsupported()
    assert (first, choice.version) == (Version.V5, Version.V311)


def test_when_neither_version_is_answered_there_is_a_pause_between_the_pairs() -> None:
    choice = VersionChoice()

    at_once = [choice.unanswered() for _ in range(4)]

    assert at_once == [True, False, True, False]


def test_a_version_that_worked_is_kept_over_a_few_bad_attempts() -> None:
    choice = VersionChoice()
    choice.unsupported()
    choice.worked()

    assert not choice.is_guess
    assert [choice.unanswered() for _ in range(2)] == [False, False]
    assert choice.version.value == "3.1.1"
    choice.worked()
    assert [choice.unanswered() for _ in range(3)] == [False, False, False]
    assert choice.version is Version.V5


def test_a_version_that_worked_is_left_when_the_broker_says_it_does_not_speak_it() -> None:
    choice = VersionChoice()
    choice.worked()

    assert choice.unsupported()
    assert choice.version is Version.V311


def test_a_broker_that_is_away_or_refuses_says_nothing_about_the_version() -> None:
    choice = VersionChoice()

    assert not choice.failed(None, is_reached=False)
    assert not choice.failed(0x86, is_reached=True)
    assert choice.version is Version.V5


def test_a_failed_connection_tells_whether_the_other_version_is_worth_trying() -> None:
    assert VersionChoice().failed(0x84, is_reached=True)
    assert VersionChoice().failed(None, is_reached=True)


def test_a_configured_version_is_never_left() -> None:
    choice = VersionChoice(Version.V311)

    assert not choice.unsupported()
    assert not choice.unanswered()
    assert choice.version is Version.V311
    assert not choice.is_guess
