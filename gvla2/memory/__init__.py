"""Memory: verified experience in, a few reliable records out.

    from gvla2.memory import KnowledgeBank

    with KnowledgeBank("memory.db") as bank:
        context = bank.recall("lift the cup")
        ...  # work, with context.text in the planner's prompt
        bank.learn("lift the cup", transcript, success=True, recalled=context)

The bank itself, which needs SQLAlchemy, is loaded on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.memory.contracts import (
    Evidence,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Verdict,
)
from gvla2.memory.options import BankOptions

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

__all__ = [
    "BankOptions",
    "Evidence",
    "KnowledgeBank",
    "Learned",
    "Lesson",
    "MemoryContext",
    "MemoryEpisode",
    "MemoryItem",
    "MemoryTask",
    "Verdict",
]


def __getattr__(name: str) -> object:
    if name != "KnowledgeBank":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gvla2.memory.bank import KnowledgeBank

    return KnowledgeBank
