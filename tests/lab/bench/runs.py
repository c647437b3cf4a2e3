"""One run: the judge, a master, and what both say afterwards; all of them processes of their own."""

from __future__ import annotations

import compileall
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType

import gateway as package
from tests.lab.bench.account import Law, SeenRequest, Submitted, between
from tests.lab.bench.judge import Spec
from tests.lab.bench.subjects import Span, Task
from tests.lab.usage import Usage, usage

END_S = 20.0  # for a process to end once it is asked to


@dataclass(frozen=True)
class Run:
    """What one run gave."""

    law: Law
    seen: list[SeenRequest]  # in the measured time
    span: Span
    first_s: float  # of all requests, on the clock that all processes share; from the start, of the gateway

    @property
    def cpu_s(self) -> float:
        """Return the master's processor time per request."""
        return self.span.cpu_s / max(len(self.seen), 1)


class Watched:
    """A judge while it serves."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.lab.bench.judge", json.dumps(asdict(spec))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.ports: tuple[str, ...] = tuple(json.loads(self._process.stdout.readline()))

    def __enter__(self) -> Watched:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self._process.returncode is None:
            self._process.kill()
            self._process.communicate()

    def seen(self) -> list[SeenRequest]:
        """End the judge and return all requests that it saw."""
        output, _ = self._process.communicate(timeout=END_S)
        return [SeenRequest(*each) for each in json.loads(output)]

    def run(self, span: Span) -> Run:
        """End the judge and return what it saw in the master's measured time."""
        seen = self.seen()
        first_s = min((each.start_s for each in seen), default=float("nan"))
        seen.sort(key=lambda each: each.start_s)
        law = Law(self.spec.timing, self.spec.delay_s)
        return Run(law, between(seen, span.from_s, span.to_s), span, first_s)


def run_subject(
    kind: str,
    spec: Spec,
    *,
    warm_s: float = 0.7,
    seconds: float = 4.0,
    stops: int = 0,
    response_s: float | None = None,
) -> Run:
    """Run one of the masters of `subjects` on a line."""
    with Watched(spec) as judge:
        delay_s = spec.delay_s if response_s is None else response_s
        task = Task(judge.ports, spec.baud, spec.framing, spec.units, warm_s, seconds, delay_s, stops)
        done = subprocess.run(
            [sys.executable, "-m", "tests.lab.bench.subjects", kind, json.dumps(asdict(task))],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            timeout=warm_s + seconds + END_S,
        )
        return judge.run(_span(json.loads(done.stdout)))


@contextmanager
def gateway(config: Path, prefix: Sequence[str] = ()) -> Iterator[Process]:
    """Run the gateway until the block ends."""
    with Process(config, prefix) as process:
        try:
            yield process
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
            process.kill()


class Process(subprocess.Popen[bytes]):
    """The gateway itself, its modules compiled, as pip leaves them when it installs."""

    def __init__(self, config: Path, prefix: Sequence[str]) -> None:
        compileall.compile_dir(Path(package.__file__).parent, quiet=1)
        self.begun_s = time.monotonic()
        self._log = config.parent / "gateway.log"
        with self._log.open("wb") as log:
            super().__init__([*prefix, sys.executable, "-m", "gateway", "run", str(config)], stderr=log)

    def used(self) -> Usage:
        """Return what it uses now; RuntimeError when it has ended."""
        if self.poll() is not None:
            raise RuntimeError(f"the gateway has ended:\n{self._log.read_text()}")
        return usage(self.pid)


def _span(output: dict[str, object]) -> Span:
    span = Span(**output)  # type: ignore[arg-type]  # it is what `subjects` printed
    span.stops = [Submitted(*each) for each in span.stops]
    return span
