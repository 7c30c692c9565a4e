"""The schema of `gvla2 memory`: which bank, and the verbs' options."""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass, field

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError

STATES = ("active", "provisional", "summary", "archive")
_HEAD = re.compile(r"\d{1,18}:[0-9a-f]{64}")


@dataclass
class MemoryCommandConfig:
    """A bank and what to do with it.

    ``url`` is the database, "" the default one; ``bank`` the bank in it; ``busy_seconds`` how long to wait for other
    processes. ``limit`` bounds how many rows are shown (0: all; None: 50, and all as JSON). ``states`` keeps records of
    these states in `list` and `export` (default: all). ``trusted`` imports your own backup unchanged. ``head`` is a
    head of the chain to `verify` against, SEQ:HASH. ``archived_days`` lets `compact` forget records archived for longer
    than that.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    limit: int | None = None
    states: list[str] = field(default_factory=list)
    trusted: bool = False
    head: str = ""
    archived_days: float | None = None
    retriever: ComponentConfig = field(default_factory=ComponentConfig)
    embedder: ComponentConfig = field(default_factory=ComponentConfig)
    verifier: ComponentConfig = field(default_factory=ComponentConfig)
    language: ComponentConfig = field(default_factory=ComponentConfig)

    def __post_init__(self) -> None:
        unknown = [state for state in self.states if state not in STATES]
        if unknown:
            raise ConfigurationError(f"No state '{unknown[0]}'. States: {', '.join(STATES)}.")
        if not self.bank:
            raise ConfigurationError("A bank needs a name: bank=NAME.")
        self.bank = unicodedata.normalize("NFC", self.bank)
        if self.head and not _HEAD.fullmatch(self.head):
            raise ConfigurationError(
                f"'{self.head}' is not the head of a chain: give head=SEQ:HASH as `gvla2 memory stats` has it."
            )
        if self.limit is not None and self.limit < 0:
            raise ConfigurationError(f"limit is {self.limit}; it must not be negative (0 shows all).")
        if self.archived_days is not None and not 0 <= self.archived_days < math.inf:
            raise ConfigurationError(
                f"archived_days is {self.archived_days}; it must be a finite number, and not negative."
            )
