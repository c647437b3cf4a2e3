"""`[metrics]`: what is taken, what each mistake says, and its token."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.errors import ConfigError
from tests.config.sites import SITE


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
