"""What was learnt from, kept so that it can be verified again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gvla2.memory.contracts import Lesson, MemoryTask, Verdict
from gvla2.memory.records import clean, dump, load_object

MAX_TEXT = 200_000


@dataclass(frozen=True)
class StoredEpisode:
    """An episode as replay needs it. ``source`` identifies it in its bank; saving it again replaces it.

    ``at`` is seconds since the epoch; ``facts`` are named JSON observations (an exit status); ``verdicts`` those
    given up to now, the first one first; ``records`` the ids of the records that it taught: forgetting one of them
    forgets the episode, too.
    """

    source: str
    at: float
    task: MemoryTask
    lessons: tuple[Lesson, ...] = ()
    transcript: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    records: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """Canonical JSON without ``source`` and ``at``; raises ``ValueError`` or ``TypeError`` for unsound facts."""
        data = asdict(self)
        del data["source"], data["at"]
        data["transcript"] = clean(self.transcript, MAX_TEXT)
        return dump(data).encode("utf-8", "replace").decode()

    @classmethod
    def from_json(cls, source: str, at: float, text: str) -> StoredEpisode:
        """The episode of :meth:`to_json`; raises ``ValueError`` for anything else."""
        data = load_object(text)
        try:
            if not math.isfinite(at):
                raise ValueError("no time")
            return cls(
                source=source,
                at=at,
                task=MemoryTask(**_frozen(data["task"])),
                lessons=tuple(Lesson(**_frozen(lesson)) for lesson in data["lessons"]),
                transcript=str(data["transcript"]),
                facts=dict(data["facts"]),
                verdicts=tuple(Verdict(**_frozen(verdict)) for verdict in data["verdicts"]),
                records=tuple(data["records"]),
                provenance=dict(data["provenance"]),
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"not an episode: {error}") from error


def _frozen(data: Mapping[str, Any]) -> dict[str, Any]:
    """Lists as the tuples that they were."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}
