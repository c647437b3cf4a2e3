"""Home Assistant: its discovery messages go out with the gateway's own, over the same connection.

1. Each starter's message is made from its retained `info`, and published when that or the site changes.
2. A message that is not wanted any more is deleted at the broker, also by the next run, also without the
   table: the topics are stored in `state_dir` before anything goes out.
3. The birth of Home Assistant is answered with all messages again, after up to 5 s.
"""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gateway import __version__
from gateway.config.convert import policy_of, rights_of
from gateway.config.schema import Config
from gateway.contract import Event, InfoRecord, Record, to_level
from gateway.errors import DamagedError, StoreError
from gateway.families.profile.load import load_profile
from gateway.mqtt.message import cleared
from gateway.plugins.homeassistant.announcements import Announcements, BirthPause
from gateway.plugins.homeassistant.discovery import gateway_message, starter_message
from gateway.plugins.homeassistant.site_facts import SiteFacts, StarterFacts
from gateway.plugins.interface import Gateway, Plugin, PluginSite
from gateway.storage.json_file import JsonFile

log = logging.getLogger(__name__)

MISSING: Event | None = None  # it needs nothing besides
FILE = "home-assistant.json"  # in state_dir
SETTLE_S = 0.5  # what is known of the starters changes in quick succession
LOOK_S = 1.0  # whether the broker has deleted what it was to delete


@dataclass(frozen=True, slots=True)
class HomeAssistantSettings:
    """What discovery depends on, if it is wanted, and where is stored what was announced."""

    facts: SiteFacts | None
    file: Path


