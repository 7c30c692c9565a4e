"""The KnowledgeBank on a real database: admission, merging, credit, recall; interrupts, odd text, mistakes."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import ConfigurationError
from gvla2.memory import KnowledgeBank, Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.admission import pooled_effects
from gvla2.memory.learning import MAX_LESSONS

Open = Callable[..., Any]
BOUND = {"kind": "bound", "parameter": "grasp_depth", "value": 0.03, "op": ">=", "sd": 0.0, "count": 0,
         "skill": "pick", "source": ""}  # fmt: skip
AVOID = Lesson("failure_avoidance", "Pick up a small box: failed because the object slipped.", BOUND)
TOOL = Lesson("tool_usage", "Pick up a small box: ask for the wrist camera first.")


def prior(value: float, count: int = 1, sd: float = 0.0) -> dict[str, Any]:
    return {"kind": "prior", "parameter": "grasp_depth", "value": value, "sd": sd, "count": count, "op": ">="}


def lesson(value: float = 0.02) -> Lesson:
    return Lesson("procedural_hint", "Pick up a small box: this grasp depth succeeded.", prior(value))


def test_an_empty_bank_abstains(open_bank: Open) -> None:
    context = open_bank().recall(MemoryTask("Pick up the red cube"))
    assert not context.items
    assert context.text == ""
    assert "no verified knowledge" in context.abstained
    assert context.degraded == ""


def test_a_verified_hint_is_recalled_with_its_effect(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    learned = bank.learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    context = bank.recall(MemoryTask("lift the red cube, please"))
    (item,) = context.items
    assert learned.added == (item.id,)
    assert item.effect is not None
    assert item.effect["value"] == 0.02
    assert not item.binding
    assert item.confidence == pytest.approx(verdicts["success"].confidence)
    assert item.score == pytest.approx(sum(item.terms.values()))
    assert item.id in context.text


@pytest.mark.parametrize(
    ("learned", "asked"),
    [
        ("Nimm den roten Würfel hoch", "Heb den roten Würfel an"),
        ("拿起红色方块", "请拿起红色方块"),
        ("Возьми красный кубик", "Подними красный кубик"),
        ("赤い立方体を持ち上げて", "赤い立方体を取って"),
        ("ارفع المكعب الأحمر", "ارفع المكعب الأزرق"),
    ],
)
def test_recall_works_in_any_language(
    open_bank: Open, episode: Open, verdicts: Any, learned: str, asked: str
) -> None:
    bank = open_bank()
    bank.learn(episode(learned, Lesson("procedural_hint", "θ")), verdicts["success"])
    bank.learn(
        episode("Push the tray", Lesson("procedural_hint", "slide it"), skill="push"), verdicts["success"]
    )
    items = bank.recall(MemoryTask(asked)).items
    assert [i.content for i in items] == ["θ"]


def test_a_failure_becomes_a_binding_constraint_and_never_a_recipe(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank()
    learned = bank.learn(episode("Pick up the red cube", lesson(), AVOID), verdicts["fail"])
    (item,) = bank.recall(MemoryTask("Pick up the red cube")).items
    assert item.binding
    assert item.type == "failure_avoidance"
    assert learned.discarded == 1
    assert any("recipe" in note for note in learned.notes)
    assert {r.type for r in bank.records()} == {"failure_avoidance"}


@pytest.mark.parametrize("outcome", ["uncertain", "unavailable"])
def test_what_is_not_verified_stays_provisional_and_unseen(
    open_bank: Open, episode: Open, verdicts: Any, outcome: str
) -> None:
    bank = open_bank(admission=True)
    learned = bank.learn(episode("Pick up the red cube", lesson(), AVOID, TOOL), verdicts[outcome])
    assert len(learned.provisional) == 3
    assert not learned.added
    assert not bank.recall(MemoryTask("Pick up the red cube")).items
    assert {r.state for r in bank.records()} == {"provisional"}


def test_a_provisional_record_is_promoted_by_a_verified_repeat(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank(admission=True)
    (first,) = bank.learn(episode("Pick up the red cube", lesson(0.5)), verdicts["uncertain"]).provisional
    learned = bank.learn(episode("Pick up the red cube", lesson(0.02)), verdicts["success"])
    assert learned.merged == (first,)
    (record,) = bank.records(["active"])
    assert (record.outcome, record.count) == ("verified_success", 1)
    assert record.effect_json()["value"] == 0.02  # unverified numbers are not pooled in
    again = bank.learn(episode("Pick up the red cube", lesson(0.9)), verdicts["unavailable"])
    assert again.discarded == 1
    assert bank.records()[0].effect_json()["value"] == 0.02


def test_repeats_merge_counts_priors_confidence_and_phrasings(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank()
    values = [0.020, 0.024, 0.028, 0.021]
    for i, value in enumerate(values):
        learned = bank.learn(
            episode(f"Pick up the {['red', 'blue'][i % 2]} cube", lesson(value), source=f"run/{i}"),
            verdicts["success"],
        )
        assert len(learned.added) == (i == 0)
        assert len(learned.merged) == (i > 0)
    (record,) = bank.records()
    effect = record.effect_json()
    assert record.count == effect["count"] == 4
    assert effect["value"] == pytest.approx(np.mean(values))
    assert effect["sd"] == pytest.approx(np.std(values, ddof=1))
    assert record.query.split("\n") == ["Pick up the red cube", "Pick up the blue cube"]
    assert json.loads(record.provenance)["sources"] == [f"run/{i}" for i in range(4)]
    before = record.confidence
    bank.learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    assert bank.records()[0].confidence == pytest.approx(before)  # as sure as each of them was


def test_case_and_spacing_make_no_new_lesson(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    for words in ("Keep the wrist level", "keep  the WRIST\nlevel"):
        bank.learn(episode("Pour", Lesson("procedural_hint", words), skill=""), verdicts["success"])
    assert [r.count for r in bank.records()] == [2]


def test_the_tighter_of_two_bounds_holds(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    for value in (0.03, 0.05, 0.04):
        failure = Lesson(AVOID.type, AVOID.content, {**BOUND, "value": value})
        bank.learn(episode("Pick up the red cube", failure), verdicts["fail"])
    assert [r.effect_json()["value"] for r in bank.records()] == [0.05]


def test_usage_is_credited_after_a_verified_success_alone(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank()
    bank.learn(episode("Pick up the red cube", lesson()), verdicts["success"])
    context = bank.recall(MemoryTask("Pick up the red cube"))
    assert bank.records()[0].usage == 0
    for outcome, usage, recalled in (
        ("uncertain", 0, 0),
        ("unavailable", 0, 0),
        ("fail", 0, 1),
        ("success", 1, 2),
    ):
        bank.learn(episode("Pick up the red cube", TOOL, recalled=context), verdicts[outcome])
        (record,) = [r for r in bank.records() if r.type == "procedural_hint"]
        assert (record.usage, record.recalled) == (usage, recalled)
    credited = bank.recall(MemoryTask("Pick up the red cube")).items
    assert credited[0].terms["usage"] == pytest.approx(math.log(2) / 8)


def test_switches(open_bank: Open, episode: Open, verdicts: Any) -> None:
    frozen = open_bank(frozen=True)
    assert "frozen" in frozen.learn(episode(), verdicts["success"]).notes[0]
    assert not frozen.records()
    assert not open_bank(failures=False).learn(episode("q", AVOID), verdicts["fail"]).added
    assert open_bank(admission=False).learn(episode("q", lesson()), verdicts["uncertain"]).added
    many = [Lesson("tool_usage", f"lesson {i}") for i in range(MAX_LESSONS + 5)]
    capped = open_bank().learn(episode("q", *many), verdicts["success"])
    assert (len(capped.added), capped.discarded) == (MAX_LESSONS, 5)


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


WAY = "$ sort -o names.txt names.txt"


def test_the_package_loads_nothing_until_it_is_used(tmp_path: Path) -> None:
    heavy = "{'numpy', 'sqlalchemy', 'hydra', 'torch', 'scipy', 'trimesh', 'numba'}"
    code = f"import sys, gvla2.memory; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    bank = "from gvla2.memory import KnowledgeBank; KnowledgeBank(sys.argv[1]).recall('x')"
    heavy = "{'hydra', 'torch', 'scipy', 'trimesh', 'numba', 'sqlmodel', 'pydantic'}"
    code = f"import sys; {bank}; print({heavy} & set(sys.modules))"
    path = str(tmp_path / "m.db")
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_recall_learn_and_credit(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        assert bank.recall("sort a file").text == ""
        (id,) = bank.learn("sort a file", WAY, success=True).added
        context = bank.recall("sort the lines of a file")
        assert "sort -o names.txt" in context.text
        again = bank.learn("sort the lines of a file", WAY, success=True, recalled=context)
        assert not again.degraded
        assert next(record.usage for record in bank.records() if record.id == id) == 1
    with KnowledgeBank(str(tmp_path / "memory.db")) as bank:
        assert bank.recall("sort a file").items


def test_mistakes_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Not a database address"):
        KnowledgeBank(":memory:")
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        episode = MemoryEpisode(MemoryTask("x"), (Lesson("tool_usage", "Hold it."),))
        with pytest.raises(TypeError, match="needs its Verdict"):
            bank.learn(episode)  # type: ignore[call-overload]
        assert bank.learn(episode, Verdict.from_criteria({"done": 1.0})).added
