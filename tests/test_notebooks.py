"""The notebooks run from top to bottom, in their own folder, as a reader runs them."""

import json
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda n: n.stem)
def test_it_runs(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    if "gymnasium" in notebook.read_text():
        pytest.importorskip("gymnasium", reason="pip install 'gvla2[gym]'")
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    script = tmp_path / f"{notebook.stem}.py"
    script.write_text("\n".join("".join(cell["source"]) for cell in cells))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(FOLDER)
    runpy.run_path(str(script), run_name="__main__")  # warnings are errors
    assert capsys.readouterr().out
