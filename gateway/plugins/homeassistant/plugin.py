"""Home Assistant: its discovery messages go out with the gateway's own, over the same connection.

1. Each starter's message is made from its retained `info`, and published when that or the site changes.
2. A message that is not wanted any more is deleted at the broker, also by the next run, also without the
   table: the topics are stored in `state_dir` before anything goes out.
3. A birth of Home Assistant is answered with all messages again, after a pause drawn by chance, so that many
   gateways do not answer together. A birth that comes while an answer is due is answered with it.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
import secrets
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from pydantic import TypeAdapter

from gateway.contract import Event, InfoRecord, Record
from gateway.errors import StoreError
from gateway.mqtt import Message, cleared
from gateway.plugins.homeassistant.discovery import gateway_message, starter_message
from gateway.plugins.homeassistant.site_facts import SiteFacts, facts_of
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.store import STATE_FILE, read_document
from gateway.system.supervised import is_set_within

log = logging.getLogger(__name__)

MISSING: Event | None = None  # it needs nothing besides
ANNOUNCED = "announced"  # the document
TOPICS = TypeAdapter(set[str])
SETTLE_S = 0.5  # what is known of the starters changes in quick succession
BORN = b"online"  # Home Assistant's birth message; its will is `offline`
LONGEST_PAUSE_S = 5.0  # before a birth is answered
LOOK_S = 1.0  # whether the broker has deleted what it was to delete


@dataclass(frozen=True, slots=True)
class HomeAssistantSettings:
    """The facts on which discovery depends, if it is wanted."""

    facts: SiteFacts | None


class HomeAssistantService:
    """Announces the starters to Home Assistant; a `Plugin`. On the app's loop."""

    def __init__(self, settings: HomeAssistantSettings, gateway: Gateway) -> None:
        self._gateway = gateway
        self._mqtt = gateway.mqtt
        self._clock = gateway.clock
        self._document = gateway.documents.open(ANNOUNCED, TOPICS, lambda: self._topics)
        self._chance = random.Random(secrets.randbits(32))
        self._again_s = math.inf  # when the answer to a birth is due
        self._birth_topic = ""
        self._topics = self._document.loaded or set()  # that the broker holds, or may hold
        self._clearing: set[str] = set()
        self._changed = asyncio.Event()
        self._dirty: set[str] = set()  # starters whose message may be another one now; empty: the gateway
        self.reconfigure(settings)

    def put(self, record: Record) -> None:
        """Take a record: only what a starter is matters here."""
        if isinstance(record, InfoRecord):
            self._dirty.add(record.starter)
            self._changed.set()

    def reconfigure(self, settings: HomeAssistantSettings) -> None:
        """Go on with other settings; without facts everything is deleted."""
        self._facts = settings.facts
        self._dirty = set() if self._facts is None else {"", *self._facts.rules}
        self._changed.set()

    async def run(self) -> None:
        """Announce until cancelled; what was announced stays at the broker then."""
        try:
            while True:
                self._changed.clear()
                self._listen("" if self._facts is None else self._facts.birth_topic)
                await self._announce()
                if self._clock.now_s() >= self._again_s:
                    self._announce_again()
                left_s = max(0.0, self._again_s - self._clock.now_s())
                if await is_set_within(self._changed, min(left_s, LOOK_S if self._clearing else math.inf)):
                    await asyncio.sleep(SETTLE_S)
        finally:
            self._listen("")

    async def _announce(self) -> None:
        """Publish what has changed, and have the broker delete what is not wanted any more."""
        facts = self._facts
        wanted = set() if facts is None else {facts.config_topic(name) for name in ("", *facts.rules)}
        if not wanted <= self._topics:
            self._topics |= wanted
            await self._save()  # before anything of it is at the broker
        self._clearing -= wanted
        while facts is not None and facts is self._facts and self._dirty:
            starter = min(self._dirty)  # the gateway first: the starters' devices refer to its own
            self._dirty.discard(starter)
            message = self._message(facts, starter)
            if message is not None and self._mqtt.retained(message.topic) != message:
                self._mqtt.announce(message)
            await asyncio.sleep(0)
        deleted = {topic for topic in sorted(self._topics - wanted) if self._is_deleted(topic)}
        if deleted:
            self._topics -= deleted
            await self._save()

    def _message(self, facts: SiteFacts, starter: str) -> Message | None:
        """Return the message of a starter, or of the gateway; of a starter without `info` there is none."""
        if not starter:
            return gateway_message(facts)
        info = self._gateway.latest.find(InfoRecord.topic_of(starter=starter))
        if starter not in facts.rules or not isinstance(info, InfoRecord):
            return None
        return starter_message(facts, info)

    def _is_deleted(self, topic: str) -> bool:
        """Return whether the broker has confirmed that it has deleted a topic; else ask for it."""
        standing = self._mqtt.retained(topic)
        if standing is None and topic in self._clearing:
            self._clearing.discard(topic)
            return True
        if standing is None or standing.payload:
            self._clearing.add(topic)
            self._mqtt.announce(cleared(topic))
        return False

    def _announce_again(self) -> None:
        """Publish everything that stands once more: Home Assistant has begun again."""
        for topic in sorted(self._topics - self._clearing):
            message = self._mqtt.retained(topic)
            if message is not None:
                self._mqtt.announce(message)
        self._again_s = math.inf

    def _listen(self, topic: str) -> None:
        if topic != self._birth_topic:
            if self._birth_topic:
                self._mqtt.unlisten(self._birth_topic)
            if topic:
                self._mqtt.listen(topic, self._take_birth)
            self._birth_topic = topic

    def _take_birth(self, payload: bytes) -> None:
        if payload == BORN and self._again_s == math.inf:
            self._again_s = self._clock.now_s() + self._chance.uniform(0.0, LONGEST_PAUSE_S)
            self._changed.set()

    async def _save(self) -> None:
        self._document.touch()
        if not await self._document.saved():
            log.warning("not stored: a later run cannot delete what was announced to Home Assistant")


def load(gateway: Gateway) -> Callable[[HomeAssistantSettings], Plugin]:
    """Return what makes Home Assistant's discovery."""
    return lambda settings: HomeAssistantService(settings, gateway)


def settings_of(site: PluginSite) -> HomeAssistantSettings | None:
    """Return what is announced, until everything is deleted that was and is not wanted any more."""
    if site.config.home_assistant is None and not _is_announced(site):
        return None
    return HomeAssistantSettings(facts_of(site.config))


def _is_announced(site: PluginSite) -> bool:
    """Return whether anything was announced that the broker may still hold."""
    with suppress(StoreError):
        topics = read_document(site.state_dir / STATE_FILE, ANNOUNCED, TOPICS)
        return bool(topics)
    return False
