"""The gateway without the trick that BENCH_WITHOUT names: `python -m tests.lab.bench.without run CONFIG`."""

from __future__ import annotations

import os

from gateway.cli.main import main
from tests.lab.bench.subjects import WITHOUT
from tests.lab.bench.tricks import take_out

if __name__ == "__main__":
    if name := os.environ[WITHOUT]:
        take_out(name)
    raise SystemExit(main())
