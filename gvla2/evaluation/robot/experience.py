"""The experience of exploration: episodes as reported to memory, so that every arm learns from the same ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gvla2.episode.memory_reporting import stories_of
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.contracts import Lesson, Memory, MemoryEpisode, MemoryTask, Verdict
from gvla2.skills.skill import Skill
from gvla2.skills.table import STANDARD


@dataclass(frozen=True)
class Experience:
    """A story of an explored episode: the report to memory, and the robot's own verdict, never the success check's."""

    task: str
    seed: int
    episode: MemoryEpisode
    verdict: Verdict

    @classmethod
    def of(cls, record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> tuple[Experience, ...]:
        """The experience of a record, one per attempt and part; none if all ended before anything could be learnt."""
        return tuple(
            cls(record.task, record.seed, episode, verdict) for episode, verdict in stories_of(record, skills)
        )

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Experience:
        """From :meth:`to_json`'s object."""
        told = {name: value for name, value in data["episode"].items() if name != "recalled"}
        told["task"] = MemoryTask(**_frozen(told["task"]))
        told["lessons"] = tuple(Lesson(**_frozen(lesson)) for lesson in told["lessons"])
        return cls(data["task"], data["seed"], MemoryEpisode(**told), Verdict(**_frozen(data["verdict"])))


def _frozen(data: Mapping[str, Any]) -> dict[str, Any]:
    """JSON's lists are tuples again."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


def teach(memory: Memory, experiences: Iterable[Experience]) -> None:
    """Let a memory learn from experience, in its order."""
    for one in experiences:
        memory.learn(one.episode, one.verdict)
