"""`[web]`: what may be opened to whom, and what each mistake says."""

from __future__ import annotations

import pytest

from gateway.config.load import parse
from gateway.config.values import split_listen
from gateway.errors import ConfigError
from gateway.system.password_hash import password_line
from tests.config.sites import SITE

LINE = password_line("correct horse", salt=b"0123456789abcdef")
USER = f'[[web.user]]\nname = "anna"\npassword = "{LINE}"\noperator = "alice"\n'


def problems(text: str) -> list[str]:
    try:
        parse(SITE + text, "site.toml")
    except ConfigError as error:
        return [f"{each.key}: {each.what} ({each.hint})" for each in error.problems]
    return []


@pytest.mark.parametrize(
    "text",
    [
        "[web]\n",
        '[web]\nlisten = "[::1]:8480"\n',
        '[web]\nlisten = "127.0.0.5:80"\nhosts = ["mcc1.plant", "mcc1"]\nbase_path = "/plant/mcc1"\n',
        f'[web]\nlisten = "0.0.0.0:8480"\nallow_plaintext = true\n{USER}',
        f'[web]\nlisten = "[::]:8480"\ncert_file = "c.pem"\nkey_file = "k.pem"\n{USER}',
        '[web]\ntrusted_proxies = ["10.0.0.0/8", "::1"]\n',
    ],
)
def test_what_is_right_is_taken(text: str) -> None:
    assert problems(text) == []


def test_without_the_table_there_is_no_page_and_with_an_empty_one_it_is_on_loopback() -> None:
    assert parse(SITE, "x").web is None
    web = parse(SITE + "[web]\n", "x").web
    assert web is not None
    assert split_listen(web.listen) == ("127.0.0.1", 8480)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            f'[web]\nlisten = "0.0.0.0:8480"\n{USER}',
            "web.listen: would send passwords and commands unencrypted",
        ),
        ('[web]\nlisten = "192.0.2.1:8480"\nallow_plaintext = true\n', "without any login"),
        ('[web]\nlisten = "localhost:8480"\n', "web.listen: 'localhost:8480' is no address with a port"),
        ('[web]\nlisten = "8480"\n', "is no address with a port"),
        ('[web]\nlisten = "::1:8480"\n', "is no address with a port"),
        ('[web]\nlisten = "127.0.0.1:99999"\n', "is no address with a port"),
        ('[web]\ncert_file = "c.pem"\n', "web.cert_file: needs key_file beside it"),
        ('[web]\ntrusted_proxies = ["proxy"]\n', "web.trusted_proxies[0]: 'proxy' is no address"),
        ('[web]\nhosts = ["http://x"]\n', "web.hosts[0]: is 'http://x' (a name or address without port"),
        ('[web]\nbase_path = "mcc1"\n', "web.base_path: is 'mcc1' (a path such as /mcc1)"),
        ('[web]\nlissten = "x"\n', "web.lissten: unknown key (did you mean listen?)"),
        (
            f"[web]\n{USER.replace('alice', 'alise')}",
            "web.user[0].operator: 'alise' is no [[operator]]'s client (did you mean alice?)",
        ),
        (
            "[web]\n" + USER.replace('operator = "alice"', ""),
            "web.user[0].operator: is missing (name the client of an [[operator]]: the login has its rights)",
        ),
        ('[web]\nbase_path = "/a/../b"\n', "web.base_path: '/a/../b' has a level . or .. (a path such as"),
        ('[web]\nbase_path = "/./"\n', "web.base_path: '/./' has a level . or .."),
        (f"[web]\n{USER}{USER}", "web.user[1].name: 'anna' is also web.user[0].name"),
        ('[web.user]\nname = "x"\n', "web.user: is not a list of tables (write [[web.user]]"),
    ],
)
def test_each_mistake_says_what_is_wrong_and_how_it_is_corrected(text: str, found: str) -> None:
    assert any(found in each for each in problems(text)), problems(text)


def test_a_password_in_place_of_its_line_is_not_shown() -> None:
    found = problems("[web]\n" + USER.replace(LINE, "hunter2hunter2"))

    assert found == [
        "web.user[0].password: is no password line (paste the line that starter-gateway web-password prints)"
    ]
