"""The robot suite's tables from made-up cells."""

from dataclasses import replace

from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.robot_tables import robot_sheets
from gvla2.evaluation.tables import to_latex, to_markdown


def cell(
    task: str, arm: str, episode: int, done: bool, profile: str = "relaxed", seed: int | str = 0, **notes
) -> Cell:
    factors = {
        "task": task, "arm": arm, "profile": profile, "seed": seed, "episode": episode, "robot": "sapien_panda",
        "perceiver": "classical", "planner": "skill", "verifier": "geometric", "depth_noise": "none", "scale": "1.0",
    }  # fmt: skip
    shown = {
        "status": "ok",
        "failure": "" if done else "grasp",
        "verdict": "verified_success" if done else "verified_fail",
    }
    return Cell(
        f"{task}{arm}{episode}{profile}{seed}", factors, {"success": done, "seconds": 2.0}, shown | notes, 1
    )


def cells(*profiles: str) -> list[Cell]:
    made = []
    for profile in profiles or ("relaxed",):
        for episode in range(20):
            made += [
                cell("lamp_on", "off", episode, episode < 4, profile),
                cell("lamp_on", "on", episode, episode < 16, profile),
                cell("put_block", "off", episode, True, profile),
                cell("put_block", "on", episode, True, profile),
            ]
    return made


def text_of(sheet, row: str, column: str) -> tuple[str, ...]:
    line = next(line for line in sheet.rows if line.label == row)
    return line.cells[sheet.headings.index(column)].lines


def test_success_is_shown_with_its_interval():
    relaxed, strict, effects, failures = robot_sheets(cells("relaxed", "strict"))
    assert "relaxed" in relaxed.title
    assert "strict" in strict.title
    assert text_of(relaxed, "lamp_on", "memory off") == ("20.0", "[8, 42] 4/20")
    assert text_of(relaxed, "lamp_on", "memory on")[0] == "80.0 *"
    assert text_of(relaxed, "mean over tasks", "memory on") == ("90.0", "1 seed; 2 of 2 tasks above 0")
    assert text_of(effects, "on against off", "relaxed")[0] == "+30.0 points"
    assert "12 : 0 of 40" in text_of(effects, "on against off", "relaxed")[2]
    assert text_of(effects, "on against off", "relaxed")[3:] == ("could show 24 points", "lamp_on +")
    assert text_of(failures, "grasp", "memory off") == ("16",)
    assert text_of(failures, "verifier agrees", "memory on") == ("40 of 40",)
    # Only a sure difference is coloured.
    tones = {row.label: row.cells[relaxed.headings.index("memory on")].tone for row in relaxed.rows}
    assert tones["lamp_on"] == "better"
    assert tones["put_block (saturated)"] == ""


def test_groups_that_cannot_be_compared_get_tables_of_their_own_and_the_later_run_counts():
    again = [replace(c, run=2, measures={**c.measures, "success": True}) for c in cells()]
    tables = robot_sheets([*again, *cells()])
    assert text_of(tables[0], "lamp_on (saturated)", "memory off")[0] == "100.0"
    seen = [replace(c, key=c.key + "o", factors={**c.factors, "perceiver": "oracle"}) for c in cells()]
    titles = [table.title for table in robot_sheets([*cells(), *seen])]
    assert sum("perceiver oracle" in title for title in titles) == len(titles) // 2


def test_arms_that_learned_otherwise_have_columns_of_their_own():
    on, off = ([c for c in cells() if c.factors["arm"] == arm] for arm in ("on", "off"))
    ways = [
        replace(c, key=c.key + way, factors={**c.factors, "learning": way})
        for way in ("", "exploration_seeds=[5]")
        for c in on
    ]
    (relaxed, *_) = robot_sheets([*off, *ways])
    assert relaxed.headings == ("memory off", "memory on", "memory on (exploration_seeds=[5])")
    (relaxed, _, effects, _) = robot_sheets([*off, *ways[len(on) :]])
    assert relaxed.headings == ("memory off", "memory on"), "nobody learned otherwise"
    assert "exploration_seeds=[5]" in relaxed.title
    assert [row.label for row in effects.rows] == ["on against off"]


