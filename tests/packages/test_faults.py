"""What goes wrong around a package: dpkg killed, a full disk, an administrator's own unit or policy."""

from __future__ import annotations

import time
from functools import partial

import pytest

from tests.packages.built import Packages, only_the_version, without_spanish
from tests.packages.container import Container
from tests.packages.site import ENCRYPTED, LOGIN, PATIENCE_S, TOP, InstalledSite, Upgrades, files_of

MOMENTS = {  # at which dpkg is killed, as a shell waits for them
    "it unpacks": f"[ -e {TOP}/activate.dpkg-new ]",
    "it has unpacked more": f"[ -e {TOP}/site-packages/paho/__init__.py.dpkg-new ]",
    "it compiles": f"pgrep --full '[c]ompileall -q {TOP}' > /dev/null",
    "it checks": "pgrep --full '[c]heck --upgrade' > /dev/null",
}
NEVER = "this moment never came"
OWN_FILE = "/etc/starter-gateway/plant 1.toml"
OWN_START = f'[Service]\nExecStart=\nExecStart=/usr/bin/starter-gateway run -v "{OWN_FILE}"\n'


pytestmark = pytest.mark.timeout(600)  # many installations, each of which compiles the whole program


def test_a_killed_upgrade_and_one_on_a_full_disk_leave_the_version_before_in_force(
    distribution: str, system: Container, packages: Packages
) -> None:
    site = InstalledSite(system, packages, distribution)
    site.install("0.3.0")
    demo_shows_its_motors(site)
    with site.simulated() as tap:
        runs_with_an_encrypted_credential(site)
        upgrades = Upgrades(site, tap, running="0.3.0")
        a_killed_upgrade_leaves_the_old_version_in_force(site, upgrades)
        a_full_disk_refuses_an_upgrade(site, upgrades)


def test_an_upgrade_looks_at_the_unit_and_at_the_machine_as_they_are_and_purging_leaves_nothing(
    distribution: str, system: Container, packages: Packages
) -> None:
    before = files_of(system)
    site = InstalledSite(system, packages, distribution)
    site.install("0.3.2", only_the_version)
    with site.simulated() as tap:
        runs_with_an_encrypted_credential(site)
        upgrades = Upgrades(site, tap, running="0.3.2")
        a_configuration_elsewhere_is_checked_too(site, upgrades)
        a_policy_against_restarts_is_said(site, upgrades)
        a_version_before_that_cannot_start_again_is_said(site)
    half_a_package_is_removed(site)
    an_installation_says_what_its_configuration_is_worth(site)
    purging_leaves_nothing(site, before)


def demo_shows_its_motors(site: InstalledSite) -> None:
    """As an ordinary user; then `send`, as the demo prints it."""
    site.system.run("useradd", "--create-home", "guest")
    demo = site.system.start("runuser", "-u", "guest", "--", "starter-gateway", "demo")
    give_up_s = time.monotonic() + PATIENCE_S
    while "fan ready for remote control" not in (line := demo.stdout.readline() if demo.stdout else ""):
        assert line, "the demo has ended"
        assert time.monotonic() < give_up_s, line
    send = "starter-gateway send /tmp/starter-gateway-demo-*/demo.toml fan start --client demo"
    assert "confirmed" in site.shell(send)
    site.until_served("http://127.0.0.1:8480/")
    site.shell("pkill -TERM -u guest -f 'starter-gateway demo'")
    demo.communicate(timeout=30.0)
    assert "starter-gateway-demo" not in site.system.run("ls", "/tmp")
    site.system.run("userdel", "--remove", "guest")


def runs_with_an_encrypted_credential(site: InstalledSite) -> None:
    path = "/etc/starter-gateway/mqtt.password.cred"
    site.system.run("systemd-creds", "encrypt", "--name=mqtt.password", "-", path, stdin=f"{LOGIN[1]}\n")
    site.run(ENCRYPTED)

    assert LOGIN[1] not in (site.system.root / path.lstrip("/")).read_text("utf-8")


def a_killed_upgrade_leaves_the_old_version_in_force(site: InstalledSite, upgrades: Upgrades) -> None:
    package = site.put("0.3.1", only_the_version)
    for moment in MOMENTS:
        said = killed_install(site, package, moment)
        assert NEVER not in said, f"{moment}\n{said}"
        assert "restarting" not in said, f"{moment}\n{said}"
        assert site.version_that_started_last() == "0.3.0", f"{moment}\n{said}"
        assert "0.3.0" in site.system.run("starter-gateway", "--version")
        upgrades.comes_up_again()
    # apt wants `dpkg --configure -a` before
    upgrades.takes_effect("0.3.1", partial(site.system.run, "dpkg", "--install", package))

    assert site.system.run("dpkg", "--verify", "starter-gateway") == ""


