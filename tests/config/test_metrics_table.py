"""`[metrics]`: what is taken, what each mistake says, and its token."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.config.load import parse
from gateway.errors import ConfigError
from tests.config.sites import SITE


def problems(text: str) -> list[str]:
    try:
        parse(SITE + text, "site.toml")
    except ConfigError as error:
        return [f"{each.key}: {each.what} ({each.hint})" for each in error.problems]
    return []


@pytest.mark.parametrize(
    "text",
    [
        "[web]\n[metrics]\n",
        '[metrics]\ntextfile = "/var/lib/prometheus/node-exporter/sg.prom"\n',
        '[metrics]\ntextfile = "sg.prom"\nall_points = true\n',
        '[web]\n[metrics]\ntoken_file = "metrics.token"\n',
    ],
)
def test_what_is_right_is_taken(text: str) -> None:
    assert problems(text) == []


def test_without_the_table_there_are_no_metrics() -> None:
    assert parse(SITE, "x").metrics is None


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("[metrics]\n", "metrics: nothing serves them (add a [web] table, whose server answers /metrics"),
        ('[metrics]\ntoken_file = "t"\n', "metrics: nothing serves them"),
        ('[metrics]\ntextfile = "sg.txt"\n', "metrics.textfile: "),  # node-exporter reads no other files
        ('[metrics]\ntextfile = "/var/lib/.prom"\n', "metrics.textfile: is '/var/lib/.prom' (a file whose"),
        ("[web]\n[metrics]\nall_point = true\n", "metrics.all_point: unknown key (did you mean all_points?)"),
        ('[web]\n[metrics]\nall_points = "yes"\n', "metrics.all_points: "),
    ],
)
def test_each_mistake_says_what_where_and_the_remedy(text: str, found: str) -> None:
    assert [each for each in problems(text) if each.startswith(found)] != []


def site_in(folder: Path, mode: int = 0o600, token: str = "secret\n") -> Path:
    (folder / "metrics.token").write_text(token, "utf-8")
    (folder / "metrics.token").chmod(mode)
    path = folder / "site.toml"
    path.write_text(SITE + '[web]\n[metrics]\ntoken_file = "metrics.token"\n', "utf-8")
    return path


def test_the_token_is_the_files_first_line_and_is_never_shown(tmp_path: Path) -> None:
    path = site_in(tmp_path)

    read = Site.read(path, {})
    made = Site.of(read.config, folder=tmp_path, password=None)

    assert (read.metrics_token, made.metrics_token) == ("secret", "secret")
    assert "secret" not in repr(read)


@pytest.mark.parametrize(
    ("mode", "token", "what"),
    [
        (0o644, "secret\n", "others than its owner may use it"),
        (0o600, "", "is empty"),
    ],
)
def test_a_token_that_cannot_be_used_is_a_mistake_of_that_key(
    tmp_path: Path, mode: int, token: str, what: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        Site.read(site_in(tmp_path, mode, token), {})

    (problem,) = caught.value.problems
    assert (problem.key, problem.what) == ("metrics.token_file", what)
