from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.line.events import Notifications
from gateway.line.rtu.outcome import Answered, Outcome, Silent
from gateway.line.rtu.trace import Trace
from tests.line.fakes import Listener, poll


class HurriedListener(Listener):
    """Notes in which order it was told and hurried."""

    def __init__(self) -> None:
        super().__init__()
        self.order: list[str] = []

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        self.order.append(key)

    def hurry(self) -> None:
        self.order.append("hurry")


@pytest.fixture
def listener() -> HurriedListener:
    return HurriedListener()


@pytest.fixture
def voice(listener: HurriedListener) -> Notifications:
    return Notifications("pumps", listener, Trace("pumps"), hurry=listener.hurry)


def answered(word: int) -> Answered:
    return Answered((word,), at_s=1.0, response_time_s=0.005)


STATUS, VALUES = replace(poll("status"), is_urgent=True), poll("values")


def test_an_answer_to_an_urgent_poll_that_says_something_new_is_hurried(
    voice: Notifications, listener: HurriedListener
) -> None:
    for word in (1, 1, 2, 2, 1):
        voice.tell_poll(STATUS, answered(word))
    voice.flush()

    assert listener.order == ["status", "hurry", "status", "status", "hurry", "status", "status", "hurry"]


def test_other_answers_and_silences_may_wait(voice: Notifications, listener: HurriedListener) -> None:
    for word in (1, 2):
        voice.tell_poll(VALUES, answered(word))
    voice.tell_poll(STATUS, Silent())
    voice.flush()

    assert listener.order == ["values", "values", "status"]


def test_nobody_needs_to_be_hurried(listener: HurriedListener) -> None:
    voice = Notifications("pumps", listener, Trace("pumps"))

    voice.tell_poll(STATUS, answered(1))
    voice.flush()

    assert listener.order == ["status"]
