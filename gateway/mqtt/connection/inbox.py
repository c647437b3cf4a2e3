"""Where messages wait to be parsed, a few milliseconds' worth at a time; stops are taken first.

1. The topic alone says what a message is for: a stop is taken at once, before everything that waits.
2. The others are parsed in the order of their arrival, in at most half of the time.
3. Beyond `MOST` that wait, or `MOST_OF_CLIENT` of one client, a message is refused unparsed; those on
   topics that name no client count as one client's, and are dropped. What is no command is dropped at once.
4. Of more stops than `PARSED_STOPS` only the topic is read: they are carried out, but their id is not known.

So a flood delays a stop by what is being read of the socket at most, not by what came before it.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace

from gateway.contract import STOP, CommandAddress, Topics, shortened
from gateway.mqtt.commands import Incoming
from gateway.system.rate_limits import Bucket, Rate

logger = logging.getLogger(__name__)

MOST, MOST_OF_CLIENT = 300, 100  # messages that wait; not less than `RateLimits` takes at once
PARSED_STOPS = Rate(50.0, 50)  # a second, at once
SHARE = 0.5  # of the time, for parsing
AHEAD_S = 0.01  # so long before its share is due, it may be used


class Inbox:
    """Of one gateway; everything belongs to the loop that reads the broker.

    `take` is given what the topic of each message says, the message and its time of arrival on the steady
    clock, `refuse` the starter, client and verb of what is too much.
    """

    def __init__(
        self,
        topics: Topics,
        *,
        take: Callable[[CommandAddress, Incoming, float], None],
        refuse: Callable[[str, str, str], None],
        now_s: Callable[[], float],
    ) -> None:
        self._topics = topics
        self._take = take
        self._refuse = refuse
        self._now_s = now_s
        self._waiting: deque[tuple[CommandAddress, Incoming, float]] = deque()
        self._of_client: Counter[str] = Counter()
        self._parsed_stops = Bucket(PARSED_STOPS)
        self._paid_s = 0.0  # when the parsing done so far is within its share
        self._work: asyncio.TimerHandle | None = None

    def put(self, incoming: Incoming) -> None:
        """Take in a message as it arrives."""
        now_s = self._now_s()
        address = self._topics.parse_command(incoming.topic)
        if address is None:
            logger.debug("topic=%s is no command", shortened(incoming.topic))
        elif address.verb == STOP and not address.problem:
            is_parsed = self._parsed_stops.take(now_s)
            self._take(address, incoming if is_parsed else replace(incoming, payload=b""), now_s)
        elif self._has_room(address.client):
            self._wait(address, incoming, now_s)
        elif address.client:  # there is somebody to answer
            self._refuse(address.starter, address.client, address.verb)

    def _has_room(self, client: str) -> bool:
        return len(self._waiting) < MOST and self._of_client[client] < MOST_OF_CLIENT

    def _wait(self, address: CommandAddress, incoming: Incoming, now_s: float) -> None:
        self._waiting.append((address, incoming, now_s))
        self._of_client[address.client] += 1
        if self._work is None:
            self._parse()

    def _parse(self) -> None:
        """Parse what waits, for a while."""
        loop = asyncio.get_running_loop()
        self._work = None
        while self._waiting:
            began_s = loop.time()
            if self._paid_s - began_s > AHEAD_S:
                self._work = loop.call_at(self._paid_s - AHEAD_S / 2, self._parse)
                return
            address, incoming, received_s = self._waiting.popleft()
            self._of_client[address.client] -= 1
            if not self._of_client[address.client]:
                del self._of_client[address.client]
            try:
                self._take(address, incoming, received_s)
            except Exception:  # one message's guard: the next one is to be read all the same
                logger.exception("topic=%s not taken because of a bug", incoming.topic[:200])
            self._paid_s = max(self._paid_s, began_s) + (loop.time() - began_s) / SHARE
