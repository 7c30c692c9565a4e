"""A memory that opens its database on first use, and whose faults stop no run."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import Learned, Lesson, Memory, MemoryContext, MemoryEpisode, MemoryTask, Verdict


@dataclass(kw_only=True)
class StoreOptions:
    """Where a memory is kept.

    ``url`` is ``sqlite:///path`` or ``postgresql://…``; "" is ``memory.db`` in ``$GVLA2_HOME``, else in
    ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``. ``bank`` names the bank in it. ``busy_seconds`` is how
    long to wait for other processes.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0


class LateMemory:
    """A :class:`~gvla2.memory.contracts.Memory` that is opened on first use and answers "degraded" if it raises.

    ``opened`` makes it at an address. An invalid address or name of a bank raises
    :class:`~gvla2.errors.ConfigurationError` immediately; an unavailable database is tried again at the next call.
    """

    def __init__(self, options: StoreOptions, opened: Callable[[str], Memory]) -> None:
        from gvla2.memory.store import check_bank, resolved_address

        # Absolute from the start: a run may change its working directory later.
        self.url = resolved_address(options.url, os.environ)
        check_bank(options.bank)
        self._make, self._memory = opened, list[Memory]()

    def recall(self, task: MemoryTask) -> MemoryContext:
        """Knowledge for the task; an empty context that says why when the store cannot be used."""
        try:
            return self._opened().recall(task)
        except Gvla2Error as error:
            return MemoryContext(degraded=str(error))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the episode teaches, all of it or nothing; says why when the store cannot be used."""
        try:
            return self._opened().learn(episode, verdict)
        except Gvla2Error as error:
            return Learned(degraded=str(error))

    def admit(self, lesson: Lesson, verdict: Verdict, *, task: MemoryTask, source: str) -> Learned:
        """A lesson from outside: admitted as such by a memory that can, an episode for any other."""
        try:
            memory = self._opened()
            admit: Callable[..., Learned] | None = getattr(memory, "admit", None)
            if admit is not None:
                return admit(lesson, verdict, task=task, source=source)
            return memory.learn(MemoryEpisode(task, (lesson,), source=source), verdict)
        except Gvla2Error as error:
            return Learned(degraded=str(error))

    def close(self) -> None:
        """Release the database; safe to call twice."""
        for memory in self._memory:
            memory.close()
        self._memory.clear()

    def _opened(self) -> Memory:
        if not self._memory:
            self._memory.append(self._make(self.url))
        return self._memory[0]
