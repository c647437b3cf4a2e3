from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.config.convert import rights_of
from gateway.config.load import load, parse
from gateway.config.schema import Verb
from gateway.config.values import split_listen
from gateway.errors import ConfigError
from gateway.families.command.build import verbs
from gateway.families.profile.load import FAMILIES, load_profile
from tests.config.sites import SITE, changed, site


def problems(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "site.toml")
    return [str(problem) for problem in caught.value.problems]


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


def test_tables_that_are_empty_have_their_defaults() -> None:
    config = parse(SITE + "[web]\n[metrics]\n[homeassistant]\n", "site.toml")

    assert config.web is not None
    assert config.home_assistant is not None
    assert split_listen(config.web.listen) == ("127.0.0.1", 8480)
    table = config.home_assistant
    assert (table.operator, table.commands, table.discovery_prefix) == (None, False, "homeassistant")


@pytest.mark.parametrize("family", FAMILIES)
def test_every_familys_verbs_may_be_given_to_an_operator(family: str) -> None:
    assert set(verbs(load_profile(family))) <= set(Verb.__args__)  # type: ignore[attr-defined]  # of the Literal


@pytest.mark.parametrize(
    ("url", "port"),
    [("mqtts://b", 8883), ("mqtts://b:1", 1), ("mqtt://localhost", 1883), ("mqtt://[::1]", 1883)],
)
def test_the_port_of_the_broker_follows_the_scheme(url: str, port: int) -> None:
    config = site(("mqtts://broker.plant:8883", url))

    assert config.mqtt.port == port


def test_the_base_may_be_a_deeper_path() -> None:
    config = site(("[mqtt]", '[mqtt]\nbase = "acme/north/{gateway}/motors"'))

    assert config.base == "acme/north/mcc1/motors"


@pytest.mark.parametrize("empty", ["line = []", "operator = 3\nline = []"])
def test_a_site_without_lines_is_reported(empty: str) -> None:
    text = f'{empty}\n[gateway]\nname = "a"\n[mqtt]\nurl = "mqtts://b"\n'

    assert any(
        reported.endswith("line: is empty (at least one [[line]] is needed)") for reported in problems(text)
    )


def test_the_same_address_on_another_line_is_right() -> None:
    other = '[[line]]\nname="b"\nport="socket://h:1"\nbaud=9600\nframing="8N2"\n'

    config = parse(f'{SITE}{other}[[line.starter]]\nname="fan"\naddress=1\nfamily="sst"\n', "site.toml")

    assert [len(line.starters) for line in config.lines] == [2, 1]


def test_files_for_tls_are_refused_without_tls() -> None:
    reported = problems(
        changed(("mqtts://broker.plant:8883", "mqtt://localhost"), ("[mqtt]", '[mqtt]\nca_file = "a"'))
    )

    assert reported == ["line 5: mqtt.ca_file: has no meaning with mqtt:// (use mqtts://, or leave it out)"]


def test_a_password_in_the_url_is_not_repeated() -> None:
    reported = problems(changed(("mqtts://broker.plant:8883", "mqtts:/bob:secret@")))
    also = problems(changed(("mqtts://broker.plant:8883", "mqtts://bob:secret@:x")))

    assert "secret" not in reported[0] + also[0]


def test_an_sst_takes_any_baud_but_only_8n2() -> None:
    config = site(
        ('"ssw07"', '"sst"'), ('"ssw900"\nevery_s', '"sst"\nevery_s'), ('"8E1"', '"8N2"'), ("19200", "115200")
    )
    reported = problems(changed(('"ssw07"', '"sst"')))

    assert config.lines[0].baud == 115200
    assert reported == ["line 11: line[0].framing: '8E1' is not for sst (pump-1) (its manual allows 8N2)"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[gateway]\nname = \n", "line 2: syntax: there is no value after the =, at column 8 ("),
        (
            "[gateway]\nname = 1\nname = 2\n",
            "line 3: syntax: a key is given twice, or as a value and as a table",
        ),
        ('[gateway]\nname = "a', "line 2: syntax: "),
        ("a = " + "[" * 5000, "syntax: brackets are nested too deeply"),
        ("a = " + "1" * 5000, "line 1: syntax: a number has too many digits"),
        ("", "gateway: is missing (a table [gateway] is needed)"),
        ("gateway = 3", "mqtt: is missing"),
    ],
)
def test_a_broken_text_is_reported_with_its_line(text: str, problem: str) -> None:
    assert problems(text)[0].startswith(problem)


def test_a_file_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.toml", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(ConfigError, match=reason):
            load(path)


def test_a_file_that_is_not_utf_8_is_reported_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"[gateway]\nname = '\xff'\n")

    with pytest.raises(ConfigError, match="line 2: text: is not UTF-8"):
        load(tmp_path / "site.toml")


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"#" * 1_000_001)

    with pytest.raises(ConfigError, match="is larger than"):
        load(tmp_path / "site.toml")


WORDS = "[|]|[[|{|}|=|,|\"|'|#|\n|-1|nan|1e999|true|line|starter|\\|é"
SOME = st.lists(st.sampled_from(WORDS.split("|")), max_size=4).map("".join)


@settings(max_examples=300)
@given(st.integers(0, len(SITE)), st.integers(0, 12), SOME)
def test_whatever_is_changed_is_either_right_or_reported(at: int, cut: int, new: str) -> None:
    text = SITE[:at] + new + SITE[at + cut :]

    with contextlib.suppress(ConfigError):
        parse(text, "site.toml")


@pytest.mark.parametrize("freshness", ["token", "issued_at"])
def test_an_operator_says_what_proves_his_commands_fresh(freshness: str) -> None:
    config = site(('may = ["start", "stop"]', f'may = ["start", "stop"]\nfreshness = "{freshness}"'))

    assert rights_of(config).freshness("alice", verb="start", starter="pump-1") == (freshness,)


def test_by_default_a_token_proves_it_and_what_proves_nothing_is_no_setting() -> None:
    wrong = changed(('may = ["start", "stop"]', 'may = ["start", "stop"]\nfreshness = "none"'))

    assert site().operators[0].freshness == "token"
    assert any("freshness" in problem for problem in problems(wrong))


@pytest.mark.parametrize(
    ("refresh_s", "demand"), [("0.5", "at least 1"), ("1e5", "at most 86400"), ("nan", "")]
)
def test_values_are_published_again_after_a_second_at_the_soonest_and_a_day_at_the_latest(
    refresh_s: str, demand: str
) -> None:
    (problem,) = problems(SITE.replace("[mqtt]\n", f"[mqtt]\nrefresh_s = {refresh_s}\n", 1))

    assert "mqtt.refresh_s" in problem
    assert demand in problem