class HomeAssistantService:
    """Announces the starters to Home Assistant; an `IntegrationService`. On the app's loop."""

    def __init__(self, settings: HomeAssistantSettings, gateway: Gateway, *, seed: int) -> None:
        self._mqtt = gateway.mqtt
        self._latest = gateway.latest
        self._clock = gateway.clock
        self._store = JsonFile(settings.file)
        self._in_thread = gateway.in_thread
        self._birth = BirthPause(seed)
        self._birth_topic = ""
        self._announcements = Announcements(None)
        self._clearing: set[str] = set()
        self._changed = asyncio.Event()
        self._dirty: set[str] = set()  # starters whose message may be another one now; empty: the gateway
        self._facts: SiteFacts | None = None
        self.reconfigure(settings)

    def put(self, record: Record) -> None:
        """Take a record: only what a starter is matters here."""
        if isinstance(record, InfoRecord):
            self._dirty.add(record.starter)
            self._changed.set()

    def reconfigure(self, settings: HomeAssistantSettings) -> None:
        """Go on with other settings; without facts everything is deleted."""
        self._facts = settings.facts
        self._dirty = set() if self._facts is None else {"", *self._facts.starters}
        self._changed.set()

    async def run(self) -> None:
        """Announce until cancelled; what was announced stays at the broker then."""
        self._announcements = await self._in_thread(self._recalled)
        try:
            while True:
                self._changed.clear()
                self._listen("" if self._facts is None else self._facts.birth_topic)
                await self._announce()
                if self._birth.left_s(self._clock.now_s()) == 0.0:
                    self._announce_again()
                await self._wait()
        finally:
            self._listen("")

    def _recalled(self) -> Announcements:
        """Return what an earlier run has announced; reads the disk."""
        try:
            return Announcements(self._store.load())
        except DamagedError as error:
            log.warning("%s; what an earlier run announced to Home Assistant is not deleted", error)
            self._store.set_aside()
            return Announcements(None)

    async def _wait(self) -> None:
        """Wait until something has changed, and a little longer, or until something is due."""
        left_s = self._birth.left_s(self._clock.now_s())
        due_s = math.inf if left_s is None else left_s
        if self._clearing:
            due_s = min(due_s, LOOK_S)
        try:
            async with asyncio.timeout(None if due_s == math.inf else due_s):
                await self._changed.wait()
        except TimeoutError:
            return
        await asyncio.sleep(SETTLE_S)

    async def _announce(self) -> None:
        facts = self._facts
        wanted = set() if facts is None else {facts.config_topic(name) for name in ("", *facts.starters)}
        if self._announcements.add(wanted):
            await self._save()  # before anything of it is at the broker
        self._clearing -= wanted
        while facts is not None and facts is self._facts and self._dirty:
            starter = min(self._dirty)  # the gateway first: the starters' devices refer to its own
            self._dirty.discard(starter)
            self._announce_one(facts, starter)
            await asyncio.sleep(0)
        if self._delete(self._announcements.unwanted(wanted)):
            await self._save()

    def _announce_one(self, facts: SiteFacts, starter: str) -> None:
        """Publish a message that is another one than before; a starter without `info` has none yet."""
        if not starter:
            message = gateway_message(facts)
        elif starter in facts.starters:
            info = self._latest.find(InfoRecord.topic_of(starter=starter))
            if not isinstance(info, InfoRecord):
                return
            message = starter_message(facts, starter, info.fields())
        else:
            return
        if self._mqtt.retained(message.topic) != message:
            self._mqtt.announce(message)

    def _delete(self, topics: list[str]) -> bool:
        """Have the broker delete topics; return whether it has confirmed any."""
        is_any_gone = False
        for topic in topics:
            standing = self._mqtt.retained(topic)
            if standing is None and topic in self._clearing:
                self._clearing.discard(topic)
                self._announcements.forget(topic)
                is_any_gone = True
            elif standing is None or standing.payload:
                self._clearing.add(topic)
                self._mqtt.announce(cleared(topic))
        return is_any_gone

    def _announce_again(self) -> None:
        """Publish everything that stands once more: Home Assistant has begun anew."""
        facts = self._facts
        for name in () if facts is None else ("", *facts.starters):
            message = None if facts is None else self._mqtt.retained(facts.config_topic(name))
            if message is not None:
                self._mqtt.announce(message)
        self._birth.answered(self._clock.now_s())

    def _listen(self, topic: str) -> None:
        if topic == self._birth_topic:
            return
        if self._birth_topic:
            self._mqtt.unlisten(self._birth_topic)
        self._birth_topic = topic
        if topic:
            self._mqtt.listen(topic, self._take_birth)

    def _take_birth(self, payload: bytes) -> None:
        self._birth.take(payload, self._clock.now_s())
        self._changed.set()

    async def _save(self) -> None:
        try:
            await self._store.save(self._announcements.document())
        except StoreError as error:
            log.warning("%s; a later run cannot delete what was announced to Home Assistant", error)


def load(gateway: Gateway) -> Callable[[HomeAssistantSettings], Plugin]:
    """Return what makes Home Assistant's discovery."""
    seed = secrets.randbits(32)
    return lambda settings: HomeAssistantService(settings, gateway, seed=seed)


def settings_of(site: PluginSite) -> HomeAssistantSettings | None:
    """Return what is announced, until everything is deleted that was and is not wanted any more."""
    file = site.state_dir / FILE
    if site.config.home_assistant is None and not file.exists():
        return None
    return HomeAssistantSettings(facts_of(site.config), file)


def facts_of(config: Config) -> SiteFacts | None:
    """Return what discovery depends on; None without a `[homeassistant]`."""
    table = config.home_assistant
    if table is None:
        return None
    rules = policy_of(config).rules
    starters = {
        starter.name: StarterFacts(
            load_profile(starter.family).title,
            to_level(load_profile(starter.family).history.thermal or ""),
            rules[starter.name].two_step,
        )
        for line in config.lines
        for starter in line.starters
    }
    return SiteFacts(
        gateway=config.gateway.name,
        base=config.base,
        version=__version__,
        discovery_prefix=table.discovery_prefix,
        birth_topic=table.birth_topic or f"{table.discovery_prefix}/status",
        starters=starters,
        lines=tuple(line.name for line in config.lines),
        client=table.operator,
        has_start=table.commands,
        page_url=table.page_url,
        rights=rights_of(config),
    )
