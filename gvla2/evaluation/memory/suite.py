"""The memory suite: all tests in the order of the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory import evidence
from gvla2.evaluation.memory.figure import FigureRow, Test
from gvla2.evaluation.memory.poison import TOP, VERDICTS, poison
from gvla2.evaluation.memory.retrieval import recall_times, start
from gvla2.evaluation.memory.upkeep import consolidation, governance
from gvla2.evaluation.memory.writing import admits, puts

SUITE = "memory"
VERSION = 1
"""Version of the tests: rows of another version are measured again."""

_RECALL = FigureRow("retrieval_p95", "Recall, end to end, p95", "ms", "lower", 2.0, 3)
_START = FigureRow("start", "Start of a bank within its budget", "s", "lower", 1.0, 3)
_STORE = (
    FigureRow("puts_single", "Store alone, one by one", "/s", "higher", 1300.0, 0),
    FigureRow("puts_batched", "Store alone, in batches", "/s", "higher", 8000.0, 0),
    FigureRow("rev", "Checking the store for changes", "us", "lower", 40.0, 1),
    FigureRow("verify", "Verifying a whole bank", "s", "lower", None, 2),
)
_SINGLE = FigureRow("admits_single", "Durable admits", "/s", "higher", 1000.0, 0)
_BATCHED = FigureRow("admits_batched", "Durable admits", "/s", "higher", 5000.0, 0)
_POISON = (
    FigureRow("poison_hit", f"Poison among the first {TOP}", "%", "lower", 0.0, 1),
    FigureRow("poison_collateral", "Sound records displaced by poison", "%", "lower", 0.0, 1),
)
_PROMISED = ("unverified", "verifier fooled")
"""The poison that the bank promises to keep out; any other has no goal."""
_CONSOLIDATION = FigureRow("consolidation", "One candidate among all, p95", "ms", "lower", 20.0, 1)
_GOVERNANCE = FigureRow("governance", "A pass of governance", "s", "lower", 0.1, 3)
_FOUND = f"Evidence found through the bank, recall@{evidence.TOP}"
_EVIDENCE = FigureRow("evidence", _FOUND, "share", "higher", 0.63, 3)

TESTS = (
    Test("retrieval", (_RECALL,), recall_times, 1_000, least=50),
    Test("retrieval", (replace(_RECALL, goal=5.0),), recall_times, 10_000, least=100),
    Test("retrieval", (replace(_RECALL, goal=40.0),), recall_times, 100_000, least=200),
    Test("start", (_START,), start, 10_000, least=200),
    Test("admits", (_SINGLE,), admits, 2000, least=30, on="one by one"),
    Test("admits", (_BATCHED,), admits, 10_000, least=60, on="in batches"),
    Test("store", _STORE, puts, 2000, least=30),
    *(
        Test(
            "poison",
            _POISON if on in _PROMISED else tuple(replace(row, goal=None) for row in _POISON),
            poison,
            1000,
            least=50,
            on=on,
        )
        for on in VERDICTS
    ),
    Test("consolidation", (_CONSOLIDATION,), consolidation, 10_000, least=100),
    Test("governance", (_GOVERNANCE,), governance, 1_000, least=40),
    Test("governance", (replace(_GOVERNANCE, goal=5.0),), governance, 100_000, least=300),
    # Their size is that of the file.
    Test("quality", (_EVIDENCE,), evidence.evidence, 1, least=1, on="static"),
    Test("quality", (replace(_EVIDENCE, goal=0.66),), evidence.evidence, 1, least=1, on="minilm"),
)
"""Every test."""


def chosen_tests(names: Sequence[str]) -> list[Test]:
    """The tests with these names or with rows of these names; all if none are given.

    Raises :class:`~gvla2.errors.ConfigurationError` for a name that is neither.
    """
    own = [(test, {test.name: None, **{row.name: None for row in test.rows}}) for test in TESTS]
    known = {name: None for _, own_names in own for name in own_names}
    for name in names:
        if name not in known:
            raise ConfigurationError(f"No test '{name}'. Available: {', '.join(known)}.")
    return [test for test, own_names in own if not names or own_names.keys() & set(names)]
