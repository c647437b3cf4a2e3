from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.config.load import load, parse
from gateway.errors import ConfigError
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
    assert config.gateway.state_dir == Path("/var/lib/starter-gateway")
    assert [starter.every_s for starter in config.lines[0].starters] == [1.0, 2.0]
    assert config.lines[0].starters[0].enabled
    assert config.operators[0].may == ("start", "stop")


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


def test_without_operators_the_configuration_is_right_and_read_only() -> None:
    config = parse(SITE.partition("[[operator]]")[0], "site.toml")

    assert config.operators == ()


MISTAKES = [
    # one value, by the models
    ('name = "mcc1"', 'name = "MCC 1"', "line 2: gateway.name: is 'MCC 1' (only a-z, 0-9, _ and -)"),
    ('name = "mcc1"', "name = 7", "line 2: gateway.name: is 7 (must be a text in quotes)"),
    ('name = "mcc1"', 'nme = "mcc1"', "line 2: gateway.nme: unknown key (did you mean name?)"),
    ('name = "mcc1"', 'state_dir = "/x"', "line 1: gateway.name: is missing"),
    ("address = 1\n", "address = 0\n", "line 15: line[0].starter[0].address: is 0 (must be at least 1)"),
    ("address = 1\n", "address = 248\n", "line 15: line[0].starter[0].address: is 248 (must be at most 247)"),
    (
        "address = 1\n",
        "address = true\n",
        "line 15: line[0].starter[0].address: is true (must be a whole number)",
    ),
    ("every_s = 2.0", "every_s = -1", "line 22: line[0].starter[1].every_s: is -1 (must be at least 0)"),
    (
        "every_s = 2.0",
        "every_s = nan",
        "line 22: line[0].starter[1].every_s: is nan (must be a finite number)",
    ),
    ("every_s = 2.0", 'every_s = "2"', "line 22: line[0].starter[1].every_s: is '2' (must be a number)"),
    (
        "every_s = 2.0",
        "evry_s = 2",
        "line 22: line[0].starter[1].evry_s: unknown key (did you mean every_s?)",
    ),
    ("every_s = 2.0", "slot = 3", "line 22: line[0].starter[1].slot: is 3 (must be at most 2)"),
    (
        "every_s = 2.0",
        'enabled = "no"',
        "line 22: line[0].starter[1].enabled: is 'no' (must be true or false)",
    ),
    (
        "every_s = 2.0",
        "response_time_s = 0",
        "line 22: line[0].starter[1].response_time_s: is 0 (must be more than 0)",
    ),
    (
        'family = "ssw07"',
        'family = "ssw7"',
        "line 16: line[0].starter[0].family: is 'ssw7' (did you mean ssw07 or ssw06?)",
    ),
    (
        "baud = 19200",
        "baud = 19201",
        "line 10: line[0].baud: is 19201"
        " (must be 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200 or 230400)",
    ),
    (
        'framing = "8E1"',
        'framing = "7E1"',
        "line 11: line[0].framing: is '7E1' (did you mean 8E1?)",
    ),
    (
        '["start", "stop"]',
        '["start", "strat"]',
        "line 26: operator[0].may[1]: is 'strat' (did you mean start?)",
    ),
    ('["start", "stop"]', "[]", "line 26: operator[0].may: is empty (name at least one)"),
    (
        '["start", "stop"]',
        '"start"',
        'line 26: operator[0].may: is \'start\' (must be a list, e.g. ["start", "stop"])',
    ),
    ('["pump-*"]', '["Pump*"]', "line 27: operator[0].starters[0]: 'Pump*' fits no starter"),
    # one value, by the rules
    (
        "mqtts://broker.plant:8883",
        "mqtt://broker.plant",
        "line 5: mqtt.url: would send passwords and commands unencrypted"
        " (use mqtts://, or allow_plaintext = true)",
    ),
    (
        "mqtts://broker.plant:8883",
        "mqtts//broker",
        "line 5: mqtt.url: 'mqtts//broker' is no broker address (mqtts://host:8883)",
    ),
    (
        "mqtts://broker.plant:8883",
        "ssl://broker",
        "line 5: mqtt.url: 'ssl://broker' is no broker address (one of mqtt, mqtts)",
    ),
    (
        "mqtts://broker.plant:8883",
        "mqtts://broker:99999",
        "line 5: mqtt.url: 'mqtts://broker:99999' is no broker address (mqtts://host:8883)",
    ),
    (
        "mqtts://broker.plant:8883",
        "mqtts://bob:secret@broker",
        "line 5: mqtt.url: holds a login (use username and password_file)",
    ),
    (
        "mqtts://broker.plant:8883",
        "mqtts://broker/path",
        "line 5: mqtt.url: has more than a host and a port (leave out what follows the port)",
    ),
    (
        "[mqtt]",
        '[mqtt]\nbase = "Starters/{gateway}"',
        "line 5: mqtt.base: has the level 'Starters' (only a-z, 0-9, _ and - between slashes, and {gateway})",
    ),
    (
        "[mqtt]",
        '[mqtt]\nbase = "starters/"',
        "line 5: mqtt.base: has an empty level (only a-z, 0-9, _ and - between slashes, and {gateway})",
    ),
    (
        "[mqtt]",
        '[mqtt]\ncert_file = "c.pem"',
        "line 5: mqtt.cert_file: needs key_file beside it (a certificate and its key go together)",
    ),
    (
        "[mqtt]",
        '[mqtt]\npassword_file = "p"',
        "line 5: mqtt.password_file: needs username beside it (a password belongs to a user)",
    ),
    (
        "/dev/rs485-pumps",
        "COM1",
        "line 9: line[0].port: 'COM1' is no port"
        " (an absolute path such as /dev/serial/by-id/..., or socket://host:port)",
    ),
    # several values together
    (
        'name = "pump-2"',
        'name = "pump-1"',
        "line 19: line[0].starter[1].name: 'pump-1' is also line[0].starter[0].name"
        " (each starter needs its own name, whatever its line)",
    ),
    (
        "address = 2",
        "address = 1",
        "line 20: line[0].starter[1].address: 1 is also line[0].starter[0].address"
        " (each starter on a line needs its own address)",
    ),
    (
        "baud = 19200",
        "baud = 57600",
        "line 10: line[0].baud: 57600 is not for ssw07 (pump-1) (its manual allows 9600, 19200, 38400)",
    ),
    (
        'framing = "8E1"',
        'framing = "8O2"',
        "line 11: line[0].framing: '8O2' is not for ssw07 (pump-1) (its manual allows 8N2, 8O1, 8E1)",
    ),
    (
        'family = "ssw07"',
        'family = "ssw07"\nslot = 1',
        "line 17: line[0].starter[0].slot: ssw07 has no slots (leave it out)",
    ),
    (
        'family = "ssw07"',
        'family = "ssw07"\nwatchdog_s = 0.5',
        "line 17: line[0].starter[0].watchdog_s: would trip: up to ",
    ),
    # shapes
    (
        "[[operator]]",
        "[operator]",
        "line 24: operator: is not a list of tables (write [[operator]], with two",
    ),
    ("[mqtt]\n", "[mqqt]\n", "line 4: mqqt: unknown key (did you mean mqtt?)"),
    ("[mqtt]\n", "[mqqt]\n", "mqtt: is missing (a table [mqtt] is needed)"),
]


