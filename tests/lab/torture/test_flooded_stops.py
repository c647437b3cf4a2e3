"""How stops in a flood are judged: what is lost is excused in a small share of the messages only."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from tests.lab.torture.of_stops import AGAIN_S, NEVER_S, FloodedStop, judge_flooded

NOW_S = 1_760_000_000.0


@dataclass
class Listener:
    """What the gateway has said, by id."""

    said: dict[str, list[dict[str, Any]]]
    latest: dict[str, Any] = field(default_factory=dict)

    def of(self, id_: str) -> list[dict[str, Any]]:
        return self.said.get(id_, [])


class Site:
    """What the judge asks of a site."""

    def __init__(self, *taken: str) -> None:
        time = datetime.fromtimestamp(NOW_S, UTC).isoformat()
        self.listener = Listener({id_: [{"time": time}] for id_ in taken})
        self.failures: list[str] = []
        self.measurements: dict[str, Any] = {}

    def check(self, is_right: bool, what: str) -> None:
        if not is_right:
            self.failures.append(what)


def judged(site: Site, *stops: FloodedStop) -> list[str]:
    judge_flooded(site, list(stops))  # type: ignore[arg-type]  # as much of a site as it takes
    return site.failures


def obeyed(*ids: str, after_s: float = 0.1) -> FloodedStop:
    return FloodedStop(list(ids), AGAIN_S * (len(ids) - 1) + after_s, NOW_S + after_s)


def test_stops_whose_frames_follow_at_once_hold() -> None:
    site = Site("1", "2")

    assert judged(site, obeyed("1"), obeyed("2")) == []
    assert (site.measurements["messages"], site.measurements["lost by the broker"]) == (2, 0)


def test_a_lost_message_is_excused_where_the_next_one_stops_the_motor() -> None:
    site = Site("1", "2", "3b")

    assert judged(site, obeyed("1"), obeyed("2"), obeyed("3a", "3b")) == []
    assert site.measurements["lost by the broker"] == 1


def test_when_all_are_lost_it_fails() -> None:
    failures = judged(Site(), FloodedStop(["1"], NEVER_S), FloodedStop(["2"], NEVER_S))

    assert any("never arrived" in each for each in failures)
    assert any("no frame" in each for each in failures)


def test_when_more_than_a_quarter_of_the_messages_is_lost_it_fails() -> None:
    (failure,) = judged(Site("1b", "2"), obeyed("1a", "1b"), obeyed("2"))

    assert "never arrived" in failure


def test_a_stop_that_the_gateway_took_and_did_not_write_fails() -> None:
    failures = judged(Site("1", "2"), FloodedStop(["1"], NEVER_S), obeyed("2"))

    assert any("no frame" in each for each in failures)


def test_a_frame_that_follows_too_late_fails_although_it_came() -> None:
    (failure,) = judged(Site("1"), obeyed("1", after_s=3.0))

    assert "after its stop was taken" in failure
