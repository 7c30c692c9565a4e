"""``gvla2 bench suite=memory`` from end to end, small: rows, resuming, what is not here, progress, nothing left."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.bench import run_bench
from gvla2.commands.bench_config import BenchConfig, DataConfig, MemoryBenchConfig, ResultsConfig
from gvla2.commands.primary import PRIMARY
from gvla2.commands.report import ReportConfig
from gvla2.commands.report import job as make_report
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.memory import suite
from gvla2.evaluation.memory.figure import Figure, FigureRow, NotMeasuredError, Test
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import Registry

WANTED = {"test", "n", "value", "unit", "peer", "peer_value", "goal", "passed", "status"}


def config_for(tmp_path: Path, *tests: str, **memory: Any) -> BenchConfig:
    return BenchConfig(
        suite="memory",
        memory=MemoryBenchConfig(tests=list(tests), scale=memory.pop("scale", 0.001), **memory),
        results=ResultsConfig(f"sqlite:///{tmp_path / 'results.sqlite'}"),
        data=DataConfig(root=None),
        quiet=True,
    )


@pytest.fixture(autouse=True)
def _no_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GVLA2_DATA", raising=False)


@pytest.fixture(scope="module")
def catalog(registry: Registry) -> Registry:
    return registry


def rows_of(folder: Path) -> list[dict[str, Any]]:
    return json.loads((folder / "result.json").read_text())["rows"]


def test_rows_formats_and_resuming(
    tmp_path: Path, catalog: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    config = config_for(tmp_path, "governance", "start", "retrieval", "quality")
    config.quiet = False
    share = run_bench(config, catalog, tmp_path / "first")
    rows = rows_of(tmp_path / "first")
    assert all(row.keys() >= WANTED for row in rows)
    by_name = {(row["test"], row["on"], row["n"]): row for row in rows}
    assert len(by_name) == len(rows)
    assert [row["n"] for row in rows if row["test"] == "retrieval_p95"] == [50, 100, 200]
    assert by_name["start", "", 200]["passed"] is True
    assert by_name["start", "", 200]["unit"] == "s"
    assert by_name["start", "", 200]["peer"] == "JSONL, linear"
    unmeasured = [row for row in rows if row["status"] != "ok"]
    assert {row["test"] for row in unmeasured} == {"evidence"}
    assert all(row["value"] is None and row["passed"] is None for row in unmeasured)
    assert all(row["status"].startswith("not measured: no locomo10.json") for row in unmeasured)
    assert share == pytest.approx(1 - len(unmeasured) / len(rows))
    left = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert left == ["index.html", "report.md", "report.tex", "result.json"], "no database is left behind"
    out = capsys.readouterr()
    for text in (out.out, *((tmp_path / "first" / name).read_text() for name in left[:2])):
        assert "Recall, end to end, p95" in text
        assert "JSONL, linear" in text
        assert "not measured" in text
        assert "goals reached" in text
    assert r"$\leq$" in (tmp_path / "first" / "report.tex").read_text()
    assert "0:00 left" in out.err

    config.quiet = True
    run_bench(config, catalog, tmp_path / "second")
    measured = [row for row in rows if row["status"] == "ok"]
    again = [row for row in rows_of(tmp_path / "second") if row["status"] == "ok"]
    assert again == measured, "the same numbers to the last digit: nothing was measured again"
    config.results.fresh = True
    config.memory.tests = ["start"]
    run_bench(config, catalog, tmp_path / "third")
    assert {row["run"] for row in rows_of(tmp_path / "third")} == {3}

    report = ReportConfig(suite="memory", results=ResultsConfig(config.results.url), formats=["markdown"])
    assert make_report(report, catalog, tmp_path / "report") == len(rows)
    text = (tmp_path / "report" / "report.md").read_text()
    places = [text.index(title) for title in ("Recall, end to end", "Start of a bank", "Evidence")]
    assert places == sorted(places), "in the order of the suite"


def fake(name: str, measure: Any, **more: Any) -> Test:
    return Test(name, (FigureRow(name, name.capitalize(), "ms", "lower", 1.0),), measure, 100, **more)


def test_what_is_finished_survives_an_interruption(
    tmp_path: Path, catalog: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def first(setting: Any, size: int, on: str) -> Mapping[str, Figure]:
        calls.append("first")
        (setting.folder / "large.db").write_bytes(b"0" * 1000)
        return {"first": Figure(0.5, "peer", 2.0)}

    def second(setting: Any, size: int, on: str) -> Mapping[str, Figure]:
        calls.append("second")
        if calls.count("second") == 1:
            raise KeyboardInterrupt
        return {"second": Figure(2.0)}

    monkeypatch.setattr(suite, "TESTS", (fake("first", first), fake("second", second)))
    config = config_for(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        run_bench(config, catalog, tmp_path / "first")
    assert not list((tmp_path / "first").iterdir()), "the scratch folder is gone"
    run_bench(config, catalog, tmp_path / "second")
    assert calls == ["first", "second", "second"]
    one, two = rows_of(tmp_path / "second")
    assert (one["run"], one["passed"], two["run"], two["passed"]) == (1, True, 2, False)


def test_a_test_that_fails_is_a_row_and_the_others_go_on(
    tmp_path: Path, catalog: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(setting: Any, size: int, on: str) -> Mapping[str, Figure]:
        raise Gvla2Error("the disk is full")

    def absent(setting: Any, size: int, on: str) -> Mapping[str, Figure]:
        raise NotMeasuredError("no server")

    def sound(setting: Any, size: int, on: str) -> Mapping[str, Figure]:
        return {"sound": Figure(0.5, "peer", 4.0)}

    tests = (fake("broken", broken), fake("absent", absent), fake("sound", sound))
    monkeypatch.setattr(suite, "TESTS", tests)
    assert run_bench(config_for(tmp_path), catalog, tmp_path / "out") == pytest.approx(1 / 3)
    status = [row["status"] for row in rows_of(tmp_path / "out")]
    assert status == ["failed: the disk is full", "not measured: no server", "ok"]
    text = (tmp_path / "out" / "report.md").read_text()
    assert "4.00 ms" in text
    assert "the disk is full" in text


def test_the_folder_for_databases_is_made_and_stays(tmp_path: Path, catalog: Registry) -> None:
    home = tmp_path / "of" / "databases"
    run_bench(config_for(tmp_path, "start", folder=str(home)), catalog, tmp_path / "out")
    assert list(home.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tests": ["retreival"]}, "No test 'retreival'. Available: retrieval"),
        ({"folder": "/dev/null/at/all"}, "memory.folder is '/dev/null/at/all'"),
    ],
)
def test_what_is_not_there_is_said_before_anything_runs(
    tmp_path: Path, catalog: Registry, changes: dict[str, Any], message: str
) -> None:
    config = config_for(tmp_path)
    for name, value in changes.items():
        setattr(config.memory, name, value)
    with pytest.raises(ConfigurationError) as told:
        run_bench(config, catalog, tmp_path / "out")
    assert message in str(told.value)
    config = config_for(tmp_path, "quality")
    config.data.root = str(tmp_path)
    with pytest.raises(ConfigurationError, match=r"contains neither locomo10\.json"):
        run_bench(config, catalog, tmp_path / "out")


@pytest.mark.parametrize("changes", [{"scale": 0.0}, {"scale": 1.5}, {"seed": -1}])
def test_nonsense_in_the_configuration(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        MemoryBenchConfig(**changes)


def test_the_configuration_composes(catalog: Registry) -> None:
    register(catalog, PRIMARY)
    chosen = ["+experiment=memory_figures", "memory.tests=[start]", "memory.scale=0.1"]
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("bench", overrides=[chosen[0].lstrip("+"), *chosen[1:]]))
    assert isinstance(config, BenchConfig)
    assert config.suite == "memory"
    assert config.memory == MemoryBenchConfig(["start"], 0.1)