def killed_install(site: InstalledSite, package: str, moment: str) -> str:
    """Kill dpkg and what it has started at a moment; return what it had said.

    It is nicer than who watches it, and so never passes a moment unseen.
    """
    clean = f"rm -f /root/said; find {TOP} -name '*.dpkg-new' -delete"
    begun = f"setsid nice dpkg --install {package} > /root/said 2>&1 & it=$!"
    waits = f"until {MOMENTS[moment]}; do kill -0 $it || {{ echo {NEVER}; break; }}; sleep 0.02; done"
    ended = "wait $it; while /bin/kill -0 -- -$it 2> /dev/null; do sleep 0.02; done"
    return site.shell(f"{clean}; {begun}; {waits}; /bin/kill -KILL -- -$it; {ended}; cat /root/said")


def a_full_disk_refuses_an_upgrade(site: InstalledSite, upgrades: Upgrades) -> None:
    package = site.put("0.3.2", only_the_version)
    site.shell(
        f"mkdir /root/small; mount -t tmpfs -o size=100m tmpfs /root/small; cp -a {TOP}/. /root/small/"
    )
    site.shell(f"mount --bind /root/small {TOP}; dd if=/dev/zero of={TOP}/fill bs=64k")
    site.shell(f"truncate --size=-5M {TOP}/fill")

    assert "No space left on device" in site.shell(f"dpkg --install {package}")
    upgrades.stays(installed="0.3.1")
    upgrades.comes_up_again()
    site.system.run("rm", f"{TOP}/fill")
    upgrades.takes_effect("0.3.2", partial(site.install, "0.3.2", only_the_version))


def a_configuration_elsewhere_is_checked_too(site: InstalledSite, upgrades: Upgrades) -> None:
    site.shell(f"mv /etc/starter-gateway/site.toml '{OWN_FILE}'")
    site.drop_in("own", OWN_START)
    upgrades.comes_up_again()
    upgrades.is_left_aside("0.3.3", without_spanish, because="language")
    before = site.pid()
    site.shell(f"mv '{OWN_FILE}' /etc/starter-gateway/gone")
    assert "No such file" in site.system.run(f"{TOP}/activate", fails=True)
    site.drop_in("own", "[Service]\nExecStart=\nExecStart=/bin/sh -c 'exec starter-gateway run $FILE'\n")
    assert "is not known" in site.system.run(f"{TOP}/activate", fails=True)
    assert site.pid() == before
    site.shell("mv /etc/starter-gateway/gone /etc/starter-gateway/site.toml")
    site.shell("rm /etc/systemd/system/starter-gateway.service.d/own.conf; systemctl daemon-reload")
    upgrades.comes_up_again()
    upgrades.stays(installed="0.3.3")


def a_policy_against_restarts_is_said(site: InstalledSite, upgrades: Upgrades) -> None:
    site.system.write("/usr/sbin/policy-rc.d", "#!/bin/sh\nexit 101\n", mode=0o755)
    upgrades.is_left_aside("0.3.4", only_the_version, because="policy-rc.d")
    upgrades.takes_effect("0.3.4", partial(site.system.run, f"{TOP}/activate", "--restart"))
    site.system.run("rm", "/usr/sbin/policy-rc.d")


def a_version_before_that_cannot_start_again_is_said(site: InstalledSite) -> None:
    """As after the distribution's own upgrade, when Python has become another one."""
    assert "CANNOT BE STARTED AGAIN" not in site.install("0.3.3", without_spanish)
    site.shell(f"rm {TOP}/previous/pydantic_core/*.so")
    assert "CANNOT BE STARTED AGAIN" in site.system.run(f"{TOP}/activate", fails=True)


def half_a_package_is_removed(site: InstalledSite) -> None:
    """Dpkg calls no `prerm` then."""
    package = site.put("0.3.1", only_the_version)
    killed_install(site, package, "it unpacks")
    assert "half-installed" in site.system.run("dpkg", "--status", "starter-gateway")
    site.shell("dpkg --remove --force-remove-reinstreq starter-gateway")

    assert site.pid() == 0
    assert not (site.system.root / TOP.lstrip("/")).exists()


def an_installation_says_what_its_configuration_is_worth(site: InstalledSite) -> None:
    said = site.install("0.3.3", without_spanish)

    assert "THIS VERSION REFUSES THE PRESENT CONFIGURATION" in said
    assert "enabled, but does not run" in said
    assert "REFUSES" not in site.install("0.3.4", only_the_version)
    site.system.run("systemctl", "start", "starter-gateway")


def purging_leaves_nothing(site: InstalledSite, before: set[str]) -> None:
    """A masked unit that has failed, too."""
    assert (site.system.root / "var/lib/starter-gateway").exists()
    site.shell("kill -KILL $(systemctl show --property=MainPID --value starter-gateway)")
    site.system.run("systemctl", "mask", "starter-gateway")
    site.system.run("apt-get", "purge", "--yes", "starter-gateway")

    left = {path for path in files_of(site.system) - before if not path.endswith(("-", ".pyc"))}
    assert left == set()
    assert "starter" not in site.system.run("systemctl", "list-units", "--all")
    assert "starter-gateway" not in site.shell("getent passwd; getent group; ls /run /run/credentials")
