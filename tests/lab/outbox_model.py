"""The model of the outbox with many messages: everything comes once, or is declared lost.

python -m tests.lab.outbox_model [messages] [seeds]
"""

from __future__ import annotations

import sys

from tests.mqtt.outbox_model import TROUBLES, run


def main() -> None:
    """Run the models, one after another with each of the troubles, and print what happened in each."""
    messages, seeds = (int(each) for each in (*sys.argv[1:], "100000", "20")[:2])
    for seed in range(seeds):
        trouble = TROUBLES[seed % len(TROUBLES)]
        print(seed, trouble, dict(run(seed, messages, trouble)), flush=True)


if __name__ == "__main__":
    main()
