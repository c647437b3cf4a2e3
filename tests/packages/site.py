"""An installation in a fresh system of Debian, with simulated starters and a tap on their line."""

from __future__ import annotations

import re
import sqlite3
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from tests.packages.built import Packages
from tests.packages.container import Container
from tests.packages.line_tap import LineTap
from tests.rig.sites import ALICE, line, starter, table

SYSTEMS = {"deb12": "bookworm", "deb13": "trixie"}
TOP = "/usr/lib/starter-gateway"
UNIT = "/usr/lib/systemd/system/starter-gateway.service"
WATCHDOG_S = 60
PATIENCE_S = 60.0
LONGEST_GAP_S = 10.0  # far below the watchdog, which would stop the motor besides
DROP_IN = "[Service]\nDeviceAllow=char-pts rw\n"
CREDENTIAL = "LoadCredential=mqtt.password:/etc/starter-gateway/mqtt.password\n"
ENCRYPTED = "LoadCredentialEncrypted=mqtt.password:/etc/starter-gateway/mqtt.password.cred\n"
IDENTIFIED = '"firmware":"'  # before its information has this, a start is refused
LOGIN = ("plant", "secret of the plant")
BROKER = "listener 1883 127.0.0.1\nallow_anonymous false\npassword_file /etc/mosquitto/plant.passwords\n"


def site_text(port: str, *, language: str) -> str:
    """Return a configuration whose starter watches its line."""
    simulated = table("line.starter.simulated", parameters={"P313": 2, "P314": WATCHDOG_S})
    return (
        table("gateway", name="plant", state_dir="/var/lib/starter-gateway", language=language)
        + table("mqtt", url="mqtt://127.0.0.1:1883", username="plant")
        + line("hall", port=port, adapter_allowance_s=0.3)
        + starter("pump", 1, "ssw06", model="SSW-06 820A", every_s=0.2, watchdog_s=WATCHDOG_S)
        + simulated
        + ALICE
    )


class InstalledSite:
    """An installation in a system: what its administrator does and sees."""

    def __init__(self, system: Container, packages: Packages, distribution: str) -> None:
        self.system, self._packages, self._distribution = system, packages, distribution
        self.port = ""

    def install(self, version: str, change: Callable[[Path], None] | None = None, **environ: str) -> str:
        options = ("--yes", "--allow-downgrades", "--no-install-recommends")
        environ |= {"DEBIAN_FRONTEND": "noninteractive"}
        return self.system.run("apt-get", "install", *options, self.put(version, change), environ=environ)

    def simulated(self) -> LineTap:
        """Start the simulated starters; the gateway's port is the tap's."""
        self.write("/root/sim.toml", port="/run/ttySIM")
        self._simulator = self.system.start("starter-gateway", "simulate", "/root/sim.toml")
        assert self._simulator.stdout is not None
        first = self._simulator.stdout.readline()
        (pty,) = re.findall(r"-> (/dev/pts/\d+)", first) or [first]
        tap = LineTap(pty, baud=19200)
        self.port = tap.path
        return tap

    def write(
        self, path: str = "/etc/starter-gateway/site.toml", *, language: str = "es", port: str = ""
    ) -> None:
        self.system.write(path, site_text(port or self.port, language=language))

    def run(self, credential: str) -> None:
        """Run the service with a broker, and start the motor."""
        user, password = LOGIN
        self.write()
        self.system.write("/etc/mosquitto/conf.d/plant.conf", BROKER)
        self.system.run("mosquitto_passwd", "-b", "-c", "/etc/mosquitto/plant.passwords", user, password)
        self.system.run("chown", "mosquitto:", "/etc/mosquitto/plant.passwords")
        self.system.run("systemctl", "restart", "mosquitto")
        self.drop_in("site", DROP_IN + credential)
        self.system.run("systemctl", "enable", "--now", "starter-gateway")
        self.until("starter/pump/state", "ready")
        self.until("starter/pump/info", IDENTIFIED)
        words = ("/etc/starter-gateway/site.toml", "pump", "start", "--client", "alice")
        self.system.run(
            "starter-gateway", "send", *words, environ={"STARTER_GATEWAY_MQTT_PASSWORD": password}
        )
        self.until("starter/pump/state", "running")

    def drop_in(self, name: str, text: str) -> None:
        """Give the unit a drop-in, as `systemctl edit` does."""
        self.system.write(f"/etc/systemd/system/starter-gateway.service.d/{name}.conf", text)
        self.system.run("systemctl", "daemon-reload")

    def shell(self, text: str) -> str:
        """Return what a script of the administrator prints, however it ends."""
        return self.system.run("sh", "-c", f"cd /; {{ {text}\n}} || true")

    def put(self, version: str, change: Callable[[Path], None] | None = None) -> str:
        """Copy a version's package into the system; return its path there."""
        package = self._packages.package(self._distribution, version, change)
        path = f"/root/{package.name}"
        (self.system.root / path.lstrip("/")).write_bytes(package.read_bytes())
        return path

    def pid(self) -> int:
        return int(self.system.run("systemctl", "show", "--property=MainPID", "--value", "starter-gateway"))

    def version_that_started_last(self) -> str:
        """Return what the process itself has written into the audit."""
        state_dir = self.system.root / "var/lib/starter-gateway"
        text = "".join(path.read_text("utf-8") for path in sorted((state_dir / "audit").glob("*.jsonl")))
        if (state_dir / "state.sqlite").exists():  # the audit of versions from 0.3.0 on
            with closing(sqlite3.connect(state_dir / "state.sqlite")) as connection:
                text += "".join(line for (line,) in connection.execute("SELECT line FROM audit"))
        return str(re.findall(r"gateway_started.*?version ([\d.]+)", text)[-1])

    def topic(
        self, topic: str, broker: Sequence[str] = ("-h", "127.0.0.1"), login: tuple[str, str] = LOGIN
    ) -> str:
        """Return what is retained in a topic of a broker."""
        words = (*broker, "-u", login[0], "-P", login[1], "-C", "1", "-W", "30", "-t", topic)
        return self.system.run("mosquitto_sub", *words).strip()

    def until(self, topic: str, text: str) -> None:
        """Wait until what is retained in a topic of the gateway has this text."""
        self.until_seen(lambda: self.topic(f"starters/plant/{topic}"), text, topic)

    def until_started(self, version: str) -> None:
        """Wait until the audit, which is written beside the rest, says that this version started last."""
        self.until_seen(self.version_that_started_last, version, "the version that started last")

    def until_served(self, url: str) -> None:
        """Wait until a page is served."""
        script = f"import urllib.request as u; print(u.urlopen('{url}', timeout=10).status)"
        self.until_seen(lambda: self.shell(f'python3 -c "{script}"'), "200\n", url)

    def until_seen(self, look: Callable[[], str], text: str, what: str) -> None:
        """Wait until a look shows a text."""
        give_up_s = time.monotonic() + PATIENCE_S
        while text not in (seen := look()):
            assert time.monotonic() < give_up_s, f"{what} is {seen}, not {text}\n{self.journal()}"
            time.sleep(0.1)

    def journal(self) -> str:
        return self.system.run("journalctl", "-u", "starter-gateway*", "--no-pager", "-n", "60")


