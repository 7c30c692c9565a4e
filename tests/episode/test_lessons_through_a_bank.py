"""Lessons through a real bank, back to a planner's effects; and what is learned as a share of an object's size."""

from dataclasses import replace
from pathlib import Path

import pytest

from gvla2.episode.lessons import memory_episode, memory_task
from gvla2.episode.planning import advice_for
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import MemoryContext
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.retrieval import HybridRetriever
from gvla2.planning.contracts import Advice
from gvla2.planning.effects import apply_effects
from gvla2_plugins.hybrid import HybridConfig
from tests.picking import (
    FAIL,
    SCENE,
    SUCCESS,
    THETA,
    episode,
    sized,
)


def open_bank(tmp_path: Path, hints: int = 3) -> KnowledgeBank:
    return KnowledgeBank(
        f"sqlite:///{tmp_path / 'memory.db'}",
        retriever=HybridRetriever(HybridConfig(top_k=hints)),
        embedder=StaticEmbedder(),
    )


def advice(context: MemoryContext) -> Advice:
    """As the loop makes it."""
    return advice_for(EpisodeRecord("run/9", "", "", 9, {}, recalled=context))


def test_lessons_come_back_as_effects_that_change_the_next_plan(tmp_path: Path) -> None:
    with open_bank(tmp_path) as bank:
        for run, depth in enumerate((0.024, 0.026, 0.025)):
            success = replace(episode(theta={**THETA, "grasp_depth": depth}), episode_id=f"run/{run}")
            bank.learn(memory_episode(success, SUCCESS), SUCCESS)
        slipped = episode({4: {"held": False, "abort": "slipped"}}, theta={**THETA, "grasp_depth": 0.025})
        bank.learn(memory_episode(slipped, FAIL), FAIL)

        asked = EpisodeRecord("run/9", "Please lift the blue cube", "", 9, {}, scene=SCENE)
        context = bank.recall(memory_task(asked))
        given = advice(context)
        changed, notes = apply_effects({"grasp_depth": 0.015, "lift_height": 0.25}, given.effects, "pick")
        assert changed["grasp_depth"] == pytest.approx(0.03)  # pulled to the mean, then held to the bound
        assert len(notes) == 2
        ids = [item.id for item in context.items]
        assert any(i.startswith("avoid-") and f"from {i}" in notes[1] for i in ids)
        assert "grasp_depth at least 0.03" in given.text
        (mean,) = [e for e in given.effects if e.kind == "prior" and e.parameter == "grasp_depth"]
        assert (mean.count, mean.value, mean.sd) == (3, pytest.approx(0.025), pytest.approx(0.001))

        unrelated = EpisodeRecord("run/9", "What is the capital of France?", "", 9, {}, scene=SCENE)
        assert advice(bank.recall(memory_task(unrelated))) == Advice()


def test_recalled_records_are_credited_by_the_episode_that_used_them(tmp_path: Path) -> None:
    with open_bank(tmp_path) as bank:
        bank.learn(memory_episode(episode(), SUCCESS), SUCCESS)
        context = bank.recall(memory_task(episode()))
        used = {item.id for item in context.items}
        bank.learn(memory_episode(replace(episode(), recalled=context), SUCCESS), SUCCESS)
        assert used
        assert {record.usage for record in bank.records() if record.id in used} == {1}
        assert {record.usage for record in bank.records() if record.id not in used} <= {0}


def test_shares_transfer_to_other_sizes_through_a_bank(tmp_path: Path) -> None:
    with open_bank(tmp_path) as bank:
        slipped = sized(episode({4: {"held": False, "abort": "slipped"}}))
        bank.learn(memory_episode(slipped, FAIL), FAIL)
        asked = EpisodeRecord("run/9", "Please lift the blue cube", "", 9, {}, scene=SCENE)
        given = advice(bank.recall(memory_task(asked)))
    assert "grasp_depth at least 0.6 of the object's height" in given.text
    for height, expected in ((0.05, 0.03), (0.06, 0.036)):
        changed, _ = apply_effects({"grasp_depth": 0.01}, given.effects, "pick", lengths={"height": height})
        assert changed["grasp_depth"] == pytest.approx(expected)
