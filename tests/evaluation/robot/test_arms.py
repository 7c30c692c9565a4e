"""The arms on made-up experience and the real governed memory."""

import json
from contextlib import closing

from gvla2.evaluation.arms import STORIES, Frozen, Shuffled, teach
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.planning.effects import effect_from_json
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
    task = MemoryTask(query, skill, ("red cube box",))
    return MemoryEpisode(task, (lesson,), source=f"{skill}-{seed}"), verdict


def test_experience_survives_json():
    one = (experience(3, 0.02, GOOD),)
    assert STORIES.validate_python(json.loads(json.dumps(STORIES.dump_python(one, mode="json")))) == one


def test_a_frozen_memory_recalls_and_learns_nothing_and_a_shuffled_one_recalls_for_another(tmp_path):
    root = {
        "memory": {"name": "governed", "url": f"sqlite:///{tmp_path / 'bank.db'}"},
        "retriever": "hybrid",
        "embedder": "static",
        "verifier": "geometric",
        "inducer": "rules",
        "judge": "none",
    }
    pressing = MemoryTask("switch the lamp on", "press")
    with closing(load_plugins().build(root, "memory")) as memory:
        teach(memory, [experience(seed, 0.02, GOOD) for seed in range(3)])
        teach(memory, [experience(9, 0.01, GOOD, "press", "switch the lamp on")])
        frozen, shuffled = Frozen(memory), Shuffled(memory, pressing)
        asked = MemoryTask("lift the red cube")
        before = frozen.recall(asked)
        assert any("pick" in item.content for item in before.items)
        learned = frozen.learn(*experience(7, 0.05, GOOD))
        assert not learned.added
        assert not learned.merged
        assert frozen.recall(asked).text == before.text
        assert any("press" in item.content for item in shuffled.recall(asked).items)
        nothing = Shuffled(memory, None).recall(asked)
        assert not nothing.items
        assert nothing.abstained
