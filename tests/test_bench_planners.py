"""Planners side by side in the robot suite: the episodes, their keys, the teachers and the costs.

Most episodes are made up, since the design is tested; the last test moves a robot.
"""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from gvla2.commands.bench import run_bench
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import Gvla2Error
from gvla2.evaluation.arms import Experience
from gvla2.evaluation.suites import robot
from gvla2.evaluation.suites.robot_episodes import cells_of, spent_on
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.robot.backend import SuccessCheck
from tests.composing import bench_config
from tests.local_model import LocalModel, said
from tests.quick import QUICK

BOTH = "planners=[skill,code_policies]"


def config_of(registry, folder: Path, *overrides: str):
    config = bench_config(registry, "suite=robot", "quiet=true", "workers=1", *QUICK, *overrides)
    config.results.url = f"sqlite:///{folder / 'results.sqlite'}"
    return config


def rows_of(folder: Path, profile: str = "relaxed") -> list[dict]:
    rows = json.loads((folder / "result.json").read_text())["rows"]
    return [row for row in rows if row["profile"] == profile]


def experience(task: str, planner: str, seed: int) -> Experience:
    lesson = Lesson("procedural_hint", f"{planner} did {task} well.")
    asked = MemoryTask(f"do {task}", {"objects": 1.0}, "pick", ("red cube box",))
    verdict = Verdict.from_criteria({"completion": 1.0}, verifier="made up")
    return Experience(task, seed, MemoryEpisode(asked, (lesson,), source=f"{task}-{seed}"), verdict)


@pytest.fixture
def units(monkeypatch):
    """What was run, in order; episodes succeed on even layouts."""
    ran = []

    def pretend(unit, registry):
        ran.append(unit)
        name, won = unit.config.planner.name, unit.layout % 2 == 0
        asks = name != "skill"
        record = replace(
            EpisodeRecord("e", "do it", unit.subject, unit.layout, {}),
            timings={"plan": 4.0 if asks else 0.1},
            language={"plan": {"calls": 2, "prompt_tokens": 300, "completion_tokens": 12}} if asks else {},
            success_check=SuccessCheck(won, strict=False),
            failure=None if won else Failure("execute", "slipped", "It slipped."),
        )
        learned = [experience(unit.subject, name, unit.layout)] if unit.arm.name == "exploration" else []
        return cells_of(unit, record, 1.0, learned)

    monkeypatch.setattr(robot, "run_unit", pretend)
    return ran


def lessons_in(unit) -> set[str]:
    """What the bank of an episode's arm says."""
    with KnowledgeBank(f"sqlite:///{unit.lessons.bank}") as bank:
        return {record.content for record in bank.records()}


def test_every_planner_meets_the_same_layouts_and_one_table_shows_them(registry, tmp_path, units):
    config = config_of(registry, tmp_path, BOTH, "tasks=[lamp_on,put_block]", "layouts=[200,201,203]")
    assert run_bench(config, registry, tmp_path / "out") == 1
    ran = [(unit.config.planner.name, unit.subject, unit.arm.name, unit.layout) for unit in units]
    places = product(("skill", "code_policies"), ("put_block", "lamp_on"), ("off",), (200, 201, 203))
    assert ran == list(places), "memory is off unless arms are named"
    rows = rows_of(tmp_path / "out")
    asked = [row for row in rows if row["planner"] == "code_policies"]
    assert {(row["calls"], row["prompt_tokens"], row["completion_tokens"]) for row in asked} == {(2, 300, 12)}
    assert {row["model"] for row in rows} == {"http://127.0.0.1:8000/v1", ""}
    report = (tmp_path / "out" / "report.md").read_text()
    assert "|  | skill | code_policies |" in report
    assert "300 + 12" in report
    assert "33.3" in report


def test_a_planners_episodes_are_not_run_again_beside_other_planners(registry, tmp_path, units):
    place = ["tasks=[lamp_on]", "layouts=[200]"]
    run_bench(
        config_of(registry, tmp_path, "planner=skill", "arms=['off']", *place), registry, tmp_path / "alone"
    )
    run_bench(config_of(registry, tmp_path, BOTH, *place), registry, tmp_path / "both")
    assert [unit.config.planner.name for unit in units] == ["skill", "code_policies"]
    optioned = config_of(registry, tmp_path, BOTH, "+planner_options.code_policies.samples=3", *place)
    run_bench(optioned, registry, tmp_path / "three")
    assert [unit.config.planner.samples for unit in units[2:]] == [3], "other options are other rows"
    assert {row["planner"] for row in rows_of(tmp_path / "three")} == {"skill", "code_policies (samples=3)"}


