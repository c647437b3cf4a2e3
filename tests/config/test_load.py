from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.config.reading import load, parse
from gateway.config.schema import Verb
from gateway.errors import ConfigError
from gateway.families.command.procedures import verbs
from gateway.families.profile.load import FAMILIES, load_profile
from tests.config.sites import SITE, site


def test_a_right_configuration_is_loaded_with_its_defaults() -> None:
    config = site()

    assert config.base == "starters/mcc1"
    assert config.client_id == "mcc1"
    assert (config.mqtt.host, config.mqtt.port, config.mqtt.is_tls) == ("broker.plant", 8883, True)
    assert config.mqtt.refresh_s == 300.0
    assert config.gateway.state_dir == Path("/var/lib/starter-gateway")
    assert [starter.every_s for starter in config.lines[0].starters] == [1.0, 2.0]
    assert config.lines[0].starters[0].enabled
    assert config.operators[0].may == ("start", "stop")
    assert (config.web, config.metrics, config.home_assistant, config.sparkplug) == (None,) * 4


@pytest.mark.parametrize("family", FAMILIES)
def test_every_familys_verbs_may_be_given_to_an_operator(family: str) -> None:
    assert set(verbs(load_profile(family))) <= set(Verb.__args__)  # type: ignore[attr-defined]  # of the Literal


def test_a_file_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.toml", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(ConfigError, match=reason):
            load(path)


def test_a_file_that_is_not_utf_8_is_reported_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"[gateway]\nname = '\xff'\n")

    with pytest.raises(ConfigError, match="line 2: text: is not UTF-8"):
        load(tmp_path / "site.toml")


WORDS = "[|]|[[|{|}|=|,|\"|'|#|\n|-1|nan|1e999|true|line|starter|\\|é"
SOME = st.lists(st.sampled_from(WORDS.split("|")), max_size=4).map("".join)


@settings(max_examples=300)
@given(st.integers(0, len(SITE)), st.integers(0, 12), SOME)
def test_whatever_is_changed_is_either_right_or_reported(at: int, cut: int, new: str) -> None:
    text = SITE[:at] + new + SITE[at + cut :]

    with contextlib.suppress(ConfigError):
        parse(text, "site.toml")
