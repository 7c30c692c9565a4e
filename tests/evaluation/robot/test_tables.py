"""The robot suite's tables from made-up cells."""

from dataclasses import replace

from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.robot_tables import robot_sheets


def cell(
    task: str, arm: str, episode: int, done: bool, profile: str = "relaxed", seed: int = 0, **notes
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
