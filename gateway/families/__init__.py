"""The soft-starter families as their manuals describe them: data, and pure rules over it.

Nothing outside reaches past this door. Profiles, rows and devices come by their names; the rest by six
namespaces: `command` builds writes, `diagnosis` says who answers and how it is set, `reading` plans requests,
`decode` reads replies, `parameters` finds rows by their codes, `extension` adds what a site asks for.
"""

from gateway.families import command, diagnosis, reading
from gateway.families.alternates import other_reads
from gateway.families.devices import device_of
from gateway.families.devices.device import Identity, Question, unnumbered
from gateway.families.devices.findings import Watchdog, Weight
from gateway.families.profile import decode, extension, parameters
from gateway.families.profile.arguments import to_switch
from gateway.families.profile.load import ENGLISH, FAMILIES, LANGUAGES, load_profile
from gateway.families.profile.names import meaning_of, printed_name
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Read, WriteStep
from gateway.families.profile.rows import OFF, RESERVED, Access, Alarm, Confidence, Parameter, Table, Type
from gateway.families.profile.schema import Profile, Variant, once_per_profile
from gateway.families.profile.state import STATES, state_of
from gateway.families.profile.word_types import TYPE_LIMITS, from_words
