"""Opening a bank for a verb, and finding what its words name."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.commands.memory import MemoryCommandConfig
from gvla2.discovery import closest
from gvla2.errors import Gvla2Error, MemoryStoreError
from gvla2.memory.records import Record
from gvla2.memory.storage.addresses import settled, wrong_bank_name
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.view import BankView

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank
    from gvla2.plugins import Registry

_AGO = re.compile(r"(\d+(?:\.\d+)?)\s*(s|min|m|h|d|w)(?:\s+ago)?")
_DATE = re.compile(r"[0-9]{8}")
_SECONDS = {"s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}


SHOWN = 50
"""Rows shown by default."""


class NotFoundError(Gvla2Error):
    """A word of the command names nothing in the bank."""


class WrongWordError(Gvla2Error):
    """A word of the command cannot be what it stands for, or one is missing."""


@dataclass(frozen=True)
class VerbRequest:
    """A verb's words and flags, the configuration, and the plugins."""

    words: tuple[str, ...]
    yes: bool
    config: MemoryCommandConfig
    registry: Registry
    json: bool = False

    @property
    def limit(self) -> int:
        """How many rows to show at most, 0 for all."""
        return SHOWN if self.config.limit is None else self.config.limit

    @property
    def data_limit(self) -> int:
        """How many items the JSON document of a listing has at most, 0 for all."""
        return self.config.limit or 0

    @property
    def bank(self) -> str:
        """The bank's name."""
        return self.config.bank

    @property
    def url(self) -> str:
        """The database's address."""
        return settled(self.config.url, os.environ)


@contextmanager
def opened(request: VerbRequest, *, create: bool = False) -> Iterator[Store]:
    """The store; only ``create`` makes a database, or writes to a missing bank.

    Raises :class:`MemoryStoreError` for a database that is absent, locked or corrupt, :class:`NotFoundError` for a
    bank that is not in it.
    """
    if not create:
        _must_exist(request.url)
    with Store.open(request.url, busy_seconds=request.config.busy_seconds, create=create) as store:
        banks = store.banks()
        if request.bank not in banks and (wrong := wrong_bank_name(request.bank)):
            raise WrongWordError(wrong)
        if request.bank not in banks and not create:
            there = f"Banks: {', '.join(banks)}." if banks else "It has no banks yet."
            raise NotFoundError(
                f"No bank '{request.bank}' in {store.name}.{closest(request.bank, banks)} {there}"
            )
        yield store


@contextmanager
def opened_bank(request: VerbRequest) -> Iterator[KnowledgeBank]:
    """The bank with the chosen retriever and embedder; otherwise as :func:`opened`."""
    from gvla2.memory.bank import KnowledgeBank

    with opened(request):  # its errors come before those of components
        pass
    built = request.registry.build_all(request.config, ("retriever", "embedder"))
    with KnowledgeBank(
        request.url, bank=request.bank, busy_seconds=request.config.busy_seconds, **built
    ) as bank:
        yield bank


def _must_exist(url: str) -> None:
    scheme, _, rest = url.partition(":///")
    path = Path(rest.partition("?")[0]).expanduser()
    # Path.exists raises for names that no file system takes.
    if scheme.startswith("sqlite") and rest and not os.path.exists(path):  # noqa: PTH110
        raise MemoryStoreError(
            f"There is no memory at {path} yet: `gvla2 run` and `gvla2 memory import` make one; url= names another."
        )


def record_of(view: BankView, word: str, *, whole: bool = False) -> Record:
    """The record of that id, or (unless ``whole``) of the one id with that prefix.

    Raises :class:`NotFoundError` with the nearest.
    """
    bank = view.bank
    if found := view.get(word):
        return found
    if any(event.action == "forget" for event in view.history(word)):
        raise NotFoundError(f"The record '{word}' of bank '{bank}' was forgotten.")
    records = {record.id: record for record in view.records()}
    ids = list(records)
    starting = [id for id in ids if id.startswith(word)] if word else []
    if len(starting) == 1 and not whole:
        return records[starting[0]]
    if len(starting) == 1:
        raise NotFoundError(
            f"No record '{word}' in bank '{bank}'. It is a prefix of '{starting[0]}': give the whole id, or omit --yes "
            f"to be asked."
        )
    if starting:
        some = ", ".join(starting[:5]) + (f" and {len(starting) - 5} more" if len(starting) > 5 else "")
        raise NotFoundError(f"{len(starting)} ids of bank '{bank}' begin with '{word}': {some}.")
    near = get_close_matches(word, ids, n=1, cutoff=0.7)
    hint = f"Did you mean '{near[0]}'?" if near else "`gvla2 memory list` shows what is there."
    raise NotFoundError(f"No record '{word}' in bank '{bank}'. {hint}")


def time_of(words: str, now: float | None = None) -> float:
    """Seconds since the epoch of a date (ISO, local unless it names a zone), a number, or "3h", "2d" (ago).

    Eight digits are a date: 20261120.
    """
    text = words.strip()
    if ago := _AGO.fullmatch(text):
        at = (time.time() if now is None else now) - float(ago[1]) * _SECONDS[ago[2]]
        if at < 0:
            raise WrongWordError(f"'{words}' ago is before 1970, and no bank is as old as that.")
        return at
    try:
        number = float(text)
        if abs(number) < 4e11 and not _DATE.fullmatch(text):
            return number
    except ValueError:
        pass
    try:
        return datetime.fromisoformat(text).timestamp()
    except (ValueError, OverflowError) as error:
        raise WrongWordError(
            f"'{words}' is no time. Give a date such as 2026-11-20 or '2026-11-20 18:30', seconds since the epoch, "
            "or how long ago: 90min, 3h, 2d."
        ) from error
