"""Who a starter is: states and answers (`standing`), the asking (`contact`), who was known (`registry`)."""

from gateway.starters.identity.contact import Contact, identified
from gateway.starters.identity.fingerprint import IdentityMismatch
from gateway.starters.identity.registry import FINGERPRINTS, KNOWN, IdentityRegistry, mismatch_in
from gateway.starters.identity.standing import IdentityStatus, Standing, not_matching
