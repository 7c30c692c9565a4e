"""Admission, merging, credit and recall of the KnowledgeBank, on a real database."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gvla2.memory.contracts import Lesson, MemoryTask
from tests.memory.picking_lessons import AVOID, BOUND, TOOL, lesson

Open = Callable[..., Any]


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
    "query",
    [
        "What is the capital of France?",
        "Bake a chocolate cake for the party",
        "Book a flight to Tokyo",
        "Wie wird das Wetter morgen in Berlin?",
        "Quelle heure est-il à Paris ?",
        "¿Dónde está la biblioteca?",
        "Сколько сейчас времени в Москве?",
        "今天天气怎么样",
        "明日の天気はどうですか",
        "Recommend a small restaurant near the station",
        "Which red wine goes with roasted venison?",
        "the of and to it",
        "",
        "!!! ???",
    ],
)
def test_an_irrelevant_query_recalls_nothing_and_says_why(
    open_bank: Open, episode: Open, verdicts: Any, query: str
) -> None:
    bank = open_bank()
    for words in ("Pick up the red cube", "Nimm den roten Würfel", "拿起红色方块", "Возьми красный кубик"):
        bank.learn(episode(words, lesson(), AVOID), verdicts["success"])
    context = bank.recall(MemoryTask(query))
    assert context.items == ()
    assert context.text == ""
    assert context.abstained


@pytest.mark.parametrize(
    ("learnt", "asked"),
    [
        ("Nimm den roten Würfel hoch", "Heb den roten Würfel an"),
        ("拿起红色方块", "请拿起红色方块"),
        ("Возьми красный кубик", "Подними красный кубик"),
        ("赤い立方体を持ち上げて", "赤い立方体を取って"),
        ("ارفع المكعب الأحمر", "ارفع المكعب الأزرق"),
    ],
)
def test_recall_works_in_any_language(
    open_bank: Open, episode: Open, verdicts: Any, learnt: str, asked: str
) -> None:
    bank = open_bank()
    bank.learn(episode(learnt, Lesson("procedural_hint", "θ")), verdicts["success"])
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
    bank = open_bank()
    learned = bank.learn(episode("Pick up the red cube", lesson(), AVOID, TOOL), verdicts[outcome])
    assert len(learned.provisional) == 3
    assert not learned.added
    assert not bank.recall(MemoryTask("Pick up the red cube")).items
    assert {r.state for r in bank.records()} == {"provisional"}


def test_a_provisional_record_is_promoted_by_a_verified_repeat(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank()
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


def test_case_width_and_spacing_make_no_new_lesson(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    for words in ("Keep the wrist level", "keep  the WRIST\nlevel", "ｋｅｅｐ the wrist level"):
        bank.learn(episode("Pour", Lesson("procedural_hint", words), skill=""), verdicts["success"])
    assert [r.count for r in bank.records()] == [3]


def test_the_tighter_of_two_bounds_holds(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    for value in (0.03, 0.05, 0.04):
        failure = Lesson(AVOID.type, AVOID.content, {**BOUND, "value": value})
        bank.learn(episode("Pick up the red cube", failure), verdicts["fail"])
    assert [r.effect_json()["value"] for r in bank.records()] == [0.05]


def test_equal_lessons_of_one_episode_count_once(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    learned = bank.learn(episode("Pick up the red cube", lesson(), lesson()), verdicts["success"])
    assert (len(learned.added), learned.discarded) == (1, 1)
    assert bank.records()[0].count == 1


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
