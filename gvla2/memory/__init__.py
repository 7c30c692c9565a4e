"""Memory: verified experience in, a few reliable records out.

    from gvla2.memory import KnowledgeBank

    with KnowledgeBank("memory.db") as bank:
        context = bank.recall("lift the cup")
        ...  # work, with context.text before the planner's eyes
        bank.learn("lift the cup", transcript, success=True, recalled=context)

Everything here is loaded on first use: ``import gvla2.memory`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank
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
_ELSEWHERE = {"KnowledgeBank": "bank", "BankOptions": "options"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ELSEWHERE.get(name, 'contracts')}"), name)
