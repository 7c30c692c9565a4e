"""From episodes to lessons, and through a real bank back to a planner's effects."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gvla2.advice import advice_for, with_sound_effects
from gvla2.correspondence import correspond
from gvla2.diagnosis import approach_of, diagnose
from gvla2.lessons import handled_lengths, memory_episode, memory_task, transcript
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import MemoryContext, MemoryItem, Verdict
from gvla2.memory.retrieval.hybrid import HybridRetriever
from gvla2.memory.retrieval.static_embedding import StaticEmbedder
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention, Advice, Candidate, Plan
from gvla2.planning.effects import Effect, apply_effects
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.programs import Program, told
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.scene_brief import unique_names
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.record.contents import EpisodeRecord, Failure
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2_plugins.hybrid import HybridConfig

TABLE = 0.75
SUCCESS = Verdict.from_criteria({"task_completion": 1.0, "collision_safety": 1.0})
FAIL = Verdict.from_criteria({"task_completion": 0.0, "collision_safety": 0.2})
UNCERTAIN = Verdict.from_criteria({"task_completion": 0.5})


def thing(id_: str, x: float, y: float, colour: str, shape: Any = "box", size: float = 0.05) -> SceneObject:
    pose = np.eye(4)
    pose[:3, 3] = x, y, TABLE + size / 2
    rgb = {"red": (0.8, 0.1, 0.1), "blue": (0.1, 0.1, 0.8), "green": (0.1, 0.7, 0.2)}[colour]
    extents = np.array([size, size, 0.001 if shape == "region" else size])
    return SceneObject(id_, f"{colour} {'square' if shape == 'region' else 'cube'}", shape, colour, pose,
                       extents, np.zeros((0, 3)), np.array(rgb))  # fmt: skip


def scene(*things: SceneObject) -> Scene:
    return Scene(things, TABLE, Box(np.array([-1, -1, TABLE]), np.array([1, 1, 2.0])))


SCENE = scene(thing("a", 0.3, 0.1, "red"), thing("b", 0.3, -0.2, "blue"),
              thing("goal", 0.5, 0.1, "green", "region", 0.1))  # fmt: skip
DOWN = Orientation("grasp")
SIDE = Orientation("grasp", (1.0, 0.0, -0.1), (0.0, 1.0, 0.0))
PICK = (
    Waypoint((0.3, 0.1, 0.9), 1.0, "approach", DOWN),
    Waypoint((0.3, 0.1, 0.77), 1.0, "grasp", DOWN, allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 0.77), 0.0, "close", DOWN, allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 1.0), 0.0, "lift", DOWN, allowed_contacts=frozenset({"a"}), carries="a"),
    Waypoint((0.3, 0.1, 1.1), 0.0, "hold", DOWN, carries="a"),
)
THETA = {
    "standoff": 0.05,
    "approach_tilt": 0.0,
    "grasp_depth": 0.025,
    "lift_height": 0.25,
    "transit_clearance": 0.04,
    "speed": 0.25,
}


def reported(
    waypoints: tuple[Waypoint, ...], changes: dict[int, dict[str, Any]] | None = None
) -> ExecutionReport:
    """All waypoints up to the first abort; held once the fingers closed."""
    reports: list[WaypointReport] = []
    for i, w in enumerate(waypoints):
        report = WaypointReport(i, w.stage, w.xyz, w.xyz, 0.001, 0.05, w.gripper < 0.5)
        reports.append(replace(report, **(changes or {}).get(i, {})))
        if reports[-1].abort:
            break
    return ExecutionReport(tuple(reports), 4.0)


def episode(
    changes: dict[int, dict[str, Any]] | None = None, *, skill: str = "pick", waypoints: Any = PICK,
    instruction: str = "Pick up the red cube", roles: dict[str, str] | None = None,
    theta: dict[str, float] | None = None, **record: Any,
) -> EpisodeRecord:  # fmt: skip
    before = record.pop("scene", SCENE)
    candidates = record.pop("candidates", ())
    plan = Plan(
        Trajectory(waypoints), skill, roles or {"theme": "a"}, THETA if theta is None else theta, candidates
    )
    return EpisodeRecord(
        "run/1", instruction, "some_task", 0, {"planner": "skill"}, scene=before, plan=plan, checks=CheckReport(),
        report=reported(waypoints, changes), **record,
    )  # fmt: skip


def kinds(record: EpisodeRecord) -> list[str]:
    return [signal.kind for signal in diagnose(record)]


def effects_of(lessons: Any) -> list[Effect]:
    """The effects on parameters; programs aside."""
    told = (lesson.effect for lesson in lessons if lesson.effect)
    return [Effect.from_json(effect) for effect in told if effect["kind"] != "program"]


def test_a_task_before_the_plan_guesses_its_object_from_the_words() -> None:
    record = EpisodeRecord("run/1", "Pick up the blue cube, please.", "", 0, {}, scene=SCENE)
    task = memory_task(record)
    assert task.skill == ""
    assert task.signature == pytest.approx(
        {"objects": 2, "table_height": TABLE, "theme_length": 0.05, "theme_width": 0.05, "theme_height": 0.05}
    )
    unclear = memory_task(replace(record, instruction="Räum auf"))
    assert set(unclear.signature) == {"objects", "table_height"}
    assert memory_task(replace(record, scene=None)).signature == {}


def test_a_task_after_the_plan_knows_skill_and_object() -> None:
    task = memory_task(episode(instruction="anything"))
    assert task.skill == "pick"
    assert task.signature["theme_height"] == pytest.approx(0.05)


def test_success_gives_priors_whose_words_repeat() -> None:
    first = memory_episode(episode(), SUCCESS)
    other = episode(
        theta={**THETA, "grasp_depth": 0.021}, instruction="Grab the blue one", roles={"theme": "b"}
    )
    second = memory_episode(other, SUCCESS)
    assert [lesson.type for lesson in first.lessons] == ["procedural_hint"] * 4
    effects = effects_of(first.lessons)
    assert {(e.kind, e.parameter, e.value, e.count, e.skill) for e in effects} == {
        ("prior", "grasp_depth", 0.025, 1, "pick"),
        ("prior", "approach_tilt", 0.0, 1, "pick"),
        ("prior", "standoff", 0.05, 1, "pick"),
    }
    assert [x.content for x in first.lessons] == [x.content for x in second.lessons]
    assert "small box from the top" in first.lessons[0].content
    assert first.source == "run/1"
    assert first.provenance["planner"] == "skill"


def test_success_without_parameters_tells_the_stages() -> None:
    lesson, program = memory_episode(episode(theta={}, skill="juggle"), SUCCESS).lessons
    assert program.effect is not None
    assert program.effect["kind"] == "program"
    assert "approach, grasp, close, lift, hold" in lesson.content
    assert lesson.effect is None


def bounds(record: EpisodeRecord) -> list[tuple[str, str, str, float]]:
    lessons = memory_episode(record, FAIL).lessons
    assert all(lesson.type == "failure_avoidance" for lesson in lessons)
    found = [Effect.from_json(lesson.effect) for lesson in lessons if lesson.effect]
    return [(e.kind, e.parameter, e.op, pytest.approx(e.value, abs=1e-9)) for e in found]


def test_a_slip_asks_for_a_deeper_grasp_within_the_object() -> None:
    slipped = {4: {"held": False, "gripper_width": 0.0, "abort": "slipped", "message": "lost"}}
    assert kinds(episode(slipped)) == ["slip"]
    assert bounds(episode(slipped)) == [("bound", "grasp_depth", ">=", 0.03)]
    deep = episode(slipped, theta={**THETA, "grasp_depth": 0.048})
    assert bounds(deep) == [("bound", "grasp_depth", ">=", 0.05)]
    assert kinds(episode({4: {"held": False}})) == ["slip"]
    assert bounds(episode(slipped, theta={})) == []


def test_closing_on_nothing_is_no_slip() -> None:
    missed = episode({2: {"held": False, "gripper_width": 0.0, "abort": "slipped"}})
    assert kinds(missed) == ["missed_grasp"]
    (lesson,) = memory_episode(missed, FAIL).lessons
    assert lesson.effect is None


def test_contact_on_the_way_asks_for_more_clearance() -> None:
    touched = episode({0: {"contacts": ("panda_hand",)}})
    assert bounds(touched) == [("bound", "transit_clearance", ">=", 0.07)]
    lifting = episode({0: {"abort": "collision"}}, theta={"lift_height": 0.1})
    assert bounds(lifting) == [("bound", "lift_height", ">=", 0.13)]
    # Fingers touch what they grasp and carry.
    assert kinds(episode({i: {"contacts": ("panda_leftfinger",)} for i in (1, 2, 3, 4)})) == []


PUSH = (
    Waypoint((0.2, 0.1, 0.77), 0.0, "lower", DOWN),
    Waypoint((0.45, 0.1, 0.77), 0.0, "push", DOWN, allowed_contacts=frozenset({"a"})),
)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.56, [("bound", "push_overshoot", "<=", -0.04)]),
        (0.42, [("bound", "push_overshoot", ">=", 0.1)]),
        (0.505, []),
    ],
)
def test_a_push_is_corrected_by_its_error_along_the_way(x: float, expected: list[Any]) -> None:
    after = scene(thing("z", 0.3, -0.2, "blue"), thing("y", x, 0.12, "red"))
    record = episode(skill="push", waypoints=PUSH, roles={"theme": "a", "goal": "goal"},
                     theta={"push_overshoot": 0.02}, after_scene=after)  # fmt: skip
    assert bounds(record) == expected


def test_an_unreachable_approach_is_forbidden_only_where_another_remains() -> None:
    stuck = {0: {"abort": "unreachable", "message": "no IK"}}
    two = (Candidate("top", 1.0), Candidate("side", 0.8), Candidate("below", 0.1, "out of reach"))
    assert bounds(episode(stuck, candidates=two)) == [("forbid", "approach:top", ">=", 0.0)]
    assert bounds(episode(stuck, candidates=two[1:])) == []
    assert kinds(episode(stuck, candidates=two[1:])) == ["unreachable"]


def test_approaches_are_named_by_the_grasp() -> None:
    assert approach_of(Plan(Trajectory(PICK))) == "top"
    assert approach_of(Plan(Trajectory(tuple(replace(w, orientation=SIDE) for w in PICK)))) == "side"
    assert approach_of(Plan(Trajectory(tuple(replace(w, orientation=Orientation()) for w in PICK)))) == ""
    assert approach_of(Plan(None)) == ""


def test_an_undiagnosed_failure_teaches_words_alone() -> None:
    (lesson,) = memory_episode(episode(), FAIL).lessons
    assert lesson.type == "failure_avoidance"
    assert lesson.effect is None
    assert memory_episode(episode(), UNCERTAIN).lessons == ()
    (lesson,) = memory_episode(episode({1: {"abort": "tracking"}}), FAIL).lessons
    assert "stopped at 'grasp' (tracking)" in lesson.content


def test_nothing_executed_teaches_no_motion() -> None:
    abstained = replace(
        episode(),
        plan=Plan(None, abstention=Abstention("ambiguous", "two red cubes")),
        checks=None,
        report=None,
    )
    findings = (Finding("kinematics", False, 1, "unreachable", "too far"),)
    rejected = replace(episode(), checks=CheckReport(findings), report=None)
    for record, words in ((abstained, "ambiguous"), (rejected, "unreachable")):
        (lesson,) = memory_episode(record, UNCERTAIN).lessons
        assert lesson.type == "tool_usage"
        assert words in lesson.content
        assert lesson.effect is None
    assert memory_episode(replace(episode(), plan=None, report=None), UNCERTAIN).lessons == ()


def test_a_transcript_tells_the_episode_and_is_bounded() -> None:
    record = episode({4: {"abort": "slipped", "message": "lost", "contacts": ("panda_hand",)}},
                     failure=Failure("execute", "slipped", "lost"), after_scene=SCENE)  # fmt: skip
    text = transcript(record)
    for words in ("Pick up the red cube", "a: red cube", "grasp_depth 0.025", "contact of panda_hand",
                  "STOPPED (slipped)", "Ended at execute"):  # fmt: skip
        assert words in text
    crowd = scene(*(thing(f"object-{i}", 0.1, 0.1, "red") for i in range(400)))
    assert len(transcript(replace(record, scene=crowd))) <= 8000
    assert "abstained" in transcript(replace(record, plan=Plan(None, abstention=Abstention("other", "no"))))


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


def test_correspondence_is_one_to_one_and_keeps_paint_apart() -> None:
    after = scene(thing("r", 0.5, 0.1, "green", "region", 0.1), thing("q", 0.5, 0.1, "red"))
    found = correspond(SCENE, after)
    assert {name: later.id for name, later in found.later.items()} == {"a": "q", "goal": "r"}
    assert found.of("b") is None
    assert correspond(SCENE, scene()).later == {}


def test_words_do_not_settle_which_part_of_a_thing_is_meant() -> None:
    lamp = replace(thing("lamp", 0.4, 0.0, "blue", size=0.12), label="lamp")
    button = replace(thing("button", 0.4, 0.0, "red", "disc", 0.03), label="red button", parent="lamp")
    record = EpisodeRecord("run/1", "turn on the lamp", "", 0, {}, scene=scene(lamp, button))
    assert "theme_length" not in memory_task(record).signature
    pressed = memory_task(replace(record, instruction="press the red button"))
    assert pressed.signature["theme_length"] == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("extents", "words"),
    [
        ((0.05, 0.05, 0.05), "a small box"),
        ((0.02, 0.02, 0.06), "a tall small box"),
        ((0.3, 0.2, 0.02), "a flat large box"),
        ((0.12, 0.09, 0.07), "a medium box"),
    ],
)
def test_lessons_name_size_and_build(extents: tuple[float, float, float], words: str) -> None:
    shaped = replace(SCENE["a"], extents=np.array(extents))
    (lesson, *_) = memory_episode(episode(scene=SCENE.with_object(shaped)), SUCCESS).lessons
    assert words in lesson.content


SCALES = {"grasp_depth": ("height", 0.05)}


def sized(record: EpisodeRecord) -> EpisodeRecord:
    """The record with a plan that says which parameter goes with the object's size."""
    assert record.plan is not None
    return replace(record, plan=replace(record.plan, scales=SCALES))


