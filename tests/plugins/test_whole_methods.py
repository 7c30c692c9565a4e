"""The memories that the governed one is compared with: each does what its paper says, and none is crippled."""

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import Inducer, Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.induction import RulesInducer
from gvla2.memory.rendering import CLOSING, OPENING
from gvla2.memory.store import Store
from gvla2_plugins import memory_baselines
from tests.memory.looking import look

METHODS = {component.name: component for component in memory_baselines.gvla2_memories()}
GOOD = Verdict.from_criteria({"done": 1.0})
BAD = Verdict.from_criteria({"done": 0.0})
OPEN = Verdict.from_criteria({"done": 0.5})
EFFECT = {"kind": "prior", "parameter": "grasp_depth", "value": 0.02, "op": ">=", "sd": 0.0, "count": 1,
          "skill": "pick", "source": ""}  # fmt: skip
BOUND = EFFECT | {"kind": "bound", "parameter": "lift_height", "value": 0.1}
WALK = "Executed:\n- 0 approach: 3 mm off\n- 1 close: 1 mm off\n- 2 lift: 1 mm off\n"


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'memory.db'}"


@pytest.fixture
def build(url: str):
    made = []

    def build_(name: str, inducer: Inducer | None = None, **options: Any):
        component = METHODS[name]
        config = component.config(**{"name": name, "url": url, "busy_seconds": 0.2, **options})
        helpers = {"embedder": StaticEmbedder(), "inducer": inducer}
        made.append(component.build(config, **{need: helpers[need] for need in component.needs}))
        return made[-1]

    yield build_
    for memory in made:
        memory.close()


def episode(
    query: str = "lift the red cube", *lessons: Lesson, transcript: str = WALK, source: str = "run/1"
):
    given = lessons or (Lesson("procedural_hint", "Lift a small box: this grasp depth succeeded.", EFFECT),)
    return MemoryEpisode(MemoryTask(query, "pick"), given, transcript, source=source)


@pytest.mark.parametrize("name", METHODS)
def test_what_was_learned_survives_a_restart_in_a_bank_of_its_own(name: str, build: Callable, url: str):
    memory = build(name)
    learned = memory.learn(episode(), GOOD)
    assert len(learned.added) == 1
    memory.close()
    context = build(name).recall(MemoryTask("lift a blue cube"))
    assert context.items[0].id == learned.added[0]
    assert context.text.startswith(OPENING)
    assert context.text.endswith(CLOSING)
    with Store.open(url) as store:
        assert store.banks() == [name]
        assert look(store, name).verify() == []


@pytest.mark.parametrize("name", METHODS)
def test_the_numbers_of_a_success_reach_the_planner(name: str, build: Callable):
    memory = build(name)
    memory.learn(episode(), GOOD)
    effects = [item.effect for item in memory.recall(MemoryTask("lift the red cube")).items if item.effect]
    assert effects == [EFFECT]


