"""`gvla2 doctor`: a whole installation is healthy, and each kind of breakage is found and gets advice."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from pathlib import Path

import pytest

from gvla2 import cli
from gvla2.commands import doctor
from gvla2.plugins.discovery import PluginProblem
from gvla2.plugins.registry import Registry, load_plugins


def test_this_installation_is_healthy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registry: Registry):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    checks = doctor.examine(registry)
    assert not [check for check in checks if check.status == "fail"]
    found = {check.name: check.found for check in checks}
    assert "planner=skill" in found["default run"]
    assert "can be imported" in found["simulator"]
    assert version("gvla2") in found["packages"]
    assert "llm" in found["extras"].partition("; not:")[0]


def test_the_table_has_advice_and_a_failure_its_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    found = [
        doctor.Check("a", "ok", "fine"),
        doctor.Check("b", "fail", "gone [really]", "pip install 'b[x]'"),
    ]
    monkeypatch.setattr(doctor, "examine", lambda registry: found)
    assert doctor.main([]) == 1
    out = capsys.readouterr().out
    assert "gone [really]" in out
    assert "-> pip install 'b[x]'" in out


def test_a_default_without_its_plugin_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("GVLA2_DISABLE_PLUGINS", "skill")
    (check,) = doctor.configuration(load_plugins())
    assert check.status == "fail"
    assert "No planner named 'skill'." in check.found
    assert "GVLA2_DISABLE_PLUGINS skips: skill" in check.found


def test_a_bank_that_cannot_be_opened_is_a_warning(tmp_path: Path, monkeypatch, registry: Registry):
    monkeypatch.setenv("GVLA2_HOME", str(tmp_path))
    (tmp_path / "memory.db").write_bytes(b"this is no database" * 100)
    checks = {check.name: check for check in doctor.configuration(registry)}
    assert checks["memory"].status == "warn", "a run goes on without memory"
    assert "memory.url=" in checks["memory"].advice


def test_a_module_of_the_simulator_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch):
    check = doctor.simulator(["json", "no_such_module"])
    assert (check.status, "no_such_module" in check.found) == ("fail", True)
    monkeypatch.setattr(doctor, "PROBE_SECONDS", 0.001)
    assert "no answer within" in doctor.simulator(["json"]).found


def test_nothing_in_the_current_folder_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Neither by the probe nor by a worker process of a sweep or bench."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    for module in ("sapien", "multiprocessing", "socket"):
        (tmp_path / f"{module}.py").write_text("open('RAN', 'w')")
    doctor.simulator(["sapien"])
    assert not (tmp_path / "RAN").exists()
    assert cli.main(["--version"]) == 0
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(abs, -1).result() == 1
    assert not (tmp_path / "RAN").exists()


def test_a_broken_plugin_is_named():
    _, check = doctor.plugins(Registry({}, [], [PluginProblem("p", "gvla2_planners", "failed")]))
    assert (check.status, check.found) == ("warn", "gvla2_planners: failed")
    assert "GVLA2_DISABLE_PLUGINS=p" in check.advice
