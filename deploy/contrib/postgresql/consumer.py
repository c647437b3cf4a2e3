#!/usr/bin/env python3
"""Writes what gateways publish into PostgreSQL (schema.sql): each message once, whatever fails.

The broker repeats what was not acknowledged, and a message is acknowledged only once it is committed: so
nothing is missing. What is repeated has the key of a row that is there: so nothing is there twice. This needs
a session that the broker stores (a client id of its own, no clean start), with room for an outage of the
database: see README.md.

    pip install paho-mqtt pg8000
    psql -d plant -f schema.sql
    PGHOST=/run/postgresql PGDATABASE=plant PGUSER=historian MQTT_PASSWORD=... \\
        consumer.py --host broker.plant --cafile plant-ca.pem --username historian --base 'acme/+/+/+/+'

`--base` may be given more than once; + stands for any level of it. PGPORT, PGPASSWORD as for psql.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import time
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions
from pg8000.exceptions import DatabaseError, InterfaceError
from pg8000.native import Connection

log = logging.getLogger("historian")

OF_A_STARTER = ("value/+", "state", "alarm/+", "event", "start", "trip", "history")
TOPICS = ("gateway/event", "audit", "result/+/+", *(f"starter/+/{kind}" for kind in OF_A_STARTER))
BATCH = 200  # messages in one transaction; the broker has no more than these on their way
GATHER_S, AGAIN_S, DATABASE_S = 0.2, 1.0, 10.0
DATA_IS_WRONG = ("22", "23", "54")  # SQLSTATE: data exception, constraint violation, program limit

MESSAGES = """
WITH rows AS (SELECT * FROM jsonb_to_recordset(cast(:rows AS jsonb))
              AS r(topic text, boot text, seq bigint, time timestamptz, payload jsonb)),
     runs AS (INSERT INTO run SELECT boot, min(time) FROM rows WHERE time IS NOT NULL
                     AND coalesce(payload ->> 'quality', 'good') = 'good' GROUP BY boot
              ON CONFLICT (boot) DO UPDATE SET began = excluded.began WHERE excluded.began < run.began)
INSERT INTO message (topic, boot, seq, time, payload) SELECT * FROM rows ON CONFLICT DO NOTHING"""
RESULTS = """
INSERT INTO result (topic, id, phase, duplicate, time, payload)
SELECT * FROM jsonb_to_recordset(cast(:rows AS jsonb))
       AS r(topic text, id text, phase text, duplicate boolean, time timestamptz, payload jsonb)
ON CONFLICT DO NOTHING"""
UNREADABLE = "INSERT INTO unreadable (topic, payload) VALUES (:topic, :payload) ON CONFLICT DO NOTHING"


def rows_of(topic: str, payload: bytes) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows for `message` and for `result`; ValueError, KeyError, TypeError for what is neither."""
    if not payload:
        return [], []  # a retained topic was cleared
    body = json.loads(payload)
    if topic.endswith("/history"):
        values = topic.removesuffix("history") + "value/"
        return [_row(values + item["point"], body["boot"], item) for item in body["items"]], []
    if "seq" in body:
        return [_row(topic, body["boot"], body)], []
    names = {name: body[name] for name in ("phase", "duplicate", "time")}
    return [], [{"topic": topic, "id": body["id"] or "", **names, "payload": body}]


def _row(topic: str, boot: str, body: dict[str, Any]) -> dict[str, Any]:
    return {"topic": topic, "boot": boot, "seq": body["seq"], "time": body["time"], "payload": body}


