from __future__ import annotations

import pytest

from gateway.app.capacity import fast_gains, fast_lines
from gateway.config.load import parse
from gateway.errors import ConfigError
from tests.config.sites import changed, site


def test_fast_words_read_status_and_values_in_one_request_and_less_time() -> None:
    (line,) = site(("every_s = 2.0", "fast_words = true")).lines

    (gain,) = fast_gains(line)

    assert gain.starter == "pump-2"
    assert gain.requests[1] == 1 < gain.requests[0]
    assert gain.sweep_s[1] < 0.6 * gain.sweep_s[0]
    assert fast_lines(line)[0].startswith("  fast words: pump-2's status and values take 1 of ")


@pytest.mark.parametrize("more", ["fast_words = false", "fast_words = true\nenabled = false"])
def test_nothing_is_gained_without_the_switch_or_by_a_disabled_starter(more: str) -> None:
    (line,) = site(("every_s = 2.0", more)).lines

    assert fast_gains(line) == ()


def test_fast_words_of_a_family_that_has_none_are_a_mistake() -> None:
    with pytest.raises(ConfigError) as caught:
        parse(changed(("address = 1", "address = 1\nfast_words = true")), "site.toml")

    (problem,) = caught.value.problems
    assert (problem.key, problem.what) == (
        "line[0].starter[0].fast_words",
        "ssw07 has no words to map",
    )


def test_fast_words_are_off_unless_they_are_wanted() -> None:
    (line,) = site().lines

    assert not any(starter.fast_words for starter in line.starters)
