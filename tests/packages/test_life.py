"""A package's life in fresh systems of Debian: install, run, upgrade, refuse, go back, purge."""

from __future__ import annotations

import time

from tests.packages.built import Packages, only_the_version, slow_to_restart, without_spanish
from tests.packages.container import Container
from tests.packages.line_tap import LineTap
from tests.packages.site import (
    CREDENTIAL,
    LOGIN,
    TOP,
    UNIT,
    InstalledSite,
    assert_motor_was_left_alone,
    assert_version,
    files_of,
)


def test_a_package_is_installed_runs_is_upgraded_refused_taken_back_and_purged(
    distribution: str, system: Container, packages: Packages
) -> None:
    before = files_of(system)
    site = InstalledSite(system, packages, distribution)
    installs_without_starting_anything(site)
    with site.simulated() as tap:
        runs_and_starts_a_motor(site, tap)
        an_upgrade_restarts_in_time(site, tap)
        a_refused_upgrade_leaves_the_old_one_running(site, tap)
        the_operator_corrects_the_configuration(site, tap)
        a_restart_that_would_trip_a_watchdog_waits_for_a_word(site, tap)
        the_previous_version_comes_back(site, tap)
        assert tap.unknown == []
    files_are_as_packed(site)
    purging_leaves_nothing(site, before)


def installs_without_starting_anything(site: InstalledSite) -> None:
    site.install("0.3.0")

    assert site.pid() == 0
    assert "0.3.0" in site.system.run("starter-gateway", "--version")
    assert "dialout" in site.system.run("id", "starter-gateway")
    assert list((site.system.root / "etc/starter-gateway").iterdir()) == []
    assert site.system.run("systemd-analyze", "verify", UNIT) == ""
    site.system.run("systemd-analyze", "security", "--offline=true", "--threshold=12", UNIT)


def runs_and_starts_a_motor(site: InstalledSite, tap: LineTap) -> None:
    site.system.write(
        "/etc/starter-gateway/mqtt.password", LOGIN[1], mode=0o600
    )  # root's: systemd hands it on
    site.run(CREDENTIAL)

    assert tap.writes_since(0.0) != []  # the tap sees writes


def an_upgrade_restarts_in_time(site: InstalledSite, tap: LineTap) -> None:
    before, began_s = site.pid(), time.monotonic()
    said = site.install("0.3.1", only_the_version)
    site.until("gateway/status", "online")

    assert site.pid() not in (0, before)
    assert "restarting" in said
    assert_version(site, running="0.3.1", installed="0.3.1")
    assert_motor_was_left_alone(site, tap, began_s)
    print(f"{tap.longest_gap_s(1, began_s):.2f} s without a request around the restart")


def a_refused_upgrade_leaves_the_old_one_running(site: InstalledSite, tap: LineTap) -> None:
    before, began_s = site.pid(), time.monotonic()
    said = site.install("0.3.2", without_spanish)

    assert site.pid() == before
    assert "THE NEW VERSION DOES NOT RUN" in said
    assert "language" in said
    assert_version(site, running="0.3.1", installed="0.3.2")
    assert_motor_was_left_alone(site, tap, began_s)
    old_process_finds_its_modules(site)
    site.system.run("systemctl", "restart", "starter-gateway")  # as after a reboot
    site.until("gateway/status", "online")
    assert_version(site, running="0.3.1", installed="0.3.2")
    assert_motor_was_left_alone(site, tap, began_s)


def old_process_finds_its_modules(site: InstalledSite) -> None:
    """A reload that switches the page on imports its modules: they must be those of the process's version."""
    path = site.system.root / "etc/starter-gateway/site.toml"
    text = path.read_text("utf-8")
    path.write_text(text + '\n[web]\nlisten = "127.0.0.1:8480"\n', "utf-8")
    site.system.run("systemctl", "reload", "starter-gateway")
    site.until_served("http://127.0.0.1:8480/health")
    path.write_text(text, "utf-8")
    site.system.run("systemctl", "reload", "starter-gateway")


def the_operator_corrects_the_configuration(site: InstalledSite, tap: LineTap) -> None:
    began_s = time.monotonic()
    site.write(language="pt")
    site.system.run(f"{TOP}/activate")
    site.until("gateway/status", "online")

    assert_version(site, running="0.3.2", installed="0.3.2")
    assert_motor_was_left_alone(site, tap, began_s)


def a_restart_that_would_trip_a_watchdog_waits_for_a_word(site: InstalledSite, tap: LineTap) -> None:
    before, began_s = site.pid(), time.monotonic()
    said = site.install("0.3.3", slow_to_restart)

    assert site.pid() == before
    assert "a restart takes longer than the watchdog of a starter" in said
    assert_version(site, running="0.3.2", installed="0.3.3")
    assert_motor_was_left_alone(site, tap, began_s)
    site.install("0.3.4", slow_to_restart, STARTER_GATEWAY_RESTART="1")
    site.until("gateway/status", "online")
    assert_version(site, running="0.3.4", installed="0.3.4")
    assert_motor_was_left_alone(site, tap, began_s)


def the_previous_version_comes_back(site: InstalledSite, tap: LineTap) -> None:
    began_s = time.monotonic()
    site.install("0.3.0")
    site.until("gateway/status", "online")

    assert_version(site, running="0.3.0", installed="0.3.0")
    assert_motor_was_left_alone(site, tap, began_s)


def files_are_as_packed(site: InstalledSite) -> None:
    assert site.system.run("dpkg", "--verify", "starter-gateway") == ""


def purging_leaves_nothing(site: InstalledSite, before: set[str]) -> None:
    assert (site.system.root / "var/lib/starter-gateway").exists()
    site.system.run(
        "apt-get", "purge", "--yes", "starter-gateway", environ={"DEBIAN_FRONTEND": "noninteractive"}
    )

    assert site.pid() == 0
    assert "no such user" in site.system.run("id", "starter-gateway", fails=True)
    left = {path for path in files_of(site.system) - before if not path.endswith(("-", ".pyc"))}
    assert left == set()
