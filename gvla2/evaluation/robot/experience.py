"""What exploration leaves: episodes as memory is told of them, so that every arm learns from the very same ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gvla2.lessons import memory_episode
from gvla2.memory.contracts import Lesson, Memory, MemoryEpisode, MemoryTask, Verdict
from gvla2.record.contents import EpisodeRecord


@dataclass(frozen=True)
class Experience:
    """One explored episode: what memory is told, and the robot's own verdict; nothing comes from the referee."""

    task: str
    seed: int
    episode: MemoryEpisode
    verdict: Verdict

    @classmethod
    def of(cls, record: EpisodeRecord) -> Experience | None:
        """The experience of a record; None for an episode that ended before anything could be learnt."""
        if record.verdict is None or record.scene is None:
            return None
        return cls(record.task, record.seed, memory_episode(record, record.verdict), record.verdict)

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Experience:
        """From :meth:`to_json`'s object."""
        told, judged = dict(data["episode"]), dict(data["verdict"])
        told.pop("recalled", None)
        episode = MemoryEpisode(
            **{
                **told,
                "task": MemoryTask(**told["task"]),
                "lessons": tuple(Lesson(**lesson) for lesson in told["lessons"]),
            }
        )
        verdict = Verdict(**{**judged, "reasons": tuple(judged["reasons"])})
        return cls(data["task"], data["seed"], episode, verdict)


def teach(memory: Memory, experiences: Iterable[Experience]) -> None:
    """Let a memory learn from experience, in its order."""
    for one in experiences:
        memory.learn(one.episode, one.verdict)
