"""MQTT: topics and payloads (`contract`), what waits for the broker (`outbox`), and the connection.

Start at `publisher` for the way out and at `connection.inbox` for the way in.
"""
