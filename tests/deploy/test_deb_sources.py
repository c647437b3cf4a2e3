"""What the Debian package is made from."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from deploy.deb.build import packaged_unit
from deploy.deb.changelog import debian_changelog
from deploy.deb.targets import DISTRIBUTIONS, package_version

TOP = Path(__file__).parents[2]
SOURCES = TOP / "deploy" / "deb"
UNIT = (TOP / "deploy" / "starter-gateway.service").read_text("utf-8")


def test_the_packages_unit_is_the_shipped_one_with_another_path() -> None:
    shipped, packaged = (text.splitlines() for text in (UNIT, packaged_unit(UNIT)))

    start = shipped.index("[Unit]")
    pairs = zip(shipped[start:], packaged[packaged.index("[Unit]") :], strict=True)
    assert [new for old, new in pairs if old != new] == [
        "ExecStart=/usr/bin/starter-gateway run /etc/starter-gateway/site.toml"
    ]


def test_a_later_distribution_has_the_later_version() -> None:
    versions = [package_version("0.3.0", each) for each in DISTRIBUTIONS.values()]

    assert versions == ["0.3.0-1~deb12u1", "0.3.0-1~deb13u1"]


def test_the_changelog_has_an_entry_for_each_release_in_debians_form() -> None:
    text = debian_changelog(TOP, DISTRIBUTIONS["deb12"])

    released = re.findall(r"^## \[([\d.]+)\]", (TOP / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    heads = re.findall(
        r"^starter-gateway \(([\d.]+)-1~deb12u1\) bookworm; urgency=medium$", text, re.MULTILINE
    )
    assert heads == released
    assert len(re.findall(r"^ -- .+ <.+>  \w{3}, \d\d \w{3} \d{4} 12:00:00 \+0000$", text, re.M)) == len(
        heads
    )


@pytest.mark.parametrize("name", ["activate", "preinst", "postinst", "prerm", "postrm"])
def test_the_scripts_are_right_for_the_plainest_shell_and_open_no_port(name: str) -> None:
    script = SOURCES / "scripts" / name

    subprocess.run(["sh", "-n", script], check=True)
    assert "/dev/" not in script.read_text("utf-8").replace("/dev/null", "")
