"""A small plant's day in two minutes, again and again: the demo's motors as people there would run them.

Starts and stops are commands like any other, of the operator `demo`; trips and power cuts are set at the
simulated starters. Nothing here exists in a real gateway.
"""

from __future__ import annotations

import asyncio
import logging
from typing import NamedTuple

from gateway.cli.broker import Subscription
from gateway.cli.demo.knobs import TREE
from gateway.cli.demo.processes import demo_client
from gateway.client import Client
from gateway.contract import Phase
from gateway.errors import GatewayError
from gateway.mqtt import Message

log = logging.getLogger(__name__)

BASE, CLIENT = "starters/demo", "demo"
DAY_S = 120.0
RESULT_WITHIN_S = 20.0


class Deed(NamedTuple):
    """A command at a second of the day, or with a `setting` a knob of the simulator."""

    at_s: float
    starter: str
    what: str
    setting: str = ""


DAY = (
    Deed(2.0, "pump", "start"),
    Deed(8.0, "fan", "start"),
    Deed(18.0, "mill", "start"),
    Deed(30.0, "belt", "start"),
    Deed(50.0, "fan", "stop"),
    Deed(56.0, "mill", "trip", "F005"),
    Deed(66.0, "fan", "start"),
    Deed(72.0, "mill", "reset"),
    Deed(78.0, "mill", "start"),
    Deed(84.0, "belt", "stop"),
    Deed(92.0, "belt", "power", "off"),
    Deed(104.0, "belt", "power", "on"),
    Deed(106.0, "pump", "stop"),
    Deed(109.0, "fan", "stop"),
    Deed(112.0, "belt", "configure"),  # an SST asks for that after each loss of its supply
    Deed(114.0, "mill", "stop"),
)


async def run_plant(port: int) -> None:
    """Run day after day at the broker on this port, until cancelled; what fails is logged. BrokerError."""
    knobs, loop = Subscription(demo_client(port), (), lambda _: None), asyncio.get_running_loop()
    await knobs.connect()
    while True:
        begun_s = loop.time()
        for deed in DAY:
            await asyncio.sleep(max(begun_s + deed.at_s - loop.time(), 0.0))
            if deed.setting:
                topic = f"{TREE}/{deed.starter}/{deed.what}"
                knobs.publish(Message(topic, deed.setting.encode(), qos=1, retain=False))
            else:
                await _command(deed, port)
        await asyncio.sleep(max(begun_s + DAY_S - loop.time(), 0.0))


async def _command(deed: Deed, port: int) -> None:
    try:
        client = Client(demo_client(port), base=BASE, client=CLIENT)
        result = await client.command(deed.starter, deed.what, within_s=RESULT_WITHIN_S)
        if result.phase is not Phase.CONFIRMED:
            log.warning("%s %s: %s", deed.starter, deed.what, result)
    except (GatewayError, TimeoutError) as error:
        log.warning("%s %s: %s", deed.starter, deed.what, error)