class Store:
    """The database; each call is one transaction, or nothing."""

    def __init__(self) -> None:
        self._connection: Connection | None = None
        self._again_s = 0.0

    def write(self, batch: list[mqtt.MQTTMessage]) -> bool:
        """Return whether all of it is committed; if not, the reason is printed and it can be tried again."""
        if time.monotonic() < self._again_s:
            return False
        try:
            self._connection = self._connection or _connect()
            if not self._written(batch):
                for one in batch:  # one of them is no message of ours: it must not hold up the others
                    if not self._written([one]):
                        log.warning("unreadable: %s", one.topic)
                        self._connection.run(UNREADABLE, topic=one.topic, payload=one.payload)
        except (DatabaseError, InterfaceError, OSError) as error:
            log.warning("the database: %s; trying again", error)
            self._close()
            self._again_s = time.monotonic() + AGAIN_S
            return False
        return True

    def _written(self, batch: list[mqtt.MQTTMessage]) -> bool:
        assert self._connection is not None
        run = self._connection.run
        try:
            pairs = [rows_of(one.topic, one.payload) for one in batch]
            run("BEGIN")
            run(MESSAGES, rows=json.dumps([row for messages, _ in pairs for row in messages]))
            run(RESULTS, rows=json.dumps([row for _, results in pairs for row in results]))
            run("COMMIT")
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return False
        except DatabaseError as error:
            if not str(error.args[0].get("C", "")).startswith(DATA_IS_WRONG):
                raise
            run("ROLLBACK")
            return False
        return True

    def _close(self) -> None:
        connection, self._connection = self._connection, None
        try:
            if connection is not None:
                connection.close()
        except (InterfaceError, OSError):
            pass  # it is gone already


def _connect() -> Connection:
    host, port = os.environ.get("PGHOST", "/run/postgresql"), int(os.environ.get("PGPORT", "5432"))
    where = {"unix_sock": f"{host}/.s.PGSQL.{port}"} if host.startswith("/") else {"host": host, "port": port}
    user = os.environ.get("PGUSER", "historian")
    login = {"database": os.environ.get("PGDATABASE", user), "password": os.environ.get("PGPASSWORD")}
    return Connection(user, **login, **where, timeout=DATABASE_S)


def consume(args: argparse.Namespace) -> None:
    """Run until killed."""
    store, pending = Store(), list[mqtt.MQTTMessage]()
    session = Properties(PacketTypes.CONNECT)
    session.SessionExpiryInterval, session.ReceiveMaximum = 0xFFFFFFFF, BATCH
    client = mqtt.Client(
        mqtt.CallbackAPIVersion.VERSION2, args.client_id, protocol=mqtt.MQTTv5, manual_ack=True
    )
    client.username_pw_set(args.username, os.environ.get("MQTT_PASSWORD"))
    if args.cafile:
        client.tls_set(args.cafile)

    def subscribe(_client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            log.warning("the broker refuses the login: %s", reason)
            return
        pending.clear()  # the broker sends all that was not acknowledged again
        once = SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_SEND_IF_NEW_SUB)
        client.subscribe([(f"{base}/{topic}", once) for base in args.base for topic in TOPICS])

    def complain(_client: Any, _data: Any, _mid: Any, reasons: Any, _properties: Any) -> None:
        for reason in reasons:
            if reason.is_failure:
                log.warning("the broker refuses a subscription: %s", reason)

    client.on_connect, client.on_subscribe = subscribe, complain
    client.on_message = lambda _client, _data, message: pending.append(message)
    while True:
        try:
            client.connect(args.host, args.port, keepalive=30, clean_start=False, properties=session)
            while gather(client, pending):
                if pending and store.write(pending):
                    for message in pending:
                        client.ack(message.mid, message.qos)
                    pending.clear()
        except OSError as error:
            log.warning("the broker: %s", error)
        log.warning("not connected; trying again")
        time.sleep(AGAIN_S)


def gather(client: mqtt.Client, pending: list[mqtt.MQTTMessage]) -> bool:
    """Read what has come, for a batch; return whether the connection is still there."""
    is_connected = client.loop(GATHER_S) == mqtt.MQTT_ERR_SUCCESS
    until_s = time.monotonic() + GATHER_S
    while is_connected and pending and len(pending) < BATCH and time.monotonic() < until_s:
        count = len(pending)
        is_connected = client.loop(0.01) == mqtt.MQTT_ERR_SUCCESS
        if len(pending) == count:
            break
    return is_connected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=1883)
    parser.add_argument("--cafile")
    parser.add_argument("--username")
    parser.add_argument("--client-id", default="historian", help="its own: the broker keeps a session for it")
    parser.add_argument(
        "--base", action="append", required=True, help="mqtt.base of the gateways; + for any level"
    )
    logging.basicConfig(format="%(message)s")
    consume(parser.parse_args())
