"""A fresh Debian system with its own systemd, in namespaces: processes, mounts, network, control groups."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

SYSTEMS = Path(__file__).parents[2] / "build" / "debian"
UNIFIED = (
    Path("/sys/fs/cgroup/unified"),
    Path("/sys/fs/cgroup"),
)  # where control groups of version 2 may lie
BOOT = Path(__file__).parent / "boot.sh"
WITHIN_S = 60.0


def why_not(suite: str) -> str:
    """Return why no system of Debian can be started here; empty when it can."""
    if os.geteuid() != 0:
        return "not root"
    if not (SYSTEMS / f"{suite}.tar").exists():
        return f"build/debian/{suite}.tar is not there (make test-deb makes it)"
    return (
        "" if any((path / "cgroup.procs").exists() for path in UNIFIED) else "no control groups of version 2"
    )


class Container:
    """Boots on entry; nothing is left of it on exit."""

    def __init__(self, suite: str, folder: Path) -> None:
        self.root = folder / suite
        self._suite = suite
        self._outer: subprocess.Popen[bytes] | None = None
        self._init = 0
        self._started: list[subprocess.Popen[str]] = []
        (self._unified,) = [path for path in UNIFIED if (path / "cgroup.procs").exists()][:1]
        self._group = self._unified / f"starter-gateway-test-{os.getpid()}-{suite}"

    def __enter__(self) -> Container:
        self.root.mkdir(parents=True)
        archive = SYSTEMS / f"{self._suite}.tar"
        subprocess.run(
            ["tar", "--extract", "--file", archive, "--directory", self.root], check=True, timeout=WITHIN_S
        )
        (self.root / "etc/machine-id").write_text("0123456789abcdef0123456789abcdef\n")
        (self.root / "etc/dpkg/dpkg.cfg.d/tests").write_text("force-unsafe-io\n")  # quicker
        try:
            self._boot()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(
        self,
        *command: str,
        fails: bool = False,
        environ: dict[str, str] | None = None,
        stdin: str | None = None,
    ) -> str:
        """Run a command in the system and return its output, both streams; AssertionError for another end."""
        done = subprocess.run(
            [*self._entering(environ), *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            input=stdin or "",
            encoding="utf-8",
            errors="replace",
            timeout=WITHIN_S,
            check=False,
        )
        assert (done.returncode != 0) == fails, (
            f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}"
        )
        return done.stdout

    def start(self, *command: str) -> subprocess.Popen[str]:
        """Start a command in the system that goes on; its output in a pipe."""
        process = subprocess.Popen(
            [*self._entering(), *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
        )
        self._started.append(process)
        return process

    def write(self, path: str, text: str, *, mode: int = 0o644) -> None:
        """Write a file in the system."""
        inside = self.root / path.lstrip("/")
        inside.parent.mkdir(parents=True, exist_ok=True)
        inside.write_text(text, "utf-8")
        inside.chmod(mode)

    def close(self) -> None:
        """End every process of the system and remove its files."""
        if self._init:
            with suppress(ProcessLookupError):
                os.kill(self._init, signal.SIGKILL)  # all others of its namespace end with it
        for process in self._started:
            with suppress(ProcessLookupError):
                process.kill()
            process.communicate(timeout=WITHIN_S)
        if self._outer is not None:
            with suppress(ProcessLookupError):
                self._outer.kill()
            self._outer.wait(WITHIN_S)
        self._remove_group()
        shutil.rmtree(self.root, ignore_errors=True)

    def _boot(self) -> None:
        self._group.mkdir()
        self._outer = subprocess.Popen(
            [BOOT, self.root, self._group],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        give_up_s = time.monotonic() + WITHIN_S
        state = ""
        while state not in ("running", "degraded"):
            assert time.monotonic() < give_up_s, f"{self._suite} does not boot: {state}"
            time.sleep(0.1)
            children = Path(f"/proc/{self._outer.pid}/task/{self._outer.pid}/children").read_text().split()
            if children:
                self._init = int(children[0])
                command = [*self._entering(), "systemctl", "is-system-running"]
                state = subprocess.run(
                    command, capture_output=True, text=True, check=False, timeout=WITHIN_S
                ).stdout.strip()

    def _entering(self, environ: dict[str, str] | None = None) -> list[str]:
        plain = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root"}
        words = [f"{key}={value}" for key, value in {**plain, "LC_ALL": "C.UTF-8", **(environ or {})}.items()]
        into = f"nsenter --target={self._init} --all --root --wd=/ env --ignore-environment"
        return [*into.split(), *words]

    def _remove_group(self) -> None:
        give_up_s = time.monotonic() + 5.0
        while self._group.exists() and time.monotonic() < give_up_s:
            for path in sorted(self._group.rglob("*"), reverse=True):
                if path.is_dir():
                    with suppress(OSError):
                        path.rmdir()
            with suppress(OSError):
                self._group.rmdir()
            time.sleep(0.05)