def test_each_planner_teaches_itself_unless_a_teacher_is_named(registry, tmp_path, units):
    given = [BOTH, "arms=['off','on']", "tasks=[lamp_on]", "layouts=[200]", "exploration_seeds=[0,1]"]
    run_bench(config_of(registry, tmp_path, *given), registry, tmp_path / "own")
    explored = [unit for unit in units if unit.arm.name == "exploration"]
    ran = [(unit.config.planner.name, unit.layout) for unit in explored]
    assert ran == list(product(("skill", "code_policies"), (0, 1)))
    for name in ("skill", "code_policies"):
        (learned,) = [u for u in units if u.arm.name == "on" and u.config.planner.name == name]
        assert lessons_in(learned) == {f"{name} did lamp_on well."}
    done = len(units)
    run_bench(config_of(registry, tmp_path, *given, "teacher=skill"), registry, tmp_path / "taught")
    again = [(unit.config.planner.name, unit.arm.name) for unit in units[done:]]
    assert again == [("code_policies", "on")], "the teacher has explored, and taught itself, before"
    assert lessons_in(units[-1]) == {"skill did lamp_on well."}
    (row,) = [r for r in rows_of(tmp_path / "taught") if r["arm"] == "on" and r["planner"] == "code_policies"]
    assert row["teacher"] == "skill"
    assert "memory on (taught by skill)" in (tmp_path / "taught" / "report.md").read_text()


def test_a_shuffled_arm_never_gets_its_own_lessons(registry, tmp_path, units, monkeypatch):
    real = robot.run_unit

    def only_the_lamp_teaches(unit, registry):
        found = real(unit, registry)
        if unit.subject != "lamp_on":
            for cell in found:
                cell.notes.pop("experience", None)
        return found

    monkeypatch.setattr(robot, "run_unit", only_the_lamp_teaches)
    given = ["tasks=[lamp_on,put_block]", "arms=['shuffled']", "layouts=[200]", "exploration_seeds=[0]"]
    run_bench(config_of(registry, tmp_path, *given), registry, tmp_path / "out")
    shown = {unit.subject: unit for unit in units if unit.arm.name == "shuffled"}
    assert shown["put_block"].lessons.asked.query == "do lamp_on"
    assert lessons_in(shown["put_block"]) == {"skill did lamp_on well."}
    assert shown["lamp_on"].lessons.asked is None, "nothing was learned elsewhere"
    assert not lessons_in(shown["lamp_on"])


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["planners=[skil]"], "No planner named 'skil'. Did you mean 'skill'"),
        ([BOTH, "+planner_options.voxposer.tries=2"], "'voxposer' is not among the planners"),
        ([BOTH, "+planner_options.code_policies.sample=2"], "no such option. Did you mean 'samples'"),
        ([BOTH, "+planner_options.code_policies.samples=few"], "configured wrongly"),
        ([BOTH, "arms=['on']", "layouts=[3,200]"], r"layouts \[3\] are among the exploration_seeds"),
    ],
)
def test_an_impossible_comparison_is_an_error_before_anything_runs(
    registry, tmp_path, units, overrides, message
):
    config = config_of(registry, tmp_path, "tasks=[lamp_on]", *overrides)
    with pytest.raises(Gvla2Error, match=message):
        run_bench(config, registry, tmp_path / "out")
    assert not units


def test_what_an_episode_cost_is_counted_over_attempts_and_parts():
    plain = EpisodeRecord("e", "lift it", "pick_and_lift", 0, {})
    part = replace(plain, timings={"plan": 1.0, "check": 0.5})
    tally = {"calls": 2, "cached": 1, "prompt_tokens": 90, "completion_tokens": 10}
    record = replace(
        plain,
        timings={"plan": 2.0, "execute": 9.0},
        parts=(part,),
        attempts=(replace(part, parts=(part,)),),
        language={"plan": tally, "verify": {"calls": 1, "prompt_tokens": 5, "completion_tokens": 5}},
    )
    assert spent_on(record) == {
        "planning_seconds": 6.5, "calls": 3, "cached": 1, "prompt_tokens": 95, "completion_tokens": 15,
    }  # fmt: skip
    assert spent_on(plain)["planning_seconds"] is None, "it never came to planning"
    unmetered = replace(plain, language={"plan": {**tally, "unmetered": 1}})
    assert spent_on(unmetered)["prompt_tokens"] is None, "not counted is not zero"


def test_a_model_writes_a_program_and_the_robot_carries_it_out(registry, tmp_path):
    pytest.importorskip("sapien", exc_type=ImportError)
    with LocalModel(lambda request: said("pick(magenta_cube)\n")) as model:
        config = config_of(
            registry, tmp_path, BOTH, "tasks=[pick_and_lift]", "layouts=[200]", "fallback=skill",
            f"language.base_url={model.url}", "language.retries=0",
        )  # fmt: skip
        assert run_bench(config, registry, tmp_path / "out") == 1
        asked = len(model.requests)
    skill, policies = rows_of(tmp_path / "out")
    assert (skill["planner"], skill["calls"], skill["prompt_tokens"]) == ("skill", 0, 0)
    assert (policies["success"], policies["fallback"]) == (True, ""), "the program, not the fallback"
    assert policies["calls"] == asked >= 1
    assert (policies["prompt_tokens"], policies["completion_tokens"]) == (100 * asked, 10 * asked)
    assert policies["planning_seconds"] > 0
    absent = replace(config, layouts=[202], planners=["code_policies"])
    assert run_bench(absent, registry, tmp_path / "absent") == 0
    (row,) = rows_of(tmp_path / "absent")
    assert row["fallback"] == "skill"
    assert (row["success"], row["status"]) == (None, "not measured: unavailable"), (
        "what skill did is not counted"
    )
