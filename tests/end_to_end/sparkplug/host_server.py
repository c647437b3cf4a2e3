"""A host application made of mqtt-spb-wrapper, in its own venv: prints what it sees, writes what it is given.

Arguments: the broker's port. A line of JSON on the standard input is a write: node, device, name, value.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from mqtt_spb_wrapper import MqttSpbEntityScada


def main() -> None:
    def show(kind: str) -> Any:
        def take(topic: Any, payload: Any) -> None:
            metrics = {
                each["name"]: {key: each.get(key) for key in ("value", "datatype", "timestamp", "isNull")}
                for each in (payload or {}).get("metrics", [])
            }
            seen = {"kind": kind, "topic": str(topic), "seq": (payload or {}).get("seq"), "metrics": metrics}
            print(json.dumps(seen, default=str), flush=True)

        return take

    host = MqttSpbEntityScada(
        "plant",
        "judge",
        callback_birth=show("birth"),
        callback_data=show("data"),
        callback_death=show("death"),
    )
    if not host.connect(host="127.0.0.1", port=int(sys.argv[1])):
        sys.exit("no broker")
    print(json.dumps({"kind": "connected"}), flush=True)
    for line in sys.stdin:
        write = json.loads(line)
        host.send_command(write["name"], write["value"], write["node"], write["device"])
    host.disconnect()


main()
