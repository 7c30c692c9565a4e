"""The planners' table from made-up cells."""

from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.robot_tables import robot_sheets
from gvla2.evaluation.tables import Sheet, to_latex, to_markdown


def cell(planner: str, task: str, episode: int, done: bool | None, arm: str = "off", **more) -> Cell:
    asks = planner != "skill"
    factors = {
        "task": task, "arm": arm, "seed": "layouts", "episode": episode, "planner": planner, "profile": "relaxed",
        "model": more.pop("model", "small" if asks else ""),
        "robot": "sapien_panda", "perceiver": "classical", "verifier": "geometric", "depth_noise": "none",
        "scale": "1.0",
    }  # fmt: skip
    measures = {
        "success": done, "seconds": 9.0, "planning_seconds": 4.0 + episode if asks else 0.1, "calls": 2.0 * asks,
        "cached": 0, "prompt_tokens": 300.0 * asks, "completion_tokens": 12.0 * asks,
    }  # fmt: skip
    measures |= {name: more.pop(name) for name in list(more) if name in measures}
    notes = {"status": "ok", "failure": "" if done else "abstained", "verdict": "uncertain", **more}
    return Cell(repr((sorted(factors.items()),)), factors, measures, notes, 1)


def text(sheet: Sheet, row: str, column: str) -> tuple[str, ...]:
    (line,) = [line for line in sheet.rows if line.label == row]
    return line.cells[sheet.headings.index(column)].lines


BOTH = [
    *(cell("skill", task, place, True) for task in ("put_block", "lamp_on") for place in range(3)),
    *(cell("agent3d", "put_block", place, place == 0) for place in range(3)),
    *(cell("agent3d", "lamp_on", place, False) for place in range(3)),
]


def test_planners_are_columns_with_their_costs_below():
    relaxed, strict, failures = robot_sheets(BOTH)
    assert relaxed.headings == ("skill", "agent3d"), "in the order of the bench"
    assert text(relaxed, "put_block", "agent3d") == ("33.3", "[6, 79] 1/3")
    assert text(relaxed, "put_block", "skill") == ("100.0", "[44, 100] 3/3")
    assert text(relaxed, "mean over tasks", "agent3d") == ("16.7", "named layouts; 1 of 2 tasks above 0")
    assert text(relaxed, "prompt + answer tokens an episode", "agent3d") == ("300 + 12",)
    assert text(relaxed, "planning seconds, median", "agent3d") == ("5.0",)
    assert text(relaxed, "calls an episode", "skill") == ("0.0",)
    assert text(relaxed, "against the first column", "agent3d") == ("too few pairs to show any",)
    assert "tokens" not in "".join(row.label for row in strict.rows), "costs are reported once"
    assert text(failures, "abstained", "agent3d") == ("5",)
    assert "300 + 12" in to_markdown(robot_sheets(BOTH))
    assert "300 + 12" in to_latex(robot_sheets(BOTH))


def test_an_episode_that_was_not_measured_counts_nowhere_and_is_reported():
    late = cell("agent3d", "put_block", 3, None, failure="timeout", planning_seconds=900.0)
    relaxed, *_, failures = robot_sheets([*BOTH, late])
    assert text(relaxed, "put_block", "agent3d") == ("33.3", "[6, 79] 1/3")
    assert text(relaxed, "not measured", "agent3d") == ("1",)
    assert "timeout" not in {row.label for row in failures.rows}
    alone = robot_sheets([cell("skill", "lamp_on", 0, True), cell("agent3d", "lamp_on", 0, None)])[0]
    assert text(alone, "lamp_on", "agent3d") == ("not measured",)
    assert text(alone, "mean over tasks", "agent3d") == ("not measured",)


def test_cached_answers_fallbacks_and_uncounted_tokens_are_no_savings():
    free = {"calls": 0.0, "prompt_tokens": 0.0, "completion_tokens": 0.0}
    unknown = {"prompt_tokens": None, "completion_tokens": None}
    relaxed = robot_sheets(
        [
            cell("agent3d", "insert_block", 0, True, cached=2.0, **free),
            cell("agent3d, then skill", "open_jar", 0, True, fallback="skill", **unknown),
        ]
    )[0]
    assert text(relaxed, "answers from the cache", "agent3d") == ("2",)
    assert text(relaxed, "prompt + answer tokens an episode", "agent3d, then skill") == ("not counted",)
    assert text(relaxed, "episodes with the fallback", "agent3d, then skill") == ("1",)
    assert text(relaxed, "open_jar", "agent3d") == ("not measured",)


def test_episodes_with_second_tries_are_counted_with_their_successes():
    tried = [cell("skill", "put_block", place, place == 0, second_tries=1) for place in (0, 1, 2)]
    relaxed = robot_sheets(
        [*tried, cell("skill", "put_block", 3, True), cell("agent3d", "put_block", 0, True)]
    )[0]
    assert text(relaxed, "second tries", "skill") == ("1 of 3 won",)
    assert "second tries" not in {row.label for row in robot_sheets(BOTH)[0].rows}


def test_models_and_arms_are_columns_of_their_own():
    by_two = [*BOTH, cell("agent3d", "lamp_on", 0, True, model="large")]
    assert robot_sheets(by_two)[0].headings == ("skill", "agent3d by small", "agent3d by large")
    taught = [cell("agent3d", "lamp_on", place, place == 0, "on") for place in range(3)]
    relaxed, _, effects, failures = robot_sheets([*BOTH, *taught])
    assert relaxed.headings == ("skill, memory off", "agent3d, memory off", "agent3d, memory on")
    assert text(relaxed, "lamp_on", "agent3d, memory on")[0] == "33.3"
    assert failures.headings == relaxed.headings
    assert "planner agent3d, model small" in effects.title
    assert [row.label for row in effects.rows] == ["on against off"]
