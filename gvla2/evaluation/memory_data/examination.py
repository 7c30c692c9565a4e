"""What an examiner asked who had seen none of the code: pairs of lessons, orders to machines, queries.

Each entry was written and labelled before it was tried. Of contradictions, those that turn a choice round ("A, not B")
were looked into after the first try; a class that has been looked into says how well its causes were repaired, not how
the next examination will end.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
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


def entries(kind: Kind) -> list[Entry]:
    """The entries of a kind, in the examiner's order."""
    return [entry for entry in _all() if entry.kind == kind]


@cache
def _all() -> tuple[Entry, ...]:
    return tuple(_read())


def _read() -> Iterator[Entry]:
    text = (files("gvla2.evaluation.memory_data") / "examination.jsonl").read_text("utf-8")
    for line in text.split("\n"):
        if not line:
            continue
        told = json.loads(line)
        count = len(told["texts"])
        types = told.get("types") or ["procedural_hint"] * count
        tasks = told["tasks"] * (count if len(told["tasks"]) < count else 1)
        yield Entry(told["kind"], told["class"], tuple(tasks), tuple(told["texts"]), tuple(types))
