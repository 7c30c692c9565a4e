"""Reports of stored results."""

from pathlib import Path

import pytest

from gvla2 import cli
from gvla2.commands.report import ReportConfig, ResultsConfig, job
from gvla2.errors import ConfigurationError
from gvla2.evaluation.results import Cell, Results
from gvla2.plugins.registry import load_plugins


def made(config: ReportConfig, folder: Path) -> int:
    return job(config, load_plugins(), folder)


@pytest.fixture
def url(tmp_path) -> str:
    url = f"sqlite:///{tmp_path / 'results.sqlite'}"
    with Results.open(url) as results:
        for number in range(2):
            run = results.begin("reconstruction", tmp_path, "seed: 0")
            cells = []
            for obj in ("apple", "bowl"):
                for variant, value in (("baseline", 20.0), ("ab_fusion", 10.0 + number)):
                    factors = {"object": obj, "variant": variant, "seed": number, "drift": "none"}
                    key = f"{obj}{variant}{number}"
                    cells.append(Cell(key, factors, {"cd_surface": value}, {"status": "ok"}))
            results.add(run, "reconstruction", cells)
    return url


def test_all_formats(url, tmp_path, capsys):
    assert made(ReportConfig(results=ResultsConfig(url)), tmp_path / "out") == 8
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "index.html",
        "report.csv",
        "report.md",
        "report.tex",
    ]
    out = capsys.readouterr().out
    assert "10.50 ± 0.71" in out
    assert "-47.50 %" in out
    assert "[-47.50" not in out, "two objects have no interval"
    assert "runs 1, 2" in out
    assert "10.50 ± 0.71" in (tmp_path / "out" / "report.md").read_text()


def test_what_is_not_there(url, tmp_path):
    with pytest.raises(ConfigurationError, match=r"object: apple, bowl"):
        made(ReportConfig(results=ResultsConfig(url), where={"object": ["pear"]}), tmp_path)
    with pytest.raises(ConfigurationError, match=r"objekt: no such factor; there are .*object"):
        made(ReportConfig(results=ResultsConfig(url), where={"objekt": ["pear"]}), tmp_path)
    with pytest.raises(ConfigurationError, match="There is no results database"):
        made(ReportConfig(results=ResultsConfig(f"sqlite:///{tmp_path}/none.sqlite")), tmp_path)
    assert not (tmp_path / "none.sqlite").exists()
    with pytest.raises(ConfigurationError, match="No suite 'x'"):
        made(ReportConfig(suite="x", results=ResultsConfig(url)), tmp_path)
    with pytest.raises(ConfigurationError, match="choose among terminal"):
        ReportConfig(formats=["pdf"])


def test_without_a_suite_all_that_are_there_are_shown(tmp_path, capsys):
    url = f"sqlite:///{tmp_path / 'results.sqlite'}"
    with Results.open(url) as results, pytest.raises(ConfigurationError, match="is empty: `gvla2 bench`"):
        made(ReportConfig(results=ResultsConfig(url)), tmp_path)
    with Results.open(url) as results:
        measures = dict.fromkeys(("episodes", "succeeded", "succeeded_strict", "seconds", "tokens"), 1.0)
        run = results.begin("run", tmp_path, "")
        results.add(run, "run", [Cell("job", {"job": 0, "seed": "0"}, measures, {"status": "ok"})])
    made(ReportConfig(results=ResultsConfig(url), formats=["terminal", "markdown"]), tmp_path / "one")
    assert "all jobs" in capsys.readouterr().out
    assert (tmp_path / "one" / "report.md").is_file()
    with pytest.raises(ConfigurationError, match=r"It holds run \(1 cells\)"):
        made(ReportConfig(suite="robot", results=ResultsConfig(url)), tmp_path)
    with Results.open(url) as results:
        run = results.begin("reconstruction", tmp_path, "")
        factors = {"object": "apple", "variant": "baseline", "seed": 0, "drift": "none"}
        results.add(run, "reconstruction", [Cell("c", factors, {"cd_surface": 1.0}, {"status": "ok"})])
    assert made(ReportConfig(results=ResultsConfig(url), formats=["markdown"]), tmp_path / "all") == 2
    assert sorted(file.parent.name for file in (tmp_path / "all").glob("*/report.md")) == [
        "reconstruction",
        "run",
    ]


def test_as_a_command(url, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["report", f"results.url={url}", "formats=[markdown]", "hydra.run.dir=out"]) == 0
    assert Path("out/report.md").is_file()
    assert cli.main(["report", "results.url=sqlite:///gone.sqlite", "hydra.run.dir=out"]) == 1
    assert "gone.sqlite. `gvla2 bench` makes one" in capsys.readouterr().err