@pytest.mark.parametrize(("old", "new", "problem"), MISTAKES)
def test_a_mistake_is_told_with_its_line_its_key_and_the_mend(old: str, new: str, problem: str) -> None:
    told = problems(changed((old, new)))

    assert any(text.startswith(problem) for text in told), told


@pytest.mark.parametrize(("old", "new", "problem"), MISTAKES)
def test_no_mistake_draws_more_than_one_other_after_it(old: str, new: str, problem: str) -> None:
    assert len(problems(changed((old, new)))) <= 2


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file() -> None:
    text = changed(
        ('name = "mcc1"', 'name = ""'),
        ("mqtts://", "mqtt://"),
        ("address = 2", "address = 1"),
        ("every_s = 2.0", "every_s = -1"),
        ('["start", "stop"]', '["fly"]'),
    )

    told = problems(text)

    assert [problem.partition(":")[0] for problem in told] == [
        "line 2",
        "line 5",
        "line 20",
        "line 22",
        "line 26",
    ]


def test_a_second_line_with_the_same_name_and_port_is_told() -> None:
    line = SITE[SITE.index("[[line]]") : SITE.index("[[operator]]")].replace("pump-", "fan-")

    told = problems(SITE + line)

    assert told == [
        "line 29: line[1].name: 'pumps' is also line[0].name (each line needs its own name)",
        "line 30: line[1].port: '/dev/rs485-pumps' is also line[0].port"
        " (put all starters of a port under one [[line]])",
    ]