def assert_motor_was_left_alone(site: InstalledSite, tap: LineTap, since_s: float) -> None:
    """No write since then, every gap is short, and the motor still runs."""
    assert tap.writes_since(since_s) == []
    assert tap.longest_gap_s(1, since_s) < LONGEST_GAP_S
    site.until("starter/pump/state", "running")


@dataclass
class Upgrades:
    """What a package does to a service whose motor runs: after each step the motor was left alone."""

    site: InstalledSite
    tap: LineTap
    running: str  # the version in force
    _began_s: float = 0.0

    def takes_effect(self, version: str, act: Callable[[], object]) -> None:
        """Do something after which this version runs, and is installed."""
        self._began_s = time.monotonic()
        act()
        self.site.until("gateway/status", "online")
        self.running = version
        self.stays(installed=version)

    def is_left_aside(self, version: str, change: Callable[[Path], None], *, because: str) -> None:
        """Install a version that does not run, for a reason that is said; the process is the same."""
        before, self._began_s = self.site.pid(), time.monotonic()
        said = self.site.install(version, change)
        assert "THE NEW VERSION DOES NOT RUN" in said
        assert because in said
        assert self.site.pid() == before
        self.stays(installed=version)

    def comes_up_again(self) -> None:
        """Restart the service, as a reboot would."""
        before, self._began_s = self.site.pid(), time.monotonic()
        self.site.system.run("systemctl", "restart", "starter-gateway")
        self.site.until("gateway/status", "online")
        assert self.site.pid() not in (0, before)
        assert_motor_was_left_alone(self.site, self.tap, self._began_s)

    def stays(self, *, installed: str) -> None:
        """The version in force is the one that started last and that the command names."""
        self.site.until_started(self.running)
        assert self.running in self.site.system.run("starter-gateway", "--version")
        assert installed in self.site.system.run(f"{TOP}/starter-gateway", "--version")
        assert_motor_was_left_alone(self.site, self.tap, self._began_s)


def files_of(system: Container) -> set[str]:
    """Return every file but what programs log and cache."""
    changing = (
        "var/log var/cache var/lib/dpkg var/lib/apt var/lib/systemd var/lib/mosquitto etc/mosquitto root"
    )
    find = ["find", ".", "-xdev", "-printf", "%P\\n"]
    found = subprocess.run(find, cwd=system.root, capture_output=True, text=True, check=True)
    return {path for path in found.stdout.splitlines() if not path.startswith(tuple(changing.split()))}
