"""A broker that stands where deploy/INSTALL.md puts it, in a folder in place of `/`, without root."""

from __future__ import annotations

import getpass
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from tests.mosquitto import PATIENCE_S, _find, free_port

TOP = Path(__file__).parents[3]
INSTALL = TOP / "deploy" / "INSTALL.md"
BROKER_PAGE = TOP / "docs" / "broker.md"
WITHIN_S = 60.0
_OF_ROOT = ("apt-get ", "systemctl ")  # what the machine's packages and services are


def commands(*sections: str, page: Path = INSTALL) -> list[str]:
    """Return the lines of the shell's blocks of these sections of a page, in order."""
    text = page.read_text("utf-8")
    found = []
    for section in sections:
        _, _, rest = text.partition(f"## {section}\n")
        assert rest, section
        blocks = re.findall(r"^```(\w*)\n(.*?)^```$", rest.partition("\n## ")[0], re.DOTALL | re.MULTILINE)
        shell = (block for language, block in blocks if language in ("", "sh"))
        found += [line for block in shell for line in block.splitlines() if line.strip()]
    return found


class KitPlace:
    """A folder in which the commands' /etc and /root lie; its broker is on loopback."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.port = free_port()
        self.loopback_port = free_port()  # in place of the bridge's own, which other tests may use
        self._broker: subprocess.Popen[bytes] | None = None
        self._bridge: subprocess.Popen[bytes] | None = None
        for folder in ("etc/mosquitto/conf.d", "etc/systemd/system", "root"):
            (root / folder).mkdir(parents=True)

    @property
    def config(self) -> Path:
        return self.root / "etc/starter-gateway/site.toml"

    @property
    def kit(self) -> Path:
        return self.root / "root/broker-kit"

    def adapted(self, line: str) -> str:
        """Return a command for this place: its folders, this program, the user who runs the tests."""
        line = line.partition("  #")[0].replace("--host broker.plant", "--host localhost --host 127.0.0.1")
        line = re.sub(r"(?<=[\s'])/(etc|root)/", rf"{self.root}/\1/", line)
        line = re.sub(r" -[go] [\w-]+", "", line)
        return re.sub(r"^(/opt/starter-gateway/bin/)?starter-gateway ", f"{sys.executable} -m gateway ", line)

    def run(self, line: str) -> subprocess.CompletedProcess[str]:
        """Run a command as an ordinary shell does, and return what it printed."""
        return subprocess.run(
            self.adapted(line),
            shell=True,
            cwd=TOP,
            # The machine's own key for credentials is root's.
            env={
                **os.environ,
                "PYTHONPATH": str(TOP),
                "SYSTEMD_CREDENTIAL_SECRET": f"{self.root}/credential.secret",
            },
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            check=False,
        )

    def follow(self, line: str) -> str:
        """Do what a line says; it must succeed."""
        if line.startswith(_OF_ROOT):
            if line == "systemctl restart mosquitto":
                self.start_broker()
            if line == "systemctl enable --now starter-gateway-bridge":
                self.start_bridge()
            return ""
        done = self.run(line)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        if "/etc/starter-gateway/site.toml" in line and line.startswith("install"):
            text = self.config.read_text("utf-8")  # "and make it yours"
            self.config.write_text(text.replace("broker.plant:8883", f"localhost:{self.port}"), "utf-8")
        return done.stdout

    def start_broker(self) -> None:
        """Start Mosquitto with what was installed, as the distribution's mosquitto.conf includes it."""
        self.stop_broker()
        etc = self.root / "etc/mosquitto"
        for part in (etc / "conf.d").glob("*.conf"):
            text = part.read_text("utf-8").replace(" /etc/mosquitto/", f" {etc}/")
            text = text.replace("listener 18883 ", f"listener {self.loopback_port} ")
            part.write_text(re.sub(r"^(listener \d+)$", r"\1 127.0.0.1", text, flags=re.MULTILINE), "utf-8")
        main = etc / "mosquitto.conf"
        data = self.root / "data"
        data.mkdir(exist_ok=True)
        main.write_text(
            f"user {getpass.getuser()}\npersistence true\npersistence_location {data}/\n"
            f"include_dir {etc / 'conf.d'}\n",
            "utf-8",
        )
        self._broker = self._started("mosquitto", main)

    def start_bridge(self) -> None:
        """Start the bridge's Mosquitto with what was installed, as its unit does."""
        conf = self.root / "etc/mosquitto/starter-gateway/bridge.conf"
        text = conf.read_text("utf-8").replace(" /etc/mosquitto/", f" {self.root}/etc/mosquitto/")
        text = text.replace("/var/lib/mosquitto-bridge/", f"{self.root}/").replace("18884", str(free_port()))
        text = text.replace("127.0.0.1:18883", f"127.0.0.1:{self.loopback_port}")
        if not text.startswith("user "):
            text = f"user {getpass.getuser()}\n{text}"
        conf.write_text(text, "utf-8")
        self._bridge = self._started("bridge", conf)

    def stop_bridge(self) -> None:
        """End the bridge in order, as its unit does each hour."""
        assert self._bridge is not None
        self._bridge.terminate()
        self._bridge.wait(PATIENCE_S)
        self._bridge = None

    def stop_broker(self) -> None:
        """End both, as a power failure would."""
        for process in (self._bridge, self._broker):
            if process is not None:
                process.kill()
                process.wait(PATIENCE_S)
        self._bridge = self._broker = None

    def log(self, name: str = "mosquitto") -> str:
        path = self.root / f"{name}.log"
        return path.read_text("utf-8", "replace") if path.exists() else ""

    def _started(self, name: str, conf: Path) -> subprocess.Popen[bytes]:
        (self.root / f"{name}.log").unlink(missing_ok=True)
        with (self.root / f"{name}.log").open("ab") as log:
            command = [str(_find("mosquitto")), "-v", "-c", str(conf)]
            process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        deadline_s = time.monotonic() + PATIENCE_S
        while " running" not in self.log(name):
            if process.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(f"{name} does not start:\n{self.log(name)}")
            time.sleep(0.02)
        return process