def test_stresses_stand_side_by_side_with_the_differences_that_their_pairs_can_show():
    stressed = [
        replace(c, key=c.key + stress, factors={**c.factors, "stress": stress})
        for stress in ("none", "drift")
        for c in cells()
        if stress == "none" or c.factors["episode"] < 2
    ]
    together, *others = robot_sheets(stressed)
    assert "stress" not in together.title.partition(":")[0]
    (none, *_) = (sheet for sheet in others if "stress none" in sheet.title)
    assert together.headings == ("memory on", "on against off")
    assert text_of(together, "none", "on against off")[2:4] == (
        "12 : 0 of 40, p 0.000488", "could show 24 points",
    )  # fmt: skip
    assert text_of(together, "drift (saturated)", "on against off")[3] == "too few pairs to show any"
    assert [row.label for row in none.rows][:2] == ["put_block (saturated)", "lamp_on"]


def test_layouts_without_a_seed_have_no_deviation_over_seeds():
    named = [replace(c, factors={**c.factors, "seed": "layouts"}, key=c.key + "n") for c in cells()]
    (relaxed, *_) = robot_sheets(named)
    assert text_of(relaxed, "mean over tasks", "memory on") == ("90.0", "named layouts; 2 of 2 tasks above 0")
    (relaxed, *_) = robot_sheets([*named, *cells()])
    assert text_of(relaxed, "mean over tasks", "memory on") == ("90.0", "named layouts; 2 of 2 tasks above 0")


def test_suites_and_their_groups_stand_beside_what_others_published(tmp_path):
    folder = tmp_path / "episode"
    folder.mkdir()
    (folder / "episode.mp4").write_bytes(b"film")
    made = [cell(f"cups/{k}", "off", 0, done=k < 3) for k in range(4)]
    made += [cell("bowls/0", "off", 0, False, folder=str(folder), message="It slipped.", layout=7)]
    made = [replace(c, factors={**c.factors, "given": "two cameras, known objects"}) for c in made]
    published = {
        "Other": {"given": "a trained policy", "success": {"cups": 60.5}},
        "Elsewhere": {"given": "", "success": {"x": 1}},
    }
    by_suite, by_task, failures = robot_sheets(
        made, {"both": ["cups", "bowls"], "more": ["cups", "forks"]}, published
    )
    assert by_suite.headings == ("memory off", "Other (published)")
    assert [row.label for row in by_suite.rows] == ["cups", "bowls", "both", "given"]
    assert text_of(by_suite, "cups", "memory off") == ("75.0", "[30, 95] 3/4")
    assert text_of(by_suite, "both", "memory off")[1].endswith("3/5")
    assert text_of(by_suite, "cups", "Other (published)") == ("60.5",)
    assert text_of(by_suite, "bowls", "Other (published)") == ("",)
    assert text_of(by_suite, "given", "memory off") == ("two cameras, known objects",)
    assert text_of(by_suite, "given", "Other (published)") == ("a trained policy",)
    assert by_task.title.endswith(": success"), "a suite's task has one check, not two profiles"
    (film,) = failures.films
    assert film.caption == "bowls/0, layout 7: It slipped."
    assert film.file.endswith("episode/episode.mp4")


def test_a_folder_in_a_tasks_options_is_no_suite():
    titles = [
        sheet.title for sheet in robot_sheets([cell("put_block objects={root: /scans}", "off", 0, True)])
    ]
    assert not any("suite" in title for title in titles)
    assert any(title.endswith("success, strict") for title in titles)


def asked(planner: str, task: str, episode: int, done: bool | None, arm: str = "off", **more) -> Cell:
    """An episode of a planner, which asks a model unless it is ``skill``, on a named layout."""
    asks = planner != "skill"
    spent = {
        "planning_seconds": 4.0 + episode if asks else 0.1, "calls": 2.0 * asks, "cached": 0,
        "prompt_tokens": 300.0 * asks, "completion_tokens": 12.0 * asks,
    }  # fmt: skip
    spent |= {name: more.pop(name) for name in list(more) if name in spent}
    model = more.pop("model", "small" if asks else "")
    failure = "" if done else "abstained"
    made = cell(
        task, arm, episode, bool(done), seed="layouts", **{"failure": failure, "verdict": "uncertain", **more}
    )
    factors = {**made.factors, "planner": planner, "model": model}
    return replace(
        made, key=repr(factors), factors=factors, measures={**made.measures, **spent, "success": done}
    )


