"""The notebooks run from top to bottom, in their own folder, as a reader runs them."""

import json
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_three():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda n: n.stem)
def test_it_runs(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    script = tmp_path / f"{notebook.stem}.py"
    script.write_text("\n".join("".join(cell["source"]) for cell in cells))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(FOLDER)
    runpy.run_path(str(script), run_name="__main__")  # warnings are errors
    assert capsys.readouterr().out


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda n: n.stem)
def test_it_was_run_when_it_was_kept(notebook: Path):
    """Whoever only reads sees what came out."""
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert all(cell["execution_count"] for cell in cells)
    assert cells[-1]["outputs"]
    assert not any(output["output_type"] == "error" for cell in cells for output in cell["outputs"])
