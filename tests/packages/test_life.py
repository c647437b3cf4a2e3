"""A package's life in fresh systems of Debian: install, run, upgrade, refuse, go back."""

from __future__ import annotations

from functools import partial

import pytest

from tests.packages.built import Packages, only_the_version, slow_to_restart, without_spanish
from tests.packages.container import Container
from tests.packages.site import CREDENTIAL, LOGIN, TOP, UNIT, InstalledSite, Upgrades

pytestmark = pytest.mark.timeout(600)  # many installations, each of which compiles the whole program


def test_a_package_is_installed_runs_is_upgraded_refused_and_taken_back(
    distribution: str, system: Container, packages: Packages
) -> None:
    site = InstalledSite(system, packages, distribution)
    installs_without_starting_anything(site)
    with site.simulated() as tap:
        system.write(
            "/etc/starter-gateway/mqtt.password", LOGIN[1], mode=0o600
        )  # root's: systemd hands it on
        site.run(CREDENTIAL)
        assert tap.writes_since(0.0) != []  # the tap sees writes
        upgrades = Upgrades(site, tap, running="0.3.0")
        upgrades.takes_effect("0.3.1", partial(site.install, "0.3.1", only_the_version))
        upgrades.is_left_aside("0.3.2", without_spanish, because="language")
        old_process_finds_its_modules(site)
        upgrades.comes_up_again()
        upgrades.stays(installed="0.3.2")
        site.write(language="pt")  # the operator corrects the configuration
        upgrades.takes_effect("0.3.2", partial(system.run, f"{TOP}/activate"))
        upgrades.is_left_aside(
            "0.3.3", slow_to_restart, because="a restart takes longer than the watchdog of a"
        )
        decided = partial(site.install, "0.3.4", slow_to_restart, STARTER_GATEWAY_RESTART="1")
        upgrades.takes_effect("0.3.4", decided)
        upgrades.takes_effect("0.3.0", partial(site.install, "0.3.0"))
        assert tap.unknown == []
    assert system.run("dpkg", "--verify", "starter-gateway") == ""


def installs_without_starting_anything(site: InstalledSite) -> None:
    site.install("0.3.0")

    assert site.pid() == 0
    assert "0.3.0" in site.system.run("starter-gateway", "--version")
    assert "dialout" in site.system.run("id", "starter-gateway")
    assert list((site.system.root / "etc/starter-gateway").iterdir()) == []
    assert site.system.run("systemd-analyze", "verify", UNIT) == ""
    site.system.run("systemd-analyze", "security", "--offline=true", "--threshold=12", UNIT)


def old_process_finds_its_modules(site: InstalledSite) -> None:
    """A reload that switches the page on imports its modules: they must be those of the process's version."""
    path = site.system.root / "etc/starter-gateway/site.toml"
    text = path.read_text("utf-8")
    path.write_text(text + '\n[web]\nlisten = "127.0.0.1:8480"\n', "utf-8")
    site.system.run("systemctl", "reload", "starter-gateway")
    site.until_served("http://127.0.0.1:8480/health")
    path.write_text(text, "utf-8")
    site.system.run("systemctl", "reload", "starter-gateway")