BOTH = [
    *(asked("skill", task, place, True) for task in ("put_block", "lamp_on") for place in range(3)),
    *(asked("agent3d", "put_block", place, place == 0) for place in range(3)),
    *(asked("agent3d", "lamp_on", place, False) for place in range(3)),
]


def test_planners_are_columns_with_their_costs_below():
    relaxed, strict, failures = robot_sheets(BOTH)
    assert relaxed.headings == ("skill", "agent3d"), "in the order of the bench"
    assert text_of(relaxed, "put_block", "agent3d") == ("33.3", "[6, 79] 1/3")
    assert text_of(relaxed, "put_block", "skill") == ("100.0", "[44, 100] 3/3")
    assert text_of(relaxed, "mean over tasks", "agent3d") == ("16.7", "named layouts; 1 of 2 tasks above 0")
    assert text_of(relaxed, "prompt + answer tokens an episode", "agent3d") == ("300 + 12",)
    assert text_of(relaxed, "planning seconds, median", "agent3d") == ("5.0",)
    assert text_of(relaxed, "calls an episode", "skill") == ("0.0",)
    assert text_of(relaxed, "against the first column", "agent3d") == ("too few pairs to show any",)
    assert "tokens" not in "".join(row.label for row in strict.rows), "costs are reported once"
    assert text_of(failures, "abstained", "agent3d") == ("5",)
    assert "300 + 12" in to_markdown(robot_sheets(BOTH))
    assert "300 + 12" in to_latex(robot_sheets(BOTH))


def test_an_episode_that_was_not_measured_counts_nowhere_and_is_reported():
    late = asked("agent3d", "put_block", 3, None, failure="timeout", planning_seconds=900.0)
    relaxed, *_, failures = robot_sheets([*BOTH, late])
    assert text_of(relaxed, "put_block", "agent3d") == ("33.3", "[6, 79] 1/3")
    assert text_of(relaxed, "not measured", "agent3d") == ("1",)
    assert "timeout" not in {row.label for row in failures.rows}
    alone = robot_sheets([asked("skill", "lamp_on", 0, True), asked("agent3d", "lamp_on", 0, None)])[0]
    assert text_of(alone, "lamp_on", "agent3d") == ("not measured",)
    assert text_of(alone, "mean over tasks", "agent3d") == ("not measured",)


def test_cached_answers_fallbacks_and_uncounted_tokens_are_no_savings():
    free = {"calls": 0.0, "prompt_tokens": 0.0, "completion_tokens": 0.0}
    unknown = {"prompt_tokens": None, "completion_tokens": None}
    relaxed = robot_sheets(
        [
            asked("agent3d", "insert_block", 0, True, cached=2.0, **free),
            asked("agent3d, then skill", "open_jar", 0, True, fallback="skill", **unknown),
        ]
    )[0]
    assert text_of(relaxed, "answers from the cache", "agent3d") == ("2",)
    assert text_of(relaxed, "prompt + answer tokens an episode", "agent3d, then skill") == ("not counted",)
    assert text_of(relaxed, "episodes with the fallback", "agent3d, then skill") == ("1",)
    assert text_of(relaxed, "open_jar", "agent3d") == ("not measured",)


def test_episodes_with_second_tries_are_counted_with_their_successes():
    tried = [asked("skill", "put_block", place, place == 0, second_tries=1) for place in (0, 1, 2)]
    relaxed = robot_sheets(
        [*tried, asked("skill", "put_block", 3, True), asked("agent3d", "put_block", 0, True)]
    )[0]
    assert text_of(relaxed, "second tries", "skill") == ("1 of 3 won",)
    assert "second tries" not in {row.label for row in robot_sheets(BOTH)[0].rows}


def test_models_and_arms_are_columns_of_their_own():
    by_two = [*BOTH, asked("agent3d", "lamp_on", 0, True, model="large")]
    assert robot_sheets(by_two)[0].headings == ("skill", "agent3d by small", "agent3d by large")
    taught = [asked("agent3d", "lamp_on", place, place == 0, "on") for place in range(3)]
    relaxed, _, effects, failures = robot_sheets([*BOTH, *taught])
    assert relaxed.headings == ("skill, memory off", "agent3d, memory off", "agent3d, memory on")
    assert text_of(relaxed, "lamp_on", "agent3d, memory on")[0] == "33.3"
    assert failures.headings == relaxed.headings
    assert "planner agent3d, model small" in effects.title
    assert [row.label for row in effects.rows] == ["on against off"]
