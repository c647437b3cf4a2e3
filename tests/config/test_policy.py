"""Rules, groups and the clock's trust as a site configures them."""

from __future__ import annotations

from gateway.config.convert import policy_of
from gateway.config.reading import parse
from gateway.starters import RuleSet
from tests.config.sites import SITE

OWN = 'family = "ssw07"\n'


def policy(more: str = "", own: str = ""):  # type: ignore[no-untyped-def]  # a Policy
    return policy_of(parse(SITE.replace(OWN, OWN + own) + more, "site.toml"))


def test_shared_rules_hold_for_all_that_fit_and_the_nearest_wins_key_by_key() -> None:
    more = (
        '[[rules]]\nstarters = ["pump-*"]\nstarts_per_hour = 10\ntwo_step = ["start"]\n'
        '[[rules]]\nstarters = ["pump-2"]\nstarts_per_hour = 4\n'
    )
    own = "[line.starter.rules]\ntwo_step = []\nminimum_pause_s = 5\n"

    rules = policy(more, own).rules

    assert rules["pump-1"] == RuleSet(starts_per_hour=10, minimum_pause_s=5.0)
    assert rules["pump-2"] == RuleSet(starts_per_hour=4, two_step=frozenset({"start"}))


def test_a_group_has_all_starters_that_fit_in_the_order_of_the_lines() -> None:
    assert policy('[[group]]\nname = "hall"\nstarters = ["pump-2", "pump-*"]\n').groups == {
        "hall": ("pump-1", "pump-2")
    }
