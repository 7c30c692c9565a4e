"""Tables that compare: means, changes, the worst object; and their forms."""

import csv
import io
import re
from dataclasses import replace

from gvla2.evaluation.comparison import comparison_sheets
from gvla2.evaluation.results import Cell, Run
from gvla2.evaluation.suites.agents import LAYOUT as AGENTS
from gvla2.evaluation.suites.reconstruction import LAYOUT as RECONSTRUCTION
from gvla2.evaluation.tables import render_report, to_csv, to_latex, to_markdown


def cells() -> list[Cell]:
    """Two objects, two seeds; the branch takes a tenth off the first object's distance, adds 2 % to the other's."""
    made = []
    for obj, base, factor in (("a_mug", 20.0, 0.9), ("bowl", 10.0, 1.02)):
        for seed in (0, 1):
            for variant in ("ab_fusion", "baseline"):
                value = (base + seed) * (factor if variant == "ab_fusion" else 1)
                factors = {"data": "meshes", "baseline": "hull", "drift": "none", "object": obj}
                measures = {"cd_surface": value, "psnr": 20.0, "ssim": None, "seconds": 1.0}
                made.append(
                    Cell(
                        f"{obj}{seed}{variant}",
                        {**factors, "seed": seed, "variant": variant},
                        measures,
                        {"status": "ok"},
                        run=7,
                    )
                )
    return made


def lines(sheet, row: int, heading: str) -> tuple[str, ...]:
    return sheet.rows[row].cells[sheet.headings.index(heading)].lines


def test_means_and_changes():
    (sheet,) = comparison_sheets(cells(), RECONSTRUCTION)
    assert [row.label for row in sheet.rows] == ["baseline, no prior", "A + B fusion"]
    assert sheet.runs == (7,)
    assert lines(sheet, 0, "CD surface ×10³ ↓") == ("15.50 ± 0.71",)
    change = 100 * ((20.5 * 0.9 + 10.5 * 1.02) / 31 - 1)
    assert lines(sheet, 1, "CD surface ×10³ ↓")[1:] == (f"{change:+.2f} %", "could show 102.67 %")
    assert lines(sheet, 1, "PSNR dB ↑") == ("20.00 ± 0.00", "+0.00 %", "could show 0.00 %")
    assert lines(sheet, 1, "SSIM ↑") == ("not measured",)
    assert lines(sheet, 1, "seconds ↓") == ("1.00 ± 0.00",), "seconds are not compared"


def test_an_interval_needs_five_objects_and_colours_only_a_sure_change():
    made = [
        replace(c, key=c.key + name, factors={**c.factors, "object": name})
        for name in "abcde"
        for c in cells()[:4]
    ]
    fused = comparison_sheets(made, RECONSTRUCTION)[0].rows[1].cells[0]
    assert fused.lines[1:] == ("-10.00 % [-10.00, -10.00]", "could show 0.00 %"), "all objects change alike"
    assert fused.tone == "better"


def test_agents_tables_show_what_their_tasks_could_have_shown():
    def row(memory: str, solved: int, tasks: int = 12) -> list[Cell]:
        made = []
        for task in range(tasks):
            factors, done = {"memory": memory, "task": f"t{task}", "seed": 0}, 100.0 * (task < solved)
            made.append(Cell(f"{memory}{task}", factors, {"solved": done}, {"status": "ok"}, 1))
        return made

    def shown(*rows: list[Cell]) -> list[tuple[str, tuple[str, ...]]]:
        (sheet,) = comparison_sheets([cell for some in rows for cell in some], AGENTS)
        return [(line.label, line.cells[0].lines) for line in sheet.rows]

    (_, none), (awm, same), (bank, more) = shown(row("off", 0), row("awm", 0), row("governed", 8))
    assert none == ("0.0",)
    assert (awm, same[1:]) == ("AWM (saturated)", ("+0.00 points [+0.00, +0.00]", "could show 50 points"))
    assert (bank, *more) == (
        "KnowledgeBank", "66.7", "+66.67 points [+41.67, +91.67]", "could show 66 points",
    )  # fmt: skip
    assert shown(row("off", 1, 4), row("governed", 2, 4))[1][1][-1] == "too few pairs to show any"


def test_groups_are_tables_of_their_own_and_failures_are_counted():
    made = cells()
    drifted = [Cell(c.key + "d", {**c.factors, "drift": "planted"}, c.measures, c.notes, 8) for c in made]
    lost = {"cd_surface": None}, {"status": "failed: no mask"}
    failed = Cell("x", {**made[0].factors, "object": "pan"}, *lost, 9)
    first, second = comparison_sheets([*made, *drifted, failed], RECONSTRUCTION)
    assert ("drift none" in first.title, "drift planted" in second.title) == (True, True)
    assert first.runs == (7, 9)
    assert [row.label.endswith("(1 failed)") for row in first.rows] == [False, True]


def test_of_a_cell_measured_twice_the_later_counts():
    made = cells()
    again = Cell("new", made[0].factors, {**made[0].measures, "cd_surface": 100.0}, made[0].notes, run=9)
    (sheet,) = comparison_sheets([again, *made], RECONSTRUCTION)
    mean = (100 + 10 * 1.02 + 21 * 0.9 + 11 * 1.02) / 4
    assert lines(sheet, 1, "CD surface ×10³ ↓")[0].startswith(f"{mean:.2f}")


def test_markdown_has_whole_rows_and_its_own_suites_explanation():
    text = to_markdown(comparison_sheets(cells(), RECONSTRUCTION))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in rows}) == 1
    assert all(words in text for words in ("15.50 ± 0.71", "not measured", "runs 7", "prior"))
    agent = Cell("a", {"memory": "off", "task": "t", "seed": 0}, {"solved": 1.0}, {"status": "ok"}, 1)
    assert "prior" not in to_markdown(comparison_sheets([agent], AGENTS))


def test_latex_escapes_what_it_must():
    needed, _, comment, text = to_latex(comparison_sheets(cells(), RECONSTRUCTION)).split("\n", 3)
    assert needed == r"% \usepackage{booktabs}"
    assert comment.startswith("% ")
    assert not re.search(r"(?<!\\)%", text)
    assert not re.search(r"[±↓↑×]", text)
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 1


def test_the_page_is_self_contained_and_escapes():
    made = cells()
    run = Run(id=7, suite="reconstruction", started="2026", commit="<b>abc", config="seed: 0", versions="{}")
    page = render_report(comparison_sheets(made, RECONSTRUCTION), [run], "Title")
    assert "&lt;b&gt;abc" in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "not measured" in page
    assert "default-src 'none'" in page, "a browser runs nothing that slipped in"


def test_no_cell_of_a_csv_file_is_a_formula():
    factors = {"object": "=cmd|'/C calc'!A0", "@SUM(1)": "+1", "seed": -3}
    rows = list(csv.reader(io.StringIO(to_csv([Cell("k", factors, {"psnr": -1.5}, {"status": "-fail"})]))))
    assert rows == [
        ["object", "'@SUM(1)", "seed", "psnr", "status", "folder"],
        ["'=cmd|'/C calc'!A0", "+1", "-3", "-1.5", "'-fail", ""],
    ]
