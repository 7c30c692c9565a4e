"""Options of whole memory methods; light to import, so that plugins can be listed at once."""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError


@dataclass(kw_only=True)
class VectorStoreConfig(ComponentConfig):
    """Options that all of them have.

    ``url`` is a database address, "" the default one; ``bank`` names the bank in it; ``busy_seconds`` is how long to
    wait for other processes; ``top_k`` how many entries are recalled; ``frozen`` recalls and learns nothing;
    ``max_chars`` bounds the text given to a planner.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    top_k: int = 3
    frozen: bool = False
    max_chars: int = 4000

    def __post_init__(self) -> None:
        if self.top_k < 1 or self.max_chars < 200 or not self.bank:
            raise ConfigurationError(
                f"A memory needs a bank, top_k >= 1 and max_chars >= 200; got bank='{self.bank}', "
                f"top_k={self.top_k}, max_chars={self.max_chars}."
            )
