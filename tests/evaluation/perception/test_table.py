"""Tables of perception: medians, tails and shares; the newer of two measurements counts."""

from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.perception import PerceptionSuite
from gvla2.evaluation.tables import Sheet, to_latex, to_markdown

GROUP = {"robot": "r", "perceiver": "p", "depth_noise": "none", "scale": "1"}


def layout(seed: int, *objects: dict, run: int = 1, task: str = "t", status: str = "ok", **scene) -> Cell:
    factors = {**GROUP, "task": task, "seed": seed, "episode": 0}
    return Cell(f"{task}{seed}.{run}", factors, scene, {"status": status, "seen": list(objects)}, run)


def rows_of(sheet: Sheet) -> dict[str, dict[str, tuple[str, ...]]]:
    return {
        row.label: dict(zip(sheet.headings, (c.lines for c in row.cells), strict=True)) for row in sheet.rows
    }


def test_medians_tails_and_shares():
    cells = []
    for seed in range(20):
        found = seed > 0
        obj = {"found": found, "named": found or None, "centre_mm": float(seed)}
        cells.append(layout(seed, obj, false=0.5, seconds=1.0))
    cells.append(layout(0, {"found": True}, task="u", false=0.0))
    (table,) = PerceptionSuite.sheets(cells)
    rows = rows_of(table)
    assert list(rows) == ["t", "u", "all"]
    assert rows["t"]["found ↑"] == ("95 %", "19 of 20")
    assert rows["t"]["named right ↑"] == ("100 %", "19 of 19")
    assert rows["t"]["centre mm ↓"] == ("9.50", "p95 18.05")
    assert rows["t"]["false a scene ↓"] == ("0.50",)
    assert rows["u"]["named right ↑"] == ("",)
    assert rows["all"]["objects"] == ("21",)


def test_a_newer_run_replaces_the_older():
    old = layout(0, {"found": True}, {"found": False}, run=1)
    (table,) = PerceptionSuite.sheets([layout(0, {"found": False}, run=2), old])
    assert rows_of(table)["t"]["found ↑"] == ("0 %", "0 of 1")
    assert table.runs == (2,)


def test_failed_layouts_are_counted_and_every_format_can_be_made():
    tables = PerceptionSuite.sheets(
        [layout(0, {"found": True}), layout(1, status="failed: no room", task="u")]
    )
    assert "u (1 failed)" in to_markdown(tables)
    assert r"\toprule" in to_latex(tables)
