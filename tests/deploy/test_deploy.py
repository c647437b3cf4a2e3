"""What we ship for an installation fits together and is accepted by the programs that read it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.line.capacity.outage import Restart

TOP = Path(__file__).parents[2]
DEPLOY = TOP / "deploy"
SERVICE = DEPLOY / "starter-gateway.service"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here")
@pytest.mark.parametrize("words", ["verify", "security --offline=true --threshold=12"])
def test_systemd_finds_the_unit_right_and_little_exposed(words: str) -> None:
    command = ["systemd-analyze", *words.split(), SERVICE]

    done = subprocess.run(command, capture_output=True, text=True, check=False)

    complaints = [
        each for each in (done.stdout + done.stderr).splitlines() if "is not executable" not in each
    ]  # since it is not installed
    assert complaints == [] if words == "verify" else done.returncode == 0, complaints


def test_the_service_may_use_the_serial_ports_of_all_common_boards_and_adapters() -> None:
    allowed = set(re.findall(r"^DeviceAllow=char-(\w+) rw$", SERVICE.read_text("utf-8"), re.MULTILINE))

    common = "ttyUSB ttyACM ttyS ttyAMA ttymxc ttySC ttyAML ttyXRUSB ttyMXUSB ttyO"
    assert set(common.split()) <= allowed
    assert "pts" not in allowed


def test_the_adapters_that_the_example_names_are_named_by_the_udev_rules() -> None:
    rules = (DEPLOY / "udev" / "99-starter-gateway.rules").read_text("utf-8")
    ports = re.findall(r'port = "/dev/(rs485-[\w-]+)"', (TOP / "config" / "plant.toml").read_text("utf-8"))

    assert ports
    assert [port for port in ports if f'SYMLINK+="{port}"' not in rules] == []


def test_the_scripts_that_get_programs_are_right_shell_scripts() -> None:
    for script in (*DEPLOY.glob("*.sh"), TOP / ".ci" / "run"):
        subprocess.run(["bash", "-n", script], check=True)


def test_the_service_is_restarted_in_the_assumed_times_but_not_with_a_wrong_configuration() -> None:
    times = Restart()

    assert set(SERVICE.read_text("utf-8").splitlines()) >= {
        "Restart=always",
        "RestartPreventExitStatus=78",
        f"RestartSec={times.restart_s * 1000:.0f}ms",
        f"WatchdogSec={times.watchdog_s:.0f}s",
        f"TimeoutAbortSec={times.abort_s:.0f}s",
    }
