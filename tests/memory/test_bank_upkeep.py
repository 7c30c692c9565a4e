"""The KnowledgeBank over time and in trouble: staleness, several banks, interrupts, odd text, damage."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.admission import pooled_effects
from gvla2.memory.contracts import Lesson, MemoryTask
from gvla2.memory.transaction import Transaction
from tests.memory.picking_lessons import AVOID, TOOL, lesson, prior

Open = Callable[..., Any]


def test_banks_in_one_database_do_not_meet(open_bank: Open, episode: Open, verdicts: Any) -> None:
    open_bank("a").learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    assert not open_bank("b").recall(MemoryTask("Pick up the red cube")).items
    open_bank("b").learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    assert open_bank("a").records()[0].id != open_bank("b").records()[0].id


def test_switches(open_bank: Open, episode: Open, verdicts: Any) -> None:
    frozen = open_bank(frozen=True)
    assert "frozen" in frozen.learn(episode(), verdicts["success"]).notes[0]
    assert not frozen.records()
    assert not open_bank(failures=False).learn(episode("q", AVOID), verdicts["fail"]).added
    assert open_bank(admission=False).learn(episode("q", lesson()), verdicts["uncertain"]).added
    many = [Lesson("tool_usage", f"lesson {i}") for i in range(9)]
    capped = open_bank(max_per_episode=4).learn(episode("q", *many), verdicts["success"])
    assert (len(capped.added), capped.discarded) == (4, 5)


def test_interrupting_a_transaction_stores_nothing_of_it(
    open_bank: Open, episode: Open, verdicts: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bank = open_bank()
    bank.learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    context = bank.recall(MemoryTask("Pick up the red cube"))
    before = bank.records()
    calls = []
    finish = Transaction.finish

    def stop_when_written(self: Transaction) -> None:
        finish(self)
        calls.append(1)
        raise KeyboardInterrupt

    monkeypatch.setattr(Transaction, "finish", stop_when_written)
    with pytest.raises(KeyboardInterrupt):
        bank.learn(
            episode("Pick up the red cube", lesson(), TOOL, AVOID, recalled=context), verdicts["success"]
        )
    assert calls
    assert bank.records() == before


def test_unsound_effects_and_odd_text_are_survived(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    odd = [
        Lesson("tool_usage", "nan", {"kind": "bound", "value": math.nan}),
        Lesson("tool_usage", "object", {"kind": object()}),
        Lesson("tool_usage", "   "),
        Lesson("tool_usage", "lone \ud800 surrogate and a \x00 byte"),
    ]
    learned = bank.learn(episode("lone \udfff surrogate\x00", *odd), verdicts["success"])
    assert (len(learned.added), learned.discarded) == (1, 3)
    assert bank.recall(MemoryTask("lone \ud800 surrogate")).items


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=12), st.integers(1, 11))
@settings(max_examples=50, deadline=None)
def test_pooling_does_not_depend_on_the_grouping(values: list[float], cut: int) -> None:
    cut = min(cut, len(values) - 1)

    def pooled(part: list[float]) -> dict[str, Any]:
        effect: dict[str, Any] | None = None
        for value in part:
            effect = pooled_effects(effect, prior(value))
        assert effect is not None
        return effect

    whole, parts = pooled(values), pooled_effects(pooled(values[:cut]), pooled(values[cut:]))
    assert parts is not None
    assert parts["count"] == whole["count"] == len(values)
    assert parts["value"] == pytest.approx(np.mean(values), abs=1e-9)
    assert parts["sd"] == pytest.approx(np.std(values, ddof=1), abs=1e-6)
    assert whole["sd"] == pytest.approx(np.std(values, ddof=1), abs=1e-6)
