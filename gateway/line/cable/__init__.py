"""The health of a line's cable, in words: what the pattern of errors along the line says of it; pure.

Start reading at `health.py`; `counts.py` is its memory, `diagnosis.py` its judgement.
"""

from gateway.line.cable.diagnosis import WiredStarter
from gateway.line.cable.health import CableHealth