@pytest.mark.parametrize("name", METHODS)
def test_a_database_that_fails_is_reported_and_stops_nothing(name: str, build: Callable, tmp_path: Path):
    memory = build(name)
    memory.learn(episode(), GOOD)
    memory.close()
    holder = sqlite3.connect(tmp_path / "memory.db", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    locked = memory.learn(episode(source="run/2"), GOOD)
    assert locked.degraded
    assert not locked.added
    holder.execute("ROLLBACK")
    holder.close()
    assert memory.learn(episode(source="run/2"), GOOD).degraded == ""
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(b"no database at all" * 100)
    broken = build(name, url=f"sqlite:///{damaged}")
    assert broken.recall(MemoryTask("lift")).degraded
    assert damaged.read_bytes() == b"no database at all" * 100


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("options", [{"top_k": 0}, {"max_chars": 10}, {"bank": ""}, {"url": "mysql://x/y"}])
def test_options_that_cannot_be_are_refused(name: str, options: dict[str, Any], build: Callable):
    with pytest.raises(ConfigurationError):
        build(name, **options)


@pytest.mark.parametrize("name", sorted(METHODS.keys() - {"constants"}))
def test_an_agents_success_without_lessons_of_its_own_is_recalled(name: str, build: Callable):
    memory = build(name, RulesInducer())  # as in the presets
    session = "$ bash bin/deposit photos\ndry run\n$ bash bin/deposit photos --commit\nstored"
    memory.learn(
        MemoryEpisode(MemoryTask("Put photos into the store"), (), transcript=session, source="1"), GOOD
    )
    assert "--commit" in memory.recall(MemoryTask("Put letters into the store")).text


# -- what tells them apart --------------------------------------------------------------------------------------


def test_semantic_keeps_everything_whatever_the_verdict(build: Callable):
    memory = build("semantic", top_k=10)
    lessons = (
        Lesson("procedural_hint", "Lift it."),
        Lesson("failure_avoidance", "Never push the cube.", BOUND),
    )
    for verdict in (GOOD, BAD, OPEN, Verdict.unavailable("nobody looked")):
        assert len(memory.learn(episode("lift the cube", *lessons), verdict).added) == 2
    items = memory.recall(MemoryTask("lift the cube")).items
    assert len(items) == 8
    assert [item.score for item in items] == sorted((item.score for item in items), reverse=True)
    assert {item.content for item in items if item.binding} == {"Never push the cube."}


def test_awm_induces_workflows_from_successes_alone(build: Callable):
    memory = build("awm")
    for verdict in (BAD, OPEN, Verdict.unavailable("nobody looked")):
        assert memory.learn(episode(), verdict).added == ()
    transcript = "$ grep -n 'bug' src/a.py\n$ sed -i 's/x/y/' src/a.py\n$ pytest tests/test_a.py -k 3\n"
    first = memory.learn(episode("fix bug 12 in src/a.py", transcript=transcript), GOOD)
    again = memory.learn(
        episode(
            "fix bug 7 in lib/b.py", transcript=transcript.replace("src/a", "lib/b").replace("x/y", "p/q")
        ),
        GOOD,
    )
    assert again.merged == first.added
    (workflow, value) = memory.recall(MemoryTask("fix bug 3")).items
    assert workflow.content == (
        "Workflow for: fix bug {number} in {path}\n1. grep -n {text} {path}\n2. sed -i {text} {path}\n"
        "3. pytest {path} -k {number}"
    )
    assert value.effect["count"] == 2
    text = memory.recall(MemoryTask("fix bug 3")).text
    assert "3. pytest" in text
    assert "(grasp_depth 0.02, sd 0, 2 times)" in text


def test_reasoning_bank_learns_from_both_outcomes_and_shows_one_task(build: Callable):
    memory = build("reasoning_bank")
    memory.learn(episode("lift the red cube"), GOOD)
    memory.learn(
        episode(
            "push the green block",
            Lesson("procedural_hint", "Push hard."),
            Lesson("failure_avoidance", "Push a block: failed because it tipped over. Push lower.", BOUND),
            source="run/2",
        ),
        BAD,
    )
    assert memory.learn(episode("press", source="run/3"), OPEN).added == ()
    (item,) = memory.recall(MemoryTask("push the blue block")).items
    assert item.content == (
        "Title: Push a block\nDescription: Push a block: failed because it tipped over.\n"
        "Content: Push a block: failed because it tipped over. Push lower."
    )
    assert item.binding
    assert item.effect == BOUND
    assert "lift_height at least 0.1" in memory.recall(MemoryTask("push the blue block")).text


def test_reasoning_bank_brings_three_items_at_most_and_can_do_without_lessons(build: Callable):
    memory = build("reasoning_bank")
    many = [Lesson("tool_usage", f"Tool number {n}: use it.") for n in range(5)]
    memory.learn(episode("a task", *many), GOOD)
    assert len(memory.recall(MemoryTask("a task")).items) == 3
    bare = MemoryEpisode(
        MemoryTask("find the bug"), (), "$ make\n$ ./run 3\nSegmentation fault\n", source="x"
    )
    memory.learn(bare, BAD)
    (item,) = memory.recall(MemoryTask("find the bug")).items
    assert item.type == "failure_avoidance"
    assert "Segmentation fault" in item.content
    assert "./run {number}" in item.content
    memory.learn(MemoryEpisode(MemoryTask("build it"), (), "$ make\n$ make test\n", source="y"), GOOD)
    (worked,) = memory.recall(MemoryTask("build it")).items
    assert worked.type == "procedural_hint"
    assert "make test" in worked.content


def test_synapse_shows_whole_trajectories_of_successes(build: Callable):
    memory = build("synapse", top_k=2)
    assert memory.learn(episode("lift the cup"), BAD).added == ()
    for number in range(3):
        memory.learn(episode(f"lift the red cube {number}", transcript=f"{WALK}- note {number}"), GOOD)
    context = memory.recall(MemoryTask("lift the red cube 1"))
    exemplars = [item for item in context.items if item.content.startswith("Task:")]
    assert exemplars[0].content == f"Task: lift the red cube 1\n{WALK}- note 1"
    assert len(exemplars) == 2
    assert "approach: 3 mm off" in context.text
    assert len(context.text) <= 12000


def test_constants_are_the_means_of_all_successes_whatever_the_task(build: Callable):
    memory = build("constants", top_k=1)

    def lifted(query: str, value: float, **of: str) -> MemoryEpisode:
        return episode(query, Lesson("procedural_hint", query, EFFECT | {"value": value} | of))

    memory.learn(lifted("lift the red cube", 0.02, object="red"), GOOD)
    memory.learn(lifted("raise the green cup", 0.04, object="green"), GOOD)
    memory.learn(lifted("lift the blue cup", 0.09), BAD)
    memory.learn(lifted("push a box", 0.5, skill="push", scale="length"), GOOD)
    for query in ("lift the red cube", "日本語"):
        effects = [dict(item.effect or {}) for item in memory.recall(MemoryTask(query)).items]
        assert sorted((e["skill"], round(e["value"], 6), e["count"], e.get("object")) for e in effects) == [
            ("pick", 0.03, 2, None),
            ("push", 0.5, 1, None),
        ]


def test_nothing_similar_is_an_abstention(build: Callable):
    memory = build("awm")
    assert memory.recall(MemoryTask("lift")).abstained
    memory.learn(episode("lift the cube"), GOOD)
    context = memory.recall(MemoryTask("日本語"))
    assert context.abstained
    assert context.items == ()
