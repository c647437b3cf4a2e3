"""A gateway as many a plant has one: pymodbus, paho, one loop. The comparison runs it; nothing imports it.

Usage: script.py SERIAL_PORT BROKER_PORT PERIOD_S
"""

import json
import queue
import sys
import time
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion
from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusException

STARTERS = {"pump": 1, "fan": 2, "mill": 3, "belt": 4}
STATUS = 5001  # VB01, bit 0 = running
CURRENTS = 2  # P002 in 0.1 %, P003 in 0.1 A
RUN = 100  # coil

PORT, BROKER_PORT, PERIOD_S = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
modbus = ModbusSerialClient(PORT, baudrate=19200, stopbits=2, timeout=0.5)
client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id="script")
commands: queue.Queue[tuple[str, bool]] = queue.Queue()


def on_connect(client: mqtt.Client, *_: Any) -> None:
    client.subscribe("plant/+/set", qos=1)


def on_message(client: mqtt.Client, userdata: Any, message: mqtt.MQTTMessage) -> None:
    commands.put((message.topic.split("/")[1], message.payload == b"start"))


def write_commands() -> None:
    while not commands.empty():
        name, is_on = commands.get()
        modbus.write_coil(RUN, is_on, device_id=STARTERS[name])


def poll(name: str) -> None:
    status = modbus.read_holding_registers(STATUS, count=1, device_id=STARTERS[name])
    currents = modbus.read_holding_registers(CURRENTS, count=2, device_id=STARTERS[name])
    if status.isError() or currents.isError():
        return
    values = {
        "running": bool(status.registers[0] & 1),
        "current_pct": currents.registers[0] / 10,
        "current": currents.registers[1] / 10,
        "time": time.time(),
    }
    client.publish(f"plant/{name}", json.dumps(values), qos=1, retain=True)


client.on_connect = on_connect
client.on_message = on_message
client.connect("127.0.0.1", BROKER_PORT)
client.loop_start()
modbus.connect()
while True:
    began_s = time.monotonic()
    for starter in STARTERS:
        try:
            write_commands()
            poll(starter)
        except ModbusException as error:
            print(starter, error)
    time.sleep(max(0.0, PERIOD_S - (time.monotonic() - began_s)))
