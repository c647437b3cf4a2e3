"""In which form a read is sent: as it is asked for, or by an alternate; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from gateway.line.rtu.late_replies import LateReplies
from gateway.line.rtu.request import EncodedRequest
from gateway.modbus.pdu import Request

# A read that says what another does, by a reply of another length; and what takes the other's value from it.
Alternate = tuple[Request, Callable[[Any], Any]]
Alternates = Callable[[Request], tuple[Alternate, ...]]


class Forms:
    """The forms in which the units of one line are read."""

    def __init__(self, late: LateReplies) -> None:
        self.late = late
        self._known: dict[tuple[int, Request], list[EncodedRequest]] = {}  # the request itself comes first

    def choose(
        self,
        prepared: EncodedRequest,
        alternates: Alternates,
        now_s: float,
        *,
        is_decisive: bool = True,
        is_patient: bool = False,
    ) -> EncodedRequest | None:
        """Return in which form this may be sent now; None when not yet. Flags as `LateReplies.choose`."""
        request = prepared.request
        if request.is_write:
            return prepared
        if self.late.is_calm(prepared.unit, now_s):
            return prepared
        forms = self._forms_of(prepared, alternates)
        chosen = self.late.choose(
            prepared.unit,
            request,
            [form.shape for form in forms],
            now_s,
            is_decisive=is_decisive,
            is_patient=is_patient,
        )
        if chosen is None:
            return None
        form = forms[chosen.at]
        return form if chosen.times == 1 else replace(form, times=chosen.times)

    def give_up(self, form: EncodedRequest) -> None:
        """Send an alternate no more, which its unit refused."""
        forms = self._known.get((form.unit, form.asked), [])
        self._known[form.unit, form.asked] = [each for each in forms if each.request != form.request]

    def forget(self, unit: int) -> None:
        """Know nothing of a unit's forms any more: it is another one now."""
        self.late.forget(unit)
        self._known = {key: forms for key, forms in self._known.items() if key[0] != unit}

    def _forms_of(self, prepared: EncodedRequest, alternates: Alternates) -> list[EncodedRequest]:
        key = (prepared.unit, prepared.request)
        forms = self._known.get(key)
        if forms is None:
            others = alternates(prepared.request)
            forms = self._known[key] = [
                prepared,
                *(
                    EncodedRequest.of(prepared.unit, each, asked=prepared.request, cut=cut)
                    for each, cut in others
                ),
            ]
        return forms