def test_what_goes_with_the_size_is_learnt_as_a_share_of_it() -> None:
    priors = effects_of(memory_episode(sized(episode()), SUCCESS).lessons)
    assert {e.parameter: (e.value, e.scale) for e in priors} == {
        "grasp_depth": (pytest.approx(0.5), "height"),
        "approach_tilt": (0.0, ""),
        "standoff": (0.05, ""),
    }
    slipped = sized(episode({4: {"held": False, "abort": "slipped"}}))
    (bound,) = (Effect.from_json(x.effect) for x in memory_episode(slipped, FAIL).lessons if x.effect)
    assert (bound.kind, bound.value, bound.scale) == ("bound", pytest.approx(0.6), "height")


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


def test_shares_and_metres_are_kept_apart(tmp_path: Path) -> None:
    with open_bank(tmp_path) as bank:
        # As banks from before there were scales.
        for run, record in enumerate((episode(), sized(episode()), episode())):
            bank.learn(memory_episode(replace(record, episode_id=f"run/{run}"), SUCCESS), SUCCESS)
        found = [r.effect_json() for r in bank.records() if "grasp_depth" in r.effect]
    figures = {(e.get("scale", ""), e["count"], round(e["value"], 4)) for e in found if e}
    assert figures == {("", 2, 0.025), ("height", 1, 0.5)}