def test_the_same_address_on_another_line_is_right() -> None:
    other = '[[line]]\nname="b"\nport="socket://h:1"\nbaud=9600\nframing="8N2"\n'

    config = parse(f'{SITE}{other}[[line.starter]]\nname="fan"\naddress=1\nfamily="sst"\n', "site.toml")

    assert [len(line.starters) for line in config.lines] == [2, 1]


def test_plaintext_to_another_machine_is_possible_when_it_is_wanted() -> None:
    config = site(
        ("mqtts://broker.plant:8883", "mqtt://broker"), ("[mqtt]", "[mqtt]\nallow_plaintext = true")
    )

    assert not config.mqtt.is_tls


def test_files_for_tls_are_refused_without_tls() -> None:
    told = problems(
        changed(("mqtts://broker.plant:8883", "mqtt://localhost"), ("[mqtt]", '[mqtt]\nca_file = "a"'))
    )

    assert told == ["line 5: mqtt.ca_file: has no meaning with mqtt:// (use mqtts://, or leave it out)"]


def test_a_password_in_the_url_is_not_repeated() -> None:
    told = problems(changed(("mqtts://broker.plant:8883", "mqtts:/bob:secret@")))
    also = problems(changed(("mqtts://broker.plant:8883", "mqtts://bob:secret@:x")))

    assert "secret" not in told[0] + also[0]


def test_an_sst_takes_any_baud_but_only_8n2() -> None:
    config = site(
        ('"ssw07"', '"sst"'), ('"ssw900"\nevery_s', '"sst"\nevery_s'), ('"8E1"', '"8N2"'), ("19200", "115200")
    )
    told = problems(changed(('"ssw07"', '"sst"')))

    assert config.lines[0].baud == 115200
    assert told == ["line 11: line[0].framing: '8E1' is not for sst (pump-1) (its manual allows 8N2)"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[gateway]\nname = \n", "line 2: syntax: invalid value (see https://toml.io)"),
        ("[gateway]\nname = 1\nname = 2\n", "line 3: syntax: cannot overwrite a value (see https://toml.io)"),
        ('[gateway]\nname = "a', "line 2: syntax: "),
        ("a = " + "[" * 5000, "syntax: brackets are nested too deeply"),
        ("a = " + "1" * 5000, "syntax: exceeds the limit"),
        ("", "gateway: is missing (a table [gateway] is needed)"),
        ("gateway = 3", "mqtt: is missing"),
    ],
)
def test_a_broken_text_is_told_with_its_line(text: str, problem: str) -> None:
    assert problems(text)[0].startswith(problem)


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.toml", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(ConfigError, match=reason):
            load(path)


def test_a_file_that_is_not_utf_8_is_told_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"[gateway]\nname = '\xff'\n")

    with pytest.raises(ConfigError, match="line 2: text: is not UTF-8"):
        load(tmp_path / "site.toml")


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"#" * 1_000_001)

    with pytest.raises(ConfigError, match="is larger than"):
        load(tmp_path / "site.toml")


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_bytes(b"\xef\xbb\xbf" + SITE.encode())

    assert load(tmp_path / "site.toml") == site()


WORDS = st.sampled_from(
    [
        "[",
        "]",
        "[[",
        "{",
        "}",
        "=",
        ",",
        '"',
        "'",
        "#",
        "\n",
        "-1",
        "nan",
        "1e999",
        "true",
        "line",
        "starter",
        "\\",
        "é",
    ]
)


@settings(max_examples=300)
@given(st.integers(0, len(SITE)), st.integers(0, 12), st.lists(WORDS, max_size=4).map("".join))
def test_whatever_is_changed_is_either_right_or_told(at: int, cut: int, new: str) -> None:
    text = SITE[:at] + new + SITE[at + cut :]

    with contextlib.suppress(ConfigError):
        parse(text, "site.toml")
