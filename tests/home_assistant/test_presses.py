"""A press of a button is a command by our own rules: fresh at once, refused late, never done twice."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.mqtt.contract.commands import CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.starters.policy.request import CommandRequest
from tests.home_assistant.announced import Rendering, announced

NOW_S = 5_000.0
BUTTONS = announced()["fan"]["components"]


class Desk:
    """Judges what a press publishes, `late_s` after it."""

    def __init__(self, freshness: str = "token", doubt: str | None = None) -> None:
        boot = RunToken("run-1")
        boot.connected(0.0)
        self.rendering = Rendering()
        self._doubt = doubt
        self._parser = CommandParser(
            Topics("starters/mcc1"), Tokens(boot), freshness_of=lambda _: (freshness,)
        )

    def press(self, verb: str) -> Incoming:
        button = BUTTONS[verb]
        template = button.get("command_template")
        text = button["payload_press"] if template is None else self.rendering.command(template)
        return Incoming(button["command_topic"], text.encode())

    def judge(self, incoming: Incoming, late_s: float = 0.0) -> Any:
        moment = Moment(NOW_S + late_s, self.rendering.utc_s + late_s, self._doubt)
        return self._parser.judge(incoming, moment)


@pytest.mark.parametrize("freshness", ["token", "issued_at"])
@pytest.mark.parametrize("verb", ["start", "stop", "reset"])
def test_a_press_is_taken_whatever_proves_the_operators_commands_fresh(verb: str, freshness: str) -> None:
    desk = Desk(freshness)

    request = desk.judge(desk.press(verb), 0.3)

    assert isinstance(request, CommandRequest)
    assert (request.starter, request.client, request.verb) == ("fan", "home-assistant", verb)
    assert request.operator == "home-assistant"


@pytest.mark.parametrize("verb", ["start", "reset"])
@pytest.mark.parametrize(("late_s", "code"), [(5.1, "expired"), (600.0, "expired"), (-2.1, "not_fresh")])
def test_a_press_that_comes_late_or_of_a_wrong_clock_is_refused(verb: str, late_s: float, code: str) -> None:
    desk = Desk()

    refused = desk.judge(desk.press(verb), late_s)

    assert isinstance(refused, Rejection)
    assert refused.code == code


def test_a_start_is_refused_while_our_clock_is_not_trusted_and_a_stop_is_not() -> None:
    desk = Desk(doubt="the clock is not synchronised")

    assert desk.judge(desk.press("start")).code == "not_fresh"
    assert isinstance(desk.judge(desk.press("stop")), CommandRequest)


@pytest.mark.parametrize("verb", ["start", "reset"])
def test_a_press_that_was_retained_is_refused(verb: str) -> None:
    desk = Desk()
    press = desk.press(verb)

    assert desk.judge(Incoming(press.topic, press.payload, is_retained=True)).code == "retained"


def test_two_presses_of_one_moment_have_two_ids_and_a_copy_has_the_same() -> None:
    desk = Desk()
    ids = [desk.judge(desk.press("start")).id for _ in range(20)]
    copy = desk.press("start")

    assert len(set(ids)) == 20
    assert desk.judge(copy).id == desk.judge(copy, 1.0).id  # by which the ledger refuses it


def test_a_press_fits_into_the_bounds_of_a_command() -> None:
    body = json.loads(Desk().press("start").payload)

    assert len(body["id"]) <= 64
    assert len(body["issued_at"]) <= 40
