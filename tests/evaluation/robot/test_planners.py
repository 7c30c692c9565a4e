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


def sheets(*cells: Cell) -> list[Sheet]:
    return robot_sheets(cells)


def text(sheet: Sheet, row: str, column: str) -> tuple[str, ...]:
    (line,) = [line for line in sheet.rows if line.label == row]
    return line.cells[sheet.headings.index(column)].lines


BOTH = [
    *(cell("skill", task, place, True) for task in ("put_block", "lamp_on") for place in range(3)),
    *(cell("agent3d", "put_block", place, place == 0) for place in range(3)),
    *(cell("agent3d", "lamp_on", place, False) for place in range(3)),
]


def test_tasks_stand_below_one_another_and_planners_side_by_side_with_what_they_cost():
    relaxed, strict, failures = sheets(*BOTH)
    assert relaxed.headings == ("skill", "agent3d"), "in the order of the bench"
    assert text(relaxed, "put_block", "agent3d") == (
        "33.3",
        "[6, 79] 1/3",
        "5.0 s",
        "2.0 calls",
        "300 + 12 tokens",
    )
    assert text(relaxed, "put_block", "skill") == ("100.0", "[44, 100] 3/3", "0.1 s")
    assert text(relaxed, "mean over tasks", "agent3d") == ("16.7", "named layouts; 1 of 2 tasks above 0")
    assert text(relaxed, "prompt + answer tokens an episode", "agent3d") == ("300 + 12",)
    assert text(relaxed, "planning seconds, median", "agent3d") == ("5.0",)
    assert "language model small" in relaxed.footnote
    assert "tokens" not in "".join(row.label for row in strict.rows), "costs are reported once"
    assert text(failures, "abstained", "agent3d") == ("5",)
    assert "300 + 12 tokens" in to_markdown(sheets(*BOTH))
    assert "300 + 12 tokens" in to_latex(sheets(*BOTH))


def test_what_was_not_measured_counts_nowhere_and_is_reported():
    cells = [
        *BOTH,
        cell("agent3d", "put_block", 3, None, status="not measured: timeout", planning_seconds=900.0),
    ]
    relaxed, *_, failures = sheets(*cells)
    assert text(relaxed, "put_block", "agent3d")[1:3] == ("[6, 79] 1/3", "5.0 s")
    assert text(relaxed, "put_block", "agent3d")[-1] == "1 not measured"
    assert text(failures, "not measured", "agent3d") == ("1",)
    alone = [cell("skill", "lamp_on", 0, True), cell("agent3d", "lamp_on", 0, None)]
    assert text(sheets(*alone)[0], "lamp_on", "agent3d") == ("1 not measured",)
    assert text(sheets(*alone)[0], "mean over tasks", "agent3d") == ("not measured",)


def test_cached_answers_fallbacks_and_uncounted_tokens_are_no_savings():
    cells = [
        *BOTH,
        cell(
            "agent3d",
            "insert_block",
            0,
            True,
            calls=0.0,
            cached=2.0,
            prompt_tokens=0.0,
            completion_tokens=0.0,
        ),
        cell("agent3d", "open_jar", 0, True, prompt_tokens=None, completion_tokens=None),
        cell("agent3d, then skill", "open_jar", 0, True, fallback="skill"),
    ]
    relaxed = sheets(*cells)[0]
    assert text(relaxed, "insert_block", "agent3d")[-1] == "2 from the cache"
    assert text(relaxed, "open_jar", "agent3d")[-1] == "not counted"
    assert text(relaxed, "open_jar", "agent3d, then skill")[-1] == "fallback in 1"
    assert text(relaxed, "episodes with the fallback", "agent3d, then skill") == ("1 of 1",)
    assert text(relaxed, "insert_block", "skill") == ("not measured",)


def test_models_and_arms_are_columns_of_their_own():
    by_two = [*BOTH, cell("agent3d", "lamp_on", 0, True, model="large")]
    assert sheets(*by_two)[0].headings == ("skill", "agent3d by small", "agent3d by large")
    learnt = [cell("agent3d", "lamp_on", place, place == 0, "on") for place in range(3)]
    relaxed, _, effects, failures = sheets(*BOTH, *learnt)
    assert relaxed.headings == ("skill, memory off", "agent3d, memory off", "agent3d, memory on")
    assert text(relaxed, "lamp_on", "agent3d, memory on")[0] == "33.3"
    assert failures.headings == relaxed.headings
    assert "planner agent3d, model small" in effects.title
    assert [row.label for row in effects.rows] == ["on against off"]


def test_one_planner_that_asks_no_model_has_no_costs():
    titles = [sheet.title.rpartition(": ")[2] for sheet in sheets(*BOTH[:6])]
    assert titles == ["success, relaxed", "success, strict", "failures"]
    assert not any("tokens" in row.label for row in sheets(*BOTH[:6])[0].rows)
