"""The arms on made-up experience and the real governed memory."""

import json
from contextlib import closing
from dataclasses import replace

import pytest

from gvla2.evaluation.arms import CERTAIN, BestTheta, Experience, Frozen, Shuffled, teach
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.planning.effects import apply_effects, effect_from_json
from gvla2.plugins.registry import load_plugins

GOOD = Verdict.from_criteria({"completion": 1.0}, verifier="test")
BAD = Verdict.from_criteria({"completion": 0.0}, verifier="test")


def experience(
    seed: int, depth: float, verdict: Verdict, skill: str = "pick", query: str = "lift the red cube"
):
    kind = {"kind": "prior", "count": 1} if verdict is GOOD else {"kind": "bound", "op": ">="}
    effect = {**kind, "parameter": "grasp_depth", "value": depth, "skill": skill}
    lesson = Lesson(
        "procedural_hint" if verdict is GOOD else "failure_avoidance",
        f"{skill} a small box: this grasp depth {'succeeded' if verdict is GOOD else 'failed'}.",
        effect_from_json(effect).to_json(),
    )
    task = MemoryTask(query, {"objects": 2.0}, skill, ("red cube box",))
    return Experience(skill, seed, MemoryEpisode(task, (lesson,), source=f"{skill}-{seed}"), verdict)


def test_experience_survives_json():
    one = experience(3, 0.02, GOOD)
    assert Experience.from_json(json.loads(json.dumps(one.to_json()))) == one


def test_the_best_theta_is_the_mean_of_what_succeeded_and_replaces_the_default():
    program = {
        "kind": "program",
        "skill": "pick",
        "language": "calls",
        "roles": {"theme": "red cube box"},
        "steps": ["pick({theme})"],
    }
    shown = experience(3, 0.5, GOOD)
    shown = replace(
        shown, episode=replace(shown.episode, lessons=(Lesson("procedural_hint", "What was done.", program),))
    )
    arm = BestTheta([experience(0, 0.02, GOOD), experience(1, 0.04, GOOD), experience(2, 0.9, BAD), shown])
    context = arm.recall(MemoryTask("lift the red cube"))
    (item,) = context.items
    effect = effect_from_json(item.effect, source=item.id)
    assert (effect.value, effect.count) == (pytest.approx(0.03), CERTAIN)
    theta, _ = apply_effects({"grasp_depth": 0.01}, [effect], "pick")
    assert theta["grasp_depth"] == pytest.approx(0.03, rel=1e-4)
    assert arm.learn(experience(0, 0.02, GOOD).episode, GOOD).added == ()
    empty = BestTheta([experience(2, 0.9, BAD)]).recall(MemoryTask("lift the red cube"))
    assert empty.items == ()
    assert empty.abstained


def test_a_frozen_memory_recalls_and_learns_nothing_and_a_shuffled_one_recalls_for_another(tmp_path):
    root = {
        "memory": {"name": "governed", "url": f"sqlite:///{tmp_path / 'bank.db'}"},
        "retriever": "hybrid",
        "embedder": "static",
        "verifier": "geometric",
        "inducer": "rules",
        "judge": "none",
    }
    pressing = MemoryTask("switch the lamp on", {"objects": 1.0}, "press")
    with closing(load_plugins().build(root, "memory")) as memory:
        teach(memory, [experience(seed, 0.02, GOOD) for seed in range(3)])
        teach(memory, [experience(9, 0.01, GOOD, "press", "switch the lamp on")])
        frozen, shuffled = Frozen(memory), Shuffled(memory, pressing)
        asked = MemoryTask("lift the red cube", {"objects": 2.0})
        before = frozen.recall(asked)
        assert any("pick" in item.content for item in before.items)
        learned = frozen.learn(experience(7, 0.05, GOOD).episode, GOOD)
        assert not learned.added
        assert not learned.merged
        assert frozen.recall(asked).text == before.text
        assert any("press" in item.content for item in shuffled.recall(asked).items)
        nothing = Shuffled(memory, None).recall(asked)
        assert not nothing.items
        assert nothing.abstained
