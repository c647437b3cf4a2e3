"""Which device answers at a starter's address, and what that means for its commands and its values.

A device of another family gives numbers for the same registers, and a larger model the same numbers with
another scale (ssw06-es 4.4). So nothing of a starter is published as good until it has said who it is, or was
asked so often that it counts as one that does not (`first_contact`: REFUSED_ROUNDS, GIVEN_UP_ROUNDS), and has
read a register as its family does.
What was read meanwhile is then decoded for the variant that answers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gateway.contract import CommandError, EventCode, ResultCode
from gateway.families import Identity, diagnosis
from gateway.line import Garbled, LineClient, Priority, Silent
from gateway.starters.identity.first_contact import FirstContact, IdentityStatus, not_matching, standing_of
from gateway.starters.identity.recognition import is_refusal
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.setup import StarterSetup
from gateway.starters.state import Emitter

PROVED_WITHIN_S = 5.0  # where it is not clear at once
GAP_POLLS = 2  # without a reply, after which another device may answer

Rows = Mapping[str, tuple[int, ...]]


class IdentityCheck:
    """Of one starter; `seen` is what the device said about itself last."""

    def __init__(self, setup: StarterSetup, registry: IdentityRegistry, emitter: Emitter) -> None:
        self.setup = setup
        self._registry = registry
        self._emitter = emitter
        self._slot_said: int | None = None  # the slot that was held against the configuration last
        self._see(Identity(reason="not yet asked"))
        self.before_silence = ""  # the contradiction of the device that does not answer any more
        self._held: set[tuple[IdentityStatus, str | None]] = set()  # of which there was an event

    @property
    def standing(self) -> IdentityStatus:
        """Return whether the device has proved to be the configured family, as before."""
        if self._standing is not IdentityStatus.MATCHING:
            return self._standing
        if self._registry.trouble(self.setup.name):
            return IdentityStatus.CHANGED
        return IdentityStatus.OTHER_SLOT if self._slot_trouble else IdentityStatus.MATCHING

    @property
    def is_mismatched(self) -> bool:
        """Return whether it has proved to be of another family."""
        return self._standing is IdentityStatus.MISMATCHED

    @property
    def reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        trouble = diagnosis.why_not(self.setup.profile, self.seen) or self._registry.trouble(self.setup.name)
        return trouble or self._slot_trouble

    @property
    def contradiction(self) -> str:
        """Return in what the device contradicts the configuration, so that its values mean nothing."""
        if self.is_mismatched:
            return diagnosis.why_not(self.setup.profile, self.seen) or ""
        return self._registry.contradiction(self.setup.name)

    def forget(self) -> None:
        """Begin anew: the device went silent. An event that it had comes again only after it has matched."""
        self.before_silence = self.contradiction or self.before_silence
        self._see(Identity(reason="it has not been asked since it went silent"))
        self._registry.forget(self.setup.name)

    def take(self, identity: Identity, *, is_settled: bool) -> bool:
        """Record what the device said; return whether it is of the configured family.

        What holds commands is published when it is news.
        """
        self._see(identity)
        standing = self._standing
        if standing is IdentityStatus.MATCHING:
            self._held.clear()
            self.before_silence = ""
            self._registry.note(self.setup, identity, is_settled=is_settled)
            self._publish_slot()
            return True
        device = (standing, identity.family_seen or identity.model)  # its model may be known only later
        is_less = device[1] is None and any(each[0] is standing for each in self._held)
        if device not in self._held and not is_less:
            self._held.add(device)
            self._publish_held()
        return False

    def _see(self, identity: Identity) -> None:
        self.seen, self._standing = identity, standing_of(self.setup, identity)
        self._slot_trouble = diagnosis.slot_trouble(self.setup.profile, self.setup.variant, identity)

    def _publish_slot(self) -> None:
        """Publish once that commands are held because the accessory sits in another slot."""
        if self.seen.slot is None or self.seen.slot == self._slot_said:
            return
        self._slot_said = self.seen.slot
        if self._slot_trouble:
            self._emitter.event(
                EventCode.SLOT_MISMATCH,
                configured=self.setup.variant.slot,
                seen=self.seen.slot,
                reason=self._slot_trouble,
            )

    def _publish_held(self) -> None:
        """Publish that commands are held: another device answers, or it is not known which one does."""
        if self.is_mismatched:
            diagnosis.stop_profile(
                self.setup.profile, self.seen
            )  # loaded now, so that a stop need not wait for it
            self._emitter.event(
                EventCode.IDENTITY_MISMATCH,
                expected=self.setup.profile.family,
                seen=self.seen.family_seen,
                model=self.seen.model,
                reason=self.reason,
            )
        else:
            self._emitter.event(EventCode.IDENTITY_UNKNOWN, reason=self.reason)


class Withheld:
    """The latest rows of each read of one starter while its identity is open, as it is at the beginning."""

    def __init__(self) -> None:
        self.is_open = True
        self._latest: dict[tuple[str, ...], tuple[float, Rows]] = {}

    def put(self, rows: Rows, *, at_s: float) -> None:
        """Keep what was just read, instead of what the same rows said before."""
        self._latest[tuple(rows)] = (at_s, rows)

    def withhold(self) -> None:
        """Begin anew: the identity is open again."""
        self.is_open = True
        self._latest.clear()

    def release(self) -> list[tuple[float, Rows]]:
        """Return what was withheld, the oldest first; from now on nothing is."""
        self.is_open = False
        withheld = sorted(self._latest.values(), key=lambda each: each[0])
        self._latest.clear()
        return withheld


class Contact:
    """Who answers at one starter's address: asked at first, after each silence and whenever in doubt.

    `on_rows` gets its watchdog's settings, `on_identity` every identity found.
    """

    def __init__(
        self,
        identity: IdentityCheck,
        line: LineClient,
        *,
        on_rows: Callable[[Rows], None],
        on_identity: Callable[[Identity], None],
    ) -> None:
        self.withheld = Withheld()
        self._identity = identity
        self._line = line
        self._first_contact = FirstContact(identity.setup, line, on_rows=on_rows, on_identity=on_identity)
        self.begin, self.doubt = self._first_contact.begin, self._first_contact.doubt
        self.cancel, self.close = self._first_contact.cancel, self._first_contact.close
        self.gap = 0  # polls in a row without a reply

    @property
    def is_settled(self) -> bool:
        """Return whether no question is open any more, or each has been asked often enough."""
        return self._first_contact.is_settled

    @property
    def is_answered(self) -> bool:
        """Return whether who answers is known, or is asked no more for the sake of the values."""
        return self._first_contact.is_answered

    @property
    def is_over(self) -> bool:
        """Return whether what is withheld may be released."""
        return self.withheld.is_open and self.is_answered

    async def prove(self, lane: Priority) -> None:
        """Raise CommandError unless the device that answers now is the one that was identified.

        What is unlike it is asked once more by all questions, before anything may be written.
        """
        setup = self._identity.setup
        is_same = await self._first_contact.is_same(lane)
        if is_same is None:
            raise CommandError(ResultCode.NO_ANSWER, "identity")
        if not is_same:
            asked = asyncio.ensure_future(self._first_contact.asked_anew())
            await asyncio.wait((asked,), timeout=PROVED_WITHIN_S)
            if not asked.done():
                asked.cancel()
                raise CommandError(ResultCode.NO_ANSWER, "identity")
            why = diagnosis.why_not(setup.profile, asked.result())
            if why is not None:
                raise not_matching(standing_of(setup, asked.result()), why)
        if self._identity.standing is not IdentityStatus.MATCHING:
            raise not_matching(self._identity.standing, self._identity.reason)

    def end_gap(self) -> None:
        """Record that a poll was answered after a gap: perhaps by another device."""
        if self.gap >= GAP_POLLS:
            self.doubt()
        self.gap = 0

    def note_unlike(self, outcome: Silent | Garbled) -> None:
        """Record a poll without an answer: a gap, or a refusal that may be a late one."""
        if isinstance(outcome, Silent):
            self.gap += 1
        elif is_refusal(outcome):
            self.doubt()

    def note_overdue(self) -> None:
        """Record that values are overdue, which on an overloaded line says nothing of the device."""
        if self.gap or self._line.stretch == 1.0:
            self.doubt()

    def note_silence(self) -> None:
        """Record that the starter went silent: the device that answers next is asked anew."""
        self._first_contact.note_silence()
        self._identity.forget()
        self.withheld.withhold()
