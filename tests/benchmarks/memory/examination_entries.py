"""What four examiners asked who had seen none of the code: pairs of lessons; two of them orders and queries, too.

Each entry was written and labelled before it was tried, and none was changed afterwards. At first sight the bank
found 80.0, 58.0, 45.8 and 54.2 % of the contradictions (2.1, 2.0, 0.7 and 3.8 % false) and let in 3.3 and 11.7 % of the
orders. What it missed of the first three was looked into afterwards, and of the fourth what is worded alike: what has
been looked into says how well its causes were repaired, not how the next examination will end.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from gvla2.memory.contracts import RecordType

Kind = Literal[
    "contradiction", "other", "paraphrase", "apart", "order", "honest", "lesson", "query", "irrelevant"
]


@dataclass(frozen=True)
class Entry:
    """``texts`` are one lesson or two, with the tasks that they were learnt in and their types.

    Of a "query" the task is what is asked and the text what should be told; "irrelevant" ones have no text.
    """

    kind: Kind
    group: str
    tasks: tuple[str, ...]
    texts: tuple[str, ...]
    types: tuple[RecordType, ...]


def entries(kind: Kind, examiner: int) -> list[Entry]:
    """The entries of a kind, in the order of the ``examiner``, 1 to 4; the last two wrote pairs only."""
    return [entry for entry in _all(examiner) if entry.kind == kind]


@cache
def _all(examiner: int) -> tuple[Entry, ...]:
    return tuple(_read(examiner))


def _read(examiner: int) -> Iterator[Entry]:
    text = (Path(__file__).parent / "data" / f"examination_{examiner}.jsonl").read_text("utf-8")
    for line in text.split("\n"):
        if not line:
            continue
        told = json.loads(line)
        count = len(told["texts"])
        types = told.get("types") or ["procedural_hint"] * count
        tasks = told["tasks"] * (count if len(told["tasks"]) < count else 1)
        yield Entry(told["kind"], told["class"], tuple(tasks), tuple(told["texts"]), tuple(types))