def test_the_handled_sides_are_the_planners_where_it_gives_them() -> None:
    assert handled_lengths(episode()) == pytest.approx({"length": 0.05, "width": 0.05, "height": 0.05})
    whole = replace(sized(episode()).plan, scales={"grasp_depth": ("height", 0.2)})
    assert handled_lengths(replace(episode(), plan=whole))["height"] == 0.2
    assert handled_lengths(replace(episode(), plan=None)) == {}


@pytest.mark.parametrize("skill", ["open", "close", "pull", "draw", "twist", "insert"])
def test_success_of_each_working_skill_gives_priors_of_its_own_parameters(skill: str) -> None:
    theta = {"open_angle": 1.8, "lip_depth": 0.006, "let_go_angle": 1.0, "hook_depth": 0.01, "pull_distance": 0.15,
             "end_distance": 0.02, "turn": 2.9, "insert_depth": 0.02, "grasp_depth": 0.02, "standoff": 0.05,
             "transit_clearance": 0.05, "speed": 0.2}  # fmt: skip
    lessons = memory_episode(episode(skill=skill, theta=theta), SUCCESS).lessons
    effects = effects_of(lessons)
    assert len(effects) == 3
    assert all(e.skill == skill and e.parameter != "speed" for e in effects)
    assert lessons[0].content.split(" ")[0].casefold() == skill


