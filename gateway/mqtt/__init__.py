"""The MQTT adapter: records out, commands in, and what waits while the broker is away.

Nothing outside reaches past this door. `Session` keeps the connection, `Publisher` and `Outbox` send,
`IncomingCommands` takes; `CommandClient` is the other side, for the command line.
"""

from gateway.mqtt.commands import Incoming, IncomingCommands
from gateway.mqtt.connection.broker import BrokerConnection, Hooks
from gateway.mqtt.connection.command_client import CommandClient
from gateway.mqtt.connection.connect import FIRST_RETRY_S, LAST_RETRY_S, STEADY_S, connected
from gateway.mqtt.connection.inbox import Inbox
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings, TlsSettings, Version
from gateway.mqtt.leftovers import Leftovers
from gateway.mqtt.message import Message, cleared, message_of
from gateway.mqtt.outbox.backlog import Bounds
from gateway.mqtt.outbox.disk_sync import DiskSync
from gateway.mqtt.outbox.outbox import Outbox
from gateway.mqtt.publisher import Publisher
