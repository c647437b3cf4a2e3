"""Sets of parameters as files: compared, saved, and what cannot be done with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.small_site import small_site

SAVED = '[starter]\nname = "p"\nfamily = "{family}"\n[parameters]\nP314 = {seconds}\n'
CONFIG = small_site(("pump", "ssw07"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "site.toml").write_text(CONFIG, "utf-8")
    for name, family, seconds in (("a", "ssw07", 3), ("b", "ssw07", 5), ("c", "ssw06", 3)):
        text = SAVED.format(family=family, seconds=seconds)
        (tmp_path / f"{name}.toml").write_text(text, "utf-8")
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_two_files_are_compared_and_a_difference_is_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["parameters", "diff", "a.toml", "b.toml"]) == 1
    assert capsys.readouterr().out == "P314 : 3 -> 5\n"

    assert main(["parameters", "diff", "a.toml", "a.toml"]) == 0
    assert "no setting differs" in capsys.readouterr().out
    assert main(["parameters", "diff", "a.toml", "a.toml", "--all"]) == 0


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["diff", "a.toml", "c.toml"], "not comparable"),
        (["diff", "a.toml", "none.toml"], "none.toml"),
        (["diff", "a.toml", "site.toml:fan"], "no starter 'fan' (one of pump)"),
        (["save", "site.toml", "pump", "a.toml"], "exists already"),
        (["save", "site.toml", "pump", "nowhere/a.toml"], "no folder"),
        (["restore", "site.toml", "pump", "c.toml"], "of family ssw06, pump of ssw07"),
        (["restore", "site.toml", "pump", "site.toml"], "[starter]"),
    ],
)
def test_what_cannot_be_done_is_a_wrong_use_in_one_line(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["parameters", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert named in line


@pytest.mark.usefixtures("folder")
def test_a_set_is_compared_with_what_the_manual_says_of_a_new_starter(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = '[starter]\nname = "p"\nfamily = "{}"\n[parameters]\n'
    text = head + "P220 = {{ raw = [{}] }}\nP314 = {{ raw = [{}] }}\n"
    (folder / "new.toml").write_text(text.format("ssw07", 3, 0), "utf-8")
    (folder / "used.toml").write_text(text.format("ssw06", 6, 0), "utf-8")

    assert main(["parameters", "diff", "new.toml", "--factory"]) == 0
    assert capsys.readouterr().out == "as delivered: P220, P314\n"
    assert main(["parameters", "diff", "used.toml", "--factory"]) == 1
    first, last = capsys.readouterr().out.splitlines()
    assert first.startswith("P220 ")
    assert ": 2 (" in first
    assert "-> " in first
    assert last == "as delivered: P314"


@pytest.mark.parametrize(
    ("options", "reported"),
    [(["a.toml"], "name a second set"), (["a.toml", "b.toml", "--factory"], "takes the place of b.toml")],
)
@pytest.mark.usefixtures("folder")
def test_a_set_is_compared_with_one_other(
    options: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["parameters", "diff", *options]) == 2
    assert reported in capsys.readouterr().err
