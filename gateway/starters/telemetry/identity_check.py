"""Which device answers at a starter's address, and what that means for its commands and its values.

A device of another family gives numbers for the same registers, and a larger model the same numbers with
another scale (ssw06-es 4.4). So nothing of a starter is published as good until it has said who it is, or was
asked so often that it counts as one that does not (`first_contact`: REFUSED_ROUNDS, GIVEN_UP_ROUNDS).
What was read meanwhile is then decoded for the variant that answers.
"""

from __future__ import annotations

from collections.abc import Mapping

from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identify import stop_profile, why_not
from gateway.records import Severity
from gateway.starters.identity.first_contact import IdentityStatus, standing_of
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.emitter import Emitter


class IdentityCheck:
    """Of one starter; `seen` is what the device said about itself last."""

    def __init__(self, setup: StarterSetup, registry: IdentityRegistry, publisher: Emitter) -> None:
        self._setup = setup
        self._registry = registry
        self._publisher = publisher
        self.seen = Identity(reason="not yet asked")

    @property
    def standing(self) -> IdentityStatus:
        """Return whether the device has proved to be the configured family, as before."""
        standing = standing_of(self._setup, self.seen)
        is_held = standing is IdentityStatus.MATCHING and self._registry.trouble(self._setup.name)
        return IdentityStatus.CHANGED if is_held else standing

    @property
    def reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        return why_not(self._setup.profile, self.seen) or self._registry.trouble(self._setup.name)

    @property
    def contradiction(self) -> str:
        """Return in what the device contradicts the configuration, so that its values mean nothing."""
        if standing_of(self._setup, self.seen) is IdentityStatus.MISMATCHED:
            return why_not(self._setup.profile, self.seen) or ""
        return self._registry.contradiction(self._setup.name)

    def forget(self) -> None:
        """Begin anew: the device went silent."""
        self.seen = Identity(reason="it has not been asked since it went silent")
        self._registry.forget(self._setup.name)

    def take(self, identity: Identity, *, is_settled: bool) -> bool:
        """Record what the device said; return whether it is of the configured family.

        What holds commands is published when it is news.
        """
        before, self.seen = self.seen, identity
        if standing_of(self._setup, identity) is IdentityStatus.MATCHING:
            self._registry.note(self._setup, identity, is_settled=is_settled)
            return True
        if self.reason != why_not(self._setup.profile, before):
            self._publish_held()
        return False

    def _publish_held(self) -> None:
        """Publish that commands are held: another device answers, or it is not known which one does."""
        text = f"commands are held: {self.reason}"
        if self.standing is IdentityStatus.MISMATCHED:
            family = self._setup.profile.family
            stop_profile(self._setup.profile, self.seen)  # loaded now, so that a stop need not wait for it
            data = {"expected": family, "seen": self.seen.family_seen, "model": self.seen.model}
            self._publisher.event("identity_mismatch", Severity.ERROR, text, data)
        else:
            self._publisher.event("identity_unknown", Severity.WARNING, text)


Rows = Mapping[str, tuple[int, ...]]


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
        """Return what was kept, the oldest first; from now on nothing is withheld."""
        self.is_open = False
        kept = sorted(self._latest.values(), key=lambda each: each[0])
        self._latest.clear()
        return kept
