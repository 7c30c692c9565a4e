"""Planners side by side in the robot suite: the episodes, their keys and the costs.

Most episodes are made up, since the design is tested; the last test moves a robot.
"""

import json
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from gvla2.commands.bench import run_bench
from gvla2.commands.report import ReportConfig, job
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.evaluation.arms import Story
from gvla2.evaluation.suites import robot_episodes, robot_stress
from gvla2.evaluation.suites.robot_episodes import cells_of, spent_on
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.robot.backend import SuccessCheck
from tests.composing import bench_config
from tests.local_model import LocalModel, said
from tests.quick import QUICK

BANKS = {"on": "default", "semantic": "semantic"}


def config_of(registry, folder: Path, *overrides: str):
    config = bench_config(
        registry, "suite=robot", "conditions=clean", "quiet=true", "workers=1", *QUICK, *overrides
    )
    config.results.url = f"sqlite:///{folder / 'results.sqlite'}"
    return config


def rows_of(folder: Path, profile: str = "relaxed") -> list[dict]:
    rows = json.loads((folder / "result.json").read_text())["rows"]
    return [row for row in rows if row["profile"] == profile]


def story(task: str, planner: str, seed: int) -> Story:
    lesson = Lesson("procedural_hint", f"{planner} did {task} well.")
    asked = MemoryTask(f"do {task}", "pick", ("red cube box",))
    verdict = Verdict.from_criteria({"completion": 1.0}, verifier="made up")
    return MemoryEpisode(asked, (lesson,), source=f"{task}-{seed}"), verdict


@pytest.fixture
def units(monkeypatch):
    """What was run, in order; episodes succeed on even layouts."""
    ran = []

    def pretend(unit, registry, earlier):
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
        explored = unit.arm.name == "exploration"
        return cells_of(unit, record, 1.0, (story(unit.subject, name, unit.layout),) if explored else ())

    monkeypatch.setattr(robot_episodes, "run_unit", pretend)
    return ran


def lessons_in(unit) -> set[str]:
    """What the bank of an episode's arm says."""
    with KnowledgeBank(f"sqlite:///{unit.lessons.bank}") as bank:
        return {record.content for record in bank.records()}


def test_planners_measured_one_by_one_stand_side_by_side_in_a_report(registry, tmp_path, units, capsys):
    given = ["arms=['off']", "tasks=[lamp_on,put_block]", "layouts=[200,201,203]"]
    planners = (
        ["planner=skill"],
        ["planner=code_policies"],
        ["planner=code_policies", "planner.max_tokens=256"],
    )
    for number, planner in enumerate(planners):
        config = config_of(registry, tmp_path, *planner, *given)
        assert run_bench(config, registry, tmp_path / str(number)) == 1
    ran = [(unit.subject, unit.arm.name, unit.layout) for unit in units]
    assert ran == 3 * list(product(("put_block", "lamp_on"), ("off",), (200, 201, 203)))
    rows = rows_of(tmp_path / "2")
    assert {row["planner"] for row in rows} == {"code_policies (max_tokens=256)"}, (
        "other options are other rows"
    )
    assert {(row["calls"], row["prompt_tokens"], row["completion_tokens"]) for row in rows} == {(2, 300, 12)}
    assert {row["model"] for row in rows} == {"http://127.0.0.1:8000/v1"}
    report = ReportConfig("robot", results=config.results, formats=["markdown"])
    assert job(report, registry, tmp_path / "report") == 3 * 6 * 2
    text = (tmp_path / "report" / "report.md").read_text()
    assert "|  | skill | code_policies | code_policies (max_tokens=256) |" in text
    assert "300 + 12" in text
    assert "33.3" in text
    run_bench(config, registry, tmp_path / "again")
    assert len(units) == 18, "nothing is run twice"


def test_each_planner_teaches_itself(registry, tmp_path, units):
    given = ["arms=['off','on']", "tasks=[lamp_on]", "layouts=[200]", "exploration_seeds=[0,1]"]
    for name in ("skill", "code_policies"):
        run_bench(config_of(registry, tmp_path, f"planner={name}", *given), registry, tmp_path / name)
        assert [(unit.arm.name, unit.layout) for unit in units] == [
            ("exploration", 0), ("exploration", 1), ("off", 200), ("on", 200),
        ]  # fmt: skip
        assert lessons_in(units[-1]) == {f"{name} did lamp_on well."}
        units.clear()


