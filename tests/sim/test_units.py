"""What all simulated starters have in common: models, broken requests, time in leaps and at any moment."""

from __future__ import annotations

import random
import time

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.sim.factory import make_unit
from tests.sim.script import play, step


@pytest.mark.parametrize("family", FAMILIES)
def test_a_broken_request_gets_an_exception_and_never_harms(family: str) -> None:
    unit = make_unit(family, 5)

    for function in range(256):
        for tail in (b"", b"\0", b"\xff\xff\xff\xff"):
            reply = unit.handle(bytes((function,)) + tail, 0.0)
            assert reply is not None
            assert reply[0] & 0x80

    assert not unit.starts
    assert unit.handle(b"", 0.0) == bytes((0x80, 1))


@pytest.mark.parametrize("family", FAMILIES)
def test_two_hundred_starts_and_stops_at_any_moment_pass_in_no_time(family: str) -> None:
    dice = random.Random(7)
    talk = play(family, "given model='SST130i-140'; 0 s" if family == "sst" else "0 s")
    ends_by_s = time.process_time() + 20.0

    for _ in range(200):
        if dice.random() < 0.5:
            step(talk, dice.choice(("start", "stop")))
        else:
            talk.unit.set_mains(is_present=dice.random() < 0.8)
        talk.wait(dice.choice([0.0, 1e-12, dice.random(), dice.uniform(0, 30)]))

    assert talk.unit.now_s == talk.now_s
    assert time.process_time() < ends_by_s
