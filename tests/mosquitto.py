"""A real Mosquitto on loopback, and its clients, for tests; the broker that most plants run."""

from __future__ import annotations

import getpass
import random
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 10.0


def missing_programs() -> list[str]:
    """Return which of the programs that these tests need are not installed."""
    return [name for name in ("mosquitto", "mosquitto_sub", "mosquitto_pub") if _find(name) is None]


@dataclass(frozen=True)
class Certificate:
    """A certificate for localhost that is its own authority."""

    cert: Path
    key: Path

    @classmethod
    def make(cls, folder: Path) -> Certificate:
        cert, key = folder / "broker.pem", folder / "broker.key"
        subprocess.run(
            [
                *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"),
                *("-nodes", "-days", "2", "-subj", "/CN=localhost"),
                *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
                *("-keyout", str(key), "-out", str(cert)),
            ],
            check=True,
            capture_output=True,
        )
        return cls(cert, key)

    @classmethod
    def make_expired(cls, folder: Path) -> Certificate:
        """Make one that expired a day ago."""
        made = cls.make(folder)
        old = cls(folder / "old.pem", made.key.rename(folder / "old.key"))
        sign = ("openssl", "x509", "-in", made.cert, "-signkey", old.key, "-days", "-1", "-out", old.cert)
        subprocess.run(sign, check=True, capture_output=True)
        return old


class MosquittoBroker:
    """One broker with a configuration of its own; it keeps its port over restarts.

    `users` maps names to passwords (without any, everybody may connect), `acl` is the text of an ACL file,
    `options` are further lines of mosquitto.conf. With `is_persistent` sessions and retained messages
    outlive a stop, though not a kill.
    """

    def __init__(
        self,
        folder: Path,
        *,
        users: Mapping[str, str] | None = None,
        acl: str | None = None,
        tls: Certificate | None = None,
        is_persistent: bool = False,
        options: Sequence[str] = (),
    ) -> None:
        self.host = "127.0.0.1"
        self.port = free_port()
        self.tls = tls
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        folder.mkdir(parents=True, exist_ok=True)
        # As root Mosquitto would become another user, who may not read this folder.
        lines = [f"listener {self.port} {self.host}", f"user {getpass.getuser()}"]
        if tls is not None:
            lines += [f"certfile {tls.cert}", f"keyfile {tls.key}"]
        if users:
            lines += ["allow_anonymous false", f"password_file {self._write_passwords(users)}"]
        else:
            lines += ["allow_anonymous true"]
        if acl is not None:
            (folder / "acl").write_text(acl, "utf-8")
            lines += [f"acl_file {folder / 'acl'}"]
        if is_persistent:
            lines += ["persistence true", f"persistence_location {folder}/"]
        self._config = folder / "mosquitto.conf"
        self._config.write_text("\n".join([*lines, *options, ""]), "utf-8")

    @property
    def url(self) -> str:
        scheme = "mqtt" if self.tls is None else "mqtts"
        return f"{scheme}://{self.host}:{self.port}"

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        log = (self._folder / "mosquitto.log").open("ab")
        with log:
            self._process = subprocess.Popen(
                [str(_find("mosquitto")), "-v", "-c", str(self._config)], stdout=log, stderr=subprocess.STDOUT
            )
        deadline_s = time.monotonic() + PATIENCE_S
        while not self._is_listening():
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(f"mosquitto does not start:\n{self.log()}")
            time.sleep(0.01)

    def stop(self) -> None:
        """End in order: persistent things are written to disk."""
        self._end(signal.SIGTERM)

    def kill(self) -> None:
        """End as a power failure would."""
        self._end(signal.SIGKILL)

    def restart(self) -> None:
        self.stop()
        self.start()

    def log(self) -> str:
        path = self._folder / "mosquitto.log"
        return path.read_text("utf-8", "replace") if path.exists() else ""

    def stand_still(self) -> None:
        """Let it do nothing more, its connections open, until `go_on`."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def publish(
        self,
        topic: str,
        payload: str,
        *options: str,
        user: tuple[str, str] | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Publish with mosquitto_pub, QoS 1; `options` are further arguments."""
        command = [str(_find("mosquitto_pub")), "-h", self.host, "-p", str(self.port), "-V", "mqttv5"]
        if self.tls is not None:
            command += ["--cafile", str(self.tls.cert)]
        if user is not None:
            command += ["-u", user[0], "-P", user[1]]
        command += ["-q", "1", "-t", topic, *(["-m", payload] if payload else ["-n"]), *options]
        subprocess.run(command, check=True, capture_output=True, timeout=patience_s)

    def _write_passwords(self, users: Mapping[str, str]) -> Path:
        path = self._folder / "passwords"
        path.touch(mode=0o600)
        path.write_text("".join(f"{name}:{password}\n" for name, password in users.items()), "utf-8")
        subprocess.run([str(_find("mosquitto_passwd")), "-U", str(path)], check=True, capture_output=True)
        return path

    def _is_listening(self) -> bool:
        try:
            with socket.create_connection((self.host, self.port), timeout=1.0):
                return True
        except OSError:
            return False

    def _end(self, how: signal.Signals) -> None:
        if self._process is not None:
            self._process.send_signal(how)
            self._process.wait(PATIENCE_S)
            self._process = None


def free_port() -> int:
    """Return a TCP port of loopback that was unused a moment ago.

    It is none of those that the system gives to connections: one might have it while a server is away.
    """
    of_connections = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text("ascii").split()[0])
    for _ in range(100):
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", random.SystemRandom().randrange(10_000, max(of_connections, 20_000))))
            return int(probe.getsockname()[1])
    raise OSError("no port of loopback is free")


def _find(program: str) -> str | None:
    return shutil.which(program, path="/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin")


StartMosquitto = Callable[..., MosquittoBroker]