def test_a_shuffled_arm_never_gets_its_own_lessons(registry, tmp_path, units, monkeypatch):
    real = robot_episodes.run_unit

    def only_the_lamp_teaches(unit, registry, earlier):
        found = real(unit, registry, earlier)
        if unit.subject != "lamp_on":
            for cell in found:
                cell.notes.pop("stories", None)
        return found

    monkeypatch.setattr(robot_episodes, "run_unit", only_the_lamp_teaches)
    given = ["tasks=[lamp_on,put_block]", "arms=['shuffled']", "layouts=[200]", "exploration_seeds=[0]"]
    run_bench(config_of(registry, tmp_path, *given), registry, tmp_path / "out")
    shown = {unit.subject: unit for unit in units if unit.arm.name == "shuffled"}
    assert shown["put_block"].lessons.asked.query == "do lamp_on"
    assert lessons_in(shown["put_block"]) == {"skill did lamp_on well."}
    assert shown["lamp_on"].lessons.asked is None, "nothing was learned elsewhere"
    assert not lessons_in(shown["lamp_on"])


def _verifier(config) -> str:
    withheld = getattr(config.verifier, "withheld", 0.0)
    return config.verifier.name + (f", {withheld} withheld" if withheld else "")


def test_a_stress_changes_what_the_arms_have_lived_or_heard(registry, tmp_path, units, monkeypatch):
    monkeypatch.setattr(robot_stress, "CROWD", 60)
    monkeypatch.setattr(robot_stress, "BUDGET", 20)
    given = ["world=learnable", "seeds=[4]", "tasks=[lamp_on]", "arms=['off','on','semantic']", "episodes=1"]
    stresses = "stresses=[none,verifier,drift,import,crowd,twins,unjudged,all]"
    config = config_of(registry, tmp_path, *given, "exploration_seeds=[0,1]", "embedder=static", stresses)
    assert run_bench(config, registry, tmp_path / "out") == 1
    explored = [u for u in units if u.arm.name == "exploration"]
    lived = {
        (_verifier(u.config), u.task.get("drifted", False), u.task.get("twins", False), u.layout)
        for u in explored
    }
    ways = [("geometric", False), ("flaky", False), ("flaky, 0.5 withheld", False), ("geometric", True)]
    steady = {(verifier, False, alike, layout) for verifier, alike in ways for layout in (0, 1)}
    drifting = {("geometric", True, False, 1), ("flaky", False, True, 0), ("flaky", True, True, 1)}
    assert lived == steady | drifting
    assert len(explored) == 2 * len(lived), "both families, each once for all the stresses"
    known: dict[tuple[str, str], Counter] = {}
    for unit in units:
        if unit.arm.learns:
            with KnowledgeBank(f"sqlite:///{unit.lessons.bank}", bank=BANKS[unit.arm.name]) as bank:
                states = Counter(record.state for record in bank.records())
                known[unit.factors["stress"], unit.arm.name] = states
    assert len(rows_of(tmp_path / "out")) == 8 * 3 * 2, "stresses x arms x families"
    own = known["none", "on"]["active"]
    assert known["import", "on"] == {"active": own, "provisional": 30}
    assert known["import", "semantic"]["active"] == known["none", "semantic"]["active"] + 30
    assert known["crowd", "on"]["active"] == 20
    assert known["crowd", "semantic"]["active"] == known["none", "semantic"]["active"] + 60
    assert "what governance adds under stress" in (tmp_path / "out" / "index.html").read_text()


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
            registry, tmp_path, "planner=code_policies", "arms=['off']", "tasks=[pick_and_lift]",
            "layouts=[200]", "fallback=skill", f"language.base_url={model.url}", "language.retries=0",
        )  # fmt: skip
        assert run_bench(config, registry, tmp_path / "out") == 1
        asked = len(model.requests)
    (policies,) = rows_of(tmp_path / "out")
    assert (policies["success"], policies["fallback"]) == (True, ""), "the program, not the fallback"
    assert policies["calls"] == asked >= 1
    assert (policies["prompt_tokens"], policies["completion_tokens"]) == (100 * asked, 10 * asked)
    assert policies["planning_seconds"] > 0
    absent = replace(config, layouts=[202])
    assert run_bench(absent, registry, tmp_path / "absent") == 0
    (row,) = rows_of(tmp_path / "absent")
    assert row["fallback"] == "skill"
    assert (row["success"], row["status"]) == (None, "not measured: unavailable"), (
        "what skill did is not counted"
    )
