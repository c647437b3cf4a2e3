"""`python -m tests.lab.fleet [--gateways N] [--starters M] [--seconds S]`: a fleet on this machine, measured.

N gateways with M simulated starters each, the site's Mosquitto bridged to a central one. The link is cut, one
gateway is killed and one restarted; at the end the books of two subscribers are compared. With --fill the
retained topics of one gateway are published for that many gateways to a broker of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.lab.fleet.fleet import FleetPlan, FleetResult, run_fleet
from tests.lab.fleet.memory import Filled, fill
from tests.lab.fleet.site import BASE, ROOM, SITE, gateway_name
from tests.mosquitto import missing_programs

MIB = 1024  # KiB


def main() -> int:
    """Run a fleet and print what was measured; 1 when a message is lost or a topic ends with an old one."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.fleet", description=__doc__)
    parser.add_argument("--gateways", type=int, default=2, metavar="N")
    parser.add_argument("--starters", type=int, default=4, metavar="M", help="of each gateway, on one line")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="of each span and the cut")
    room = "of the site's broker for the bridge, messages: too little must be found as a loss"
    parser.add_argument("--room", type=int, default=ROOM, metavar="N", help=room)
    parser.add_argument("--fill", type=int, default=0, metavar="GATEWAYS")
    args = parser.parse_args()
    if absent := missing_programs():
        print(f"not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 2
    print(f"{os.cpu_count()} processors, load before {os.getloadavg()[0]:.2f}", flush=True)
    with tempfile.TemporaryDirectory(prefix="fleet-") as folder:
        plan = FleetPlan(args.gateways, args.starters, args.seconds, args.room)
        result = asyncio.run(run_fleet(plan, Path(folder)))
        print_result(result)
        if args.fill:
            name = gateway_name(0)
            own = {topic: each for topic, each in result.retained.items() if f"/{name}/" in topic}
            print_filled(fill(Path(folder) / "filled", own, name=name, gateways=args.fill))
    return 0 if result.is_whole else 1


def print_result(result: FleetResult) -> None:
    """Print all that a run found."""
    plan = result.plan
    print(f"{plan.gateways} gateways x {plan.starters} starters at 19200 bit/s, all families, every_s = 1")
    each = sorted(result.start_up.values())
    print(f"start-up: {each[0][0]} to {each[-1][0]} messages of a gateway, {each[-1][1]} in its worst second")
    for span in result.spans:
        rate, size = span.published / span.seconds, span.size / span.seconds
        of_one = f"{rate / plan.gateways:.1f} messages/s and {size / plan.gateways / 1000:.1f} kB/s a gateway"
        print(f"{span.name}: {rate:.0f} messages/s, {size / 1000:.0f} kB/s; {of_one}; load {span.load:.1f}")
        kinds = (
            f"{kind} {count / span.seconds / plan.gateways:.2f}" for kind, count in span.kinds.most_common()
        )
        print(f"    messages/s of a gateway: {', '.join(kinds)}")
        for kind, used in span.used.items():
            share, mib = used.cpu_s / span.seconds, used.rss_kib / MIB
            print(f"    {kind:18} {share:6.1%} of a processor, {mib:7.1f} MiB")
    print(f"starts over the bridge: {dict(result.starts)}")
    cut = result.cut
    growth = cut["broker_kib"] * 1024 / max(cut["messages"], 1)
    rate = cut["arrived"] / max(cut["passed_s"] - cut["first_s"], 0.001)
    print(
        f"cut for {cut['seconds']:.1f} s: {cut['messages']:.0f} messages waited,"
        f" {growth:.0f} bytes of the site's broker each; after the link was back the first came after"
        f" {cut['first_s']:.1f} s, the last after {cut['passed_s']:.1f} s, {rate:.0f} messages/s,"
        f" up to {cut['copies']:.0f} copies of one"
    )
    print(f"exit codes: {result.exits}")
    print(f"books: {result.verdict}")
    if result.verdict is not None:
        for (gateway, boot), missing in result.verdict.holes.items():
            print(f"    {gateway} {boot}: {missing[:20]}")
        for name in result.verdict.lost[:5]:
            print(f"    lost: {name}")
    print(f"retained otherwise at the central broker: {len(result.differing)} {result.differing[:5]}")
    _print_retained(result)


def _print_retained(result: FleetResult) -> None:
    count, size = Counter[str](), Counter[str]()
    for topic, payload in result.retained.items():
        _, _, branch, *rest = topic.removeprefix(SITE).split("/")
        kind = rest[0].partition("-")[2] if branch == "starter" else branch
        count[kind] += 1
        size[kind] += len(topic) + len(payload)
    print(f"retained at the central broker, below {SITE}{BASE}: {count.total()} topics, {size.total()} bytes")
    starters = Counter({topic.split("/")[5] for topic in result.retained if "/starter/" in topic})
    families = Counter(name.partition("-")[2] for name in starters)
    for kind, topics in sorted(count.items()):
        each = families.get(kind, 1) * result.plan.gateways
        of = "starter" if kind in families else "gateway"
        print(f"    {kind:8} {topics / each:6.1f} topics, {size[kind] / each:8.0f} bytes a {of}")


def print_filled(filled: Filled) -> None:
    """Print what so many gateways' retained topics cost a broker."""
    print(
        f"{filled.gateways} gateways' retained topics: {filled.topics} in {filled.seconds:.1f} s,"
        f" {filled.us_a_message:.0f} us of the broker a message; {filled.before.rss_kib / MIB:.1f} ->"
        f" {filled.after.rss_kib / MIB:.1f} MiB, {filled.kib_a_thousand:.0f} KiB a thousand topics"
    )


if __name__ == "__main__":
    sys.exit(main())
