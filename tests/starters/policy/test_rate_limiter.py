"""What is too many commands, and how often that is published."""

from __future__ import annotations

from gateway.starters.policy.start_rules import RateLimiter, RateLimits
from gateway.system.rate_limits import Bucket, Damper, Rate


def taken(bucket: Bucket, *times_s: float) -> list[bool]:
    return [bucket.take(now_s) for now_s in times_s]


def test_a_bucket_gives_its_burst_and_then_its_rate() -> None:
    bucket = Bucket(Rate(2.0, 3))

    assert taken(bucket, 0.0, 0.0, 0.0, 0.0) == [True, True, True, False]
    assert taken(bucket, 0.5, 0.5) == [True, False]


def test_a_bucket_never_holds_more_than_its_burst() -> None:
    bucket = Bucket(Rate(2.0, 3))
    bucket.take(0.0)

    assert taken(bucket, 1e6, 1e6, 1e6, 1e6) == [True, True, True, False]


def test_one_clients_flood_leaves_the_others_theirs() -> None:
    flood = RateLimiter(RateLimits(client=Rate(1.0, 5), starter=Rate(1.0, 5), everyone=Rate(1.0, 10)))

    loud = [flood.admits(client="loud", starter="a", now_s=0.0) for _ in range(1000)]
    quiet = [flood.admits(client="quiet", starter="a", now_s=0.0) for _ in range(5)]

    assert (sum(loud), sum(quiet)) == (5, 5)


def test_one_starter_takes_less_of_a_client_than_all_together() -> None:
    flood = RateLimiter(RateLimits(client=Rate(1.0, 5), starter=Rate(1.0, 2), everyone=Rate(1.0, 10)))

    assert [flood.admits(client="c", starter="a", now_s=0.0) for _ in range(3)] == [True, True, False]
    assert flood.admits(client="c", starter="b", now_s=0.0)


def test_everyone_together_has_a_limit_too() -> None:
    flood = RateLimiter(RateLimits(client=Rate(1.0, 5), starter=Rate(1.0, 5), everyone=Rate(1.0, 3)))

    assert sum(flood.admits(client=str(number), starter="a", now_s=0.0) for number in range(9)) == 3


def test_a_refusal_is_published_at_once_and_those_after_it_are_counted() -> None:
    damper = Damper()

    passed = [damper.passes("a", now_s=now_s) for now_s in (0.0, 0.01, 0.02, 0.3)]

    assert passed == [True, False, False, False]  # until their number is published
    assert damper.take("a", now_s=0.35) == 3
    assert [damper.passes("a", now_s=now_s) for now_s in (0.4, 0.46)] == [False, False]
    assert damper.take("a", now_s=0.5) == 2
    assert damper.passes("a", now_s=0.61)


def test_refusals_far_apart_are_all_published() -> None:
    damper = Damper()

    assert [damper.passes("a", now_s=now_s) for now_s in (0.0, 0.1, 0.25)] == [True, True, True]
    assert damper.passes("b", now_s=0.25)