def placed() -> EpisodeRecord:
    """A success of a planner of skills: the red cube on the green square."""
    record = episode(roles={"theme": "a", "goal": "goal"}, skill="place", instruction="Put it on green")
    assert record.plan is not None
    calls = (SkillCall("place", "a", "goal", relation="on"),)
    return replace(record, plan=replace(record.plan, calls=calls))


def programs_of(record: EpisodeRecord) -> dict[str, Program]:
    told = [x.effect for x in memory_episode(record, SUCCESS).lessons if x.effect]
    found = [Program.from_json(e) for e in told if e["kind"] == "program"]
    return {program.language: program for program in found}


def test_a_success_is_taught_as_programs_without_its_names() -> None:
    found = programs_of(placed())
    assert found["calls"].steps == ("place({theme}, {goal}, on)",)
    assert found["waypoints"].steps[2] == ("{theme}", 0, 0, "-0.60h", 0)
    assert {name for step in found["waypoints"].steps for name in step[:2] if isinstance(name, str)} == {
        "{theme}"
    }
    assert not [
        x for x in memory_episode(placed(), FAIL).lessons if (x.effect or {}).get("kind") == "program"
    ]


def test_what_a_program_has_no_words_for_is_not_taught_as_calls() -> None:
    record = placed()
    assert record.plan is not None
    for call in (
        SkillCall("place", "a", xy=(0.4, 0.1)),
        SkillCall("push", "a", direction=(0.6, 0.8), amount=0.1),
    ):
        assert "calls" not in programs_of(replace(record, plan=replace(record.plan, calls=(call,))))
    left = SkillCall("push", "a", direction=(0.0, 1.0), amount=0.1)
    found = programs_of(replace(record, plan=replace(record.plan, calls=(left,))))
    assert found["calls"].steps == ("push({theme}, left, 100)",)
    part = replace(record.plan, calls=(left,), remaining=(left,))
    assert programs_of(replace(record, plan=part)) == {}


