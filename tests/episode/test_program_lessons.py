"""Programs of a success are lessons, and come back with the names and sizes of another scene."""

from dataclasses import replace
from pathlib import Path

from gvla2.episode.lessons import memory_episode, memory_task
from gvla2.episode.planning import advice_for, with_sound_effects
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.contracts import MemoryContext, MemoryItem
from gvla2.planning.calls import SkillCall
from gvla2.planning.programs import Program, adapted
from gvla2.planning.scene_brief import unique_names
from tests.episode.test_lessons_through_a_bank import open_bank
from tests.objects import scene
from tests.picking import FAIL, SUCCESS, cube, episode, square


def placed() -> EpisodeRecord:
    """A success of a planner of skills: the red cube on the green square."""
    record = episode(roles={"theme": "a", "goal": "goal"}, skill="place", instruction="Put it on green")
    assert record.plan is not None
    calls = (SkillCall("place", "a", "goal", relation="on"),)
    return replace(record, plan=replace(record.plan, calls=calls))


def programs_of(record: EpisodeRecord) -> dict[str, Program]:
    shown = [x.effect for x in memory_episode(record, SUCCESS).lessons if x.effect]
    found = [Program.from_json(e) for e in shown if e["kind"] == "program"]
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
    later = scene(cube("x1", 0.2, 0.0, "blue", side=0.08), square("x2", 0.4, 0.2, "red", 0.12))
    asked = EpisodeRecord("run/9", "Put the blue box down on the red goal", "", 9, {}, scene=later)
    with open_bank(tmp_path, hints=6) as bank:
        bank.learn(memory_episode(placed(), SUCCESS), SUCCESS)
        context, notes = with_sound_effects(bank.recall(memory_task(asked)))
    assert notes == ()
    names = unique_names(later)
    given = advice_for(replace(asked, recalled=context)).programs
    said = {p.language: adapted(p, later, names, asked.instruction) for p in given}
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
