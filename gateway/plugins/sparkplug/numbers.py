"""The numbers of births and deaths, each on the disk before its CONNECT."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, TypeAdapter

from gateway.plugins.interface import Gateway
from gateway.plugins.sparkplug.settings import SEQ_NUMBERS

BIRTHS = "births"  # the document
NUMBER = TypeAdapter(Annotated[int, Field(ge=0, lt=SEQ_NUMBERS)])


class BirthNumbers:
    """`bdSeq` of one edge node; it goes on where the last run ended."""

    def __init__(self, gateway: Gateway) -> None:
        self._document = gateway.documents.open(BIRTHS, NUMBER, lambda: self._last)
        last = self._document.loaded
        self._last = SEQ_NUMBERS - 1 if last is None else last

    async def take(self) -> int:
        """Return the number of the next connection."""
        self._last = (self._last + 1) % SEQ_NUMBERS
        self._document.touch()
        await self._document.saved()
        return self._last
