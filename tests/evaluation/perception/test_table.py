"""Tables of perception: medians, tails, shares, and rows of objects that are there no more."""

from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.perception import PerceptionSuite
from gvla2.evaluation.tables import Sheet, to_latex, to_markdown

GROUP = {"robot": "r", "perceiver": "p", "depth_noise": "none", "scale": "1"}


def layout(seed: int, *objects: dict, run: int = 1, task: str = "t", **scene) -> list[Cell]:
    factors = {**GROUP, "task": task, "seed": seed, "episode": 0}
    key = f"{task}{seed}.{run}"
    cells = []
    for obj in objects:
        own = {**factors, "object": obj["name"], "kind": obj.get("kind", "cube")}
        numbers = {name: value for name, value in obj.items() if name not in ("name", "kind")}
        cells.append(Cell(f"{key}/{obj['name']}", own, numbers, {"status": "ok"}, run))
    notes = {"status": "ok", "objects": [cell.key for cell in cells], **scene.pop("notes", {})}
    return [Cell(key, {**factors, "object": "scene", "kind": "scene"}, scene, notes, run), *cells]


def rows_of(sheet: Sheet) -> dict[str, dict[str, tuple[str, ...]]]:
    return {
        row.label: dict(zip(sheet.headings, (c.lines for c in row.cells), strict=True)) for row in sheet.rows
    }


def test_medians_tails_and_shares():
    cells = []
    for seed in range(20):
        found = float(seed > 0)
        obj = {
            "name": "a",
            "found": found,
            "iou": 0.9 if seed else 0.1,
            "label": found,
            "centre_mm": float(seed),
        }
        cells += layout(seed, obj, false=0.5, seconds=1.0)
    cells += layout(0, {"name": "b", "kind": "cup", "found": 1.0, "iou": 0.8}, task="u", false=0.0)
    by_task, by_kind = PerceptionSuite.sheets(cells)
    rows = rows_of(by_task)
    assert list(rows) == ["t", "u", "all"]
    row = rows["t"]
    assert row["found ↑"] == ("95 %", "19 of 20")
    assert row["mask IoU ↑"] == ("0.90", "p95 0.86"), "the worst of twenty is near the least"
    assert row["centre mm ↓"] == ("9.5", "p95 18.1")
    assert row["false a scene ↓"] == ("0.50",)
    assert row["missed most"] == ("cube: 1 of 20",)
    assert rows["u"]["label ↑"] == ("",)
    assert rows["all"]["objects"] == ("21",)
    kinds = rows_of(by_kind)
    assert list(kinds) == ["cube", "cup", "all"]
    assert "seconds ↓" not in kinds["cup"]


def test_what_a_newer_run_saw_replaces_the_old():
    old = layout(0, {"name": "a", "found": 1.0}, {"name": "gone", "found": 0.0}, run=1)
    new = layout(0, {"name": "a", "found": 0.0}, run=2)
    (table, _) = PerceptionSuite.sheets([*new, *old])
    assert rows_of(table)["t"]["found ↑"] == ("0 %", "0 of 1")
    assert table.runs == (2,)


def test_failed_layouts_are_counted_and_every_format_can_be_made():
    failed = layout(1, notes={"status": "failed: no room"}, task="u")
    tables = PerceptionSuite.sheets([*layout(0, {"name": "a", "found": 1.0}), *failed])
    assert "u (1 failed)" in to_markdown(tables)
    assert r"\toprule" in to_latex(tables)