def test_programs_come_back_with_other_names_and_sizes_through_a_bank(tmp_path: Path) -> None:
    later = scene(thing("x1", 0.2, 0.0, "blue", size=0.08), thing("x2", 0.4, 0.2, "red", "region", 0.12))
    asked = EpisodeRecord("run/9", "Put the blue box down on the red goal", "", 9, {}, scene=later)
    with open_bank(tmp_path, hints=6) as bank:
        bank.learn(memory_episode(placed(), SUCCESS), SUCCESS)
        context, notes = with_sound_effects(bank.recall(memory_task(asked)))
    assert notes == ()
    names = unique_names(later)
    given = advice_for(replace(asked, recalled=context)).programs
    said = {p.language: told(p, later, names, asked.instruction) for p in given}
    assert said["calls"] == ("place(blue_cube, red_square, on)",)
    steps = said["waypoints"]
    assert steps is not None
    assert steps[2] == ("blue_cube", 0, 0, -48, 0)  # 0.6 of 80 mm


def test_a_program_that_is_none_is_passed_over() -> None:
    broken = {"kind": "program", "language": "waypoints", "roles": {}, "steps": [["{ghost}", 0, 0, 0, 1]]}
    item = MemoryItem("m1", "procedural_hint", "words", 1.0, 1.0, {}, False, broken)
    context, notes = with_sound_effects(MemoryContext((item,)))
    assert context.items[0].effect is None
    assert "m1" in notes[0]
