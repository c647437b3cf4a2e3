"""Every kind of mistake in a configuration, with the line, the key and the hint that it is reported with."""

from __future__ import annotations

import pytest

from gateway.app.capacity import check_watchdogs
from gateway.config.load import parse
from gateway.errors import ConfigError
from tests.config.sites import changed

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
    (
        "every_s = 2.0",
        "fast_words = false",
        "line 22: line[0].starter[1].fast_words: was removed in 0.3.0"
        " (leave it out: all points are read where they are)",
    ),
    (
        "baud = 19200",
        "baud = 19200\nlearn_response_times = true",
        "line 11: line[0].learn_response_times: was removed in 0.3.0"
        " (leave it out; where replies are sure to be sooner, set response_time_s)",
    ),
    (
        'may = ["start", "stop"]',
        'may = ["start", "stop"]\nfreshness = "boot"',
        "line 27: operator[0].freshness: was removed in 0.3.0"
        " (leave it out; the client sends the token of B/gateway/fresh, or issued_at)",
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
        'framing = "8E1"\norder = ["pump-2", "pump-3"]',
        "line 12: line[0].order[1]: 'pump-3' is not on this line (did you mean pump-2 or pump-1?)",
    ),
    (
        'framing = "8E1"',
        'framing = "8E1"\norder = ["pump-2"]',
        "line 12: line[0].order: leaves out 'pump-1'"
        " (name all starters of the line as the cable passes them)",
    ),
    (
        'framing = "8E1"',
        'framing = "8E1"\norder = ["pump-2", "pump-1", "pump-2"]',
        "line 12: line[0].order[2]: 'pump-2' stands twice (name each starter once)",
    ),
    (
        'framing = "8E1"',
        'framing = "7E1"',
        "line 11: line[0].framing: is '7E1' (did you mean 8E1?)",
    ),
    (
        '["start", "stop"]',
        '["start", "strat"]',  # codespell:ignore
        "line 26: operator[0].may[1]: is 'strat' (did you mean start?)",
    ),
    ('["start", "stop"]', "[]", "line 26: operator[0].may: is empty (name at least one)"),
    (
        '["start", "stop"]',
        '"start"',
        'line 26: operator[0].may: is \'start\' (must be a list, e.g. ["start", "stop"])',
    ),
    ('["pump-*"]', '["Pump*"]', "line 27: operator[0].starters[0]: 'Pump*' fits no starter"),
    ('["start", "stop"]', '["start", 3]', "line 26: operator[0].may[1]: is 3 (must be 'start', 'stop', "),
    ('name = "mcc1"', f'name = "{"a" * 65}"', "line 2: gateway.name: has 65 characters (at most 64)"),
    (
        "[mqtt]",
        '[mqtt]\nusername = ""',
        "line 5: mqtt.username: is empty (leave the key out, or give it a value)",
    ),
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
        "line 17: line[0].starter[0].watchdog_s: pump-1: 0.5 s is missed by ",
    ),
    # shapes
    (
        "[[operator]]",
        "[operator]",
        "line 24: operator: is not a list of tables (write [[operator]], with two",
    ),
    (
        "[[operator]]\n",
        '[[line]]\nname = "b"\nport = "/b"\nbaud = 9600\nframing = "8N2"\n[[operator]]\n',
        "line 24: line[1].starter: is missing (at least one [[line.starter]]",
    ),
    ("[mqtt]\n", "[mqqt]\n", "line 4: mqqt: unknown key (did you mean mqtt?)"),
    ("[mqtt]\n", "[mqqt]\n", "mqtt: is missing (a table [mqtt] is needed)"),
]


def problems(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "site.toml", check=check_watchdogs)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(("old", "new", "problem"), MISTAKES)
def test_a_mistake_is_reported_with_its_line_its_key_and_the_hint(old: str, new: str, problem: str) -> None:
    reported = problems(changed((old, new)))

    assert any(text.startswith(problem) for text in reported), reported


@pytest.mark.parametrize(("old", "new", "problem"), MISTAKES)
def test_no_mistake_draws_more_than_one_other_after_it(old: str, new: str, problem: str) -> None:
    assert len(problems(changed((old, new)))) <= 2
