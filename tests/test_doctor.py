"""`gvla2 doctor`: a whole installation is well, and each kind of breakage is found and gets advice."""

import json
from pathlib import Path

import pytest

from gvla2 import cli
from gvla2.commands import checkup, doctor
from gvla2.commands.checkup import Check
from gvla2.commands.probe import imports
from gvla2.plugins.discovery import PluginProblem
from gvla2.plugins.registry import Registry, load_plugins


def test_this_installation_is_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    status = doctor.main(["--json"])
    told = json.loads(capsys.readouterr().out)
    failed = [c for c in told["checks"] if c["status"] == "fail"]
    assert (status, told["healthy"], failed) == (0, True, [])
    names = {c["name"] for c in told["checks"]}
    assert {"configuration run", "robot sapien_panda", "memory governed", "planner skill", "cv2"} <= names


def test_the_table_has_advice(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    found = [Check("a", "ok", "fine"), Check("b", "fail", "gone [really]", "pip install 'b[x]'")]
    monkeypatch.setattr(checkup, "examine", lambda registry: found)
    assert doctor.main([]) == 1
    out = capsys.readouterr().out
    assert "gone [really]" in out
    assert "-> pip install 'b[x]'" in out
    assert "broken" in out.splitlines()[-1]


@pytest.mark.parametrize(
    ("commands", "last"),
    [
        (
            [("bench",), ("reconstruct",)],
            "`gvla2 reconstruct`, `gvla2 bench` needs is broken; the default run can go.",
        ),
        ([("run",), ("bench",)], "`gvla2 run`, `gvla2 bench` needs is broken."),
    ],
)
def test_the_last_line_says_which_command_is_broken(
    commands: list[tuple[str, ...]],
    last: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    found = [Check("a", "fail", "gone", "", names) for names in commands]
    monkeypatch.setattr(checkup, "examine", lambda registry: [Check("x", "warn", "w", "", ("data",)), *found])
    assert doctor.main([]) == 1
    assert " ".join(capsys.readouterr().out.split()).endswith(last)


def test_a_default_without_its_plugin_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("GVLA2_DISABLE_PLUGINS", "skill")
    composed, blamed, checks = checkup.configurations(load_plugins())
    assert "run" not in composed
    assert blamed == {"planner"}
    (check,) = [c for c in checks if c.name == "configuration run"]
    assert check.status == "fail"
    assert "No planner named 'skill'." in check.found
    assert "GVLA2_DISABLE_PLUGINS skips: skill" in check.found


@pytest.mark.parametrize(
    ("problem", "blamed", "status"),
    [
        (PluginProblem("p", "", "could not be loaded"), set(), "warn"),
        (PluginProblem("p", "", "could not be loaded"), {"planner"}, "fail"),
        (PluginProblem("p", "gvla2_planners", "failed"), {"planner"}, "fail"),
        (PluginProblem("p", "gvla2_tasks", "failed"), {"planner"}, "warn"),
        (PluginProblem("p", "gvla2_planner", "is no hook"), {"planner"}, "fail"),
    ],
)
def test_a_broken_plugin_fails_only_when_the_default_misses_it(
    problem: PluginProblem, blamed: set[str], status: str
):
    _, check = checkup.plugins(Registry({}, [], [problem]), blamed)
    assert check.status == status
    assert "GVLA2_DISABLE_PLUGINS=p" in check.advice


def test_a_missing_system_library_is_named():
    fault = "ImportError: libX11.so.6: cannot open shared object file: No such file or directory"
    checks = {
        c.name.split()[0]: c
        for c in checkup.needed_modules({"sapien": fault, "ompl": "ModuleNotFoundError: x"})
    }
    assert checks["sapien"].status == "fail"
    assert checks["sapien"].advice == "Install the system's libX11: apt install libx11-6"
    assert checks["ompl"].advice == "pip install 'gvla2[sim]'"
    assert all(c.status == "fail" for c in checkup.needed_modules({"crash": "exit status -11"}))


def test_a_probe_that_dies_is_reported(monkeypatch: pytest.MonkeyPatch):
    assert "exit status 1" in checkup.probe("no_such_probe")["crash"]
    monkeypatch.setattr(checkup, "PROBE_SECONDS", 0.001)
    assert "no answer within" in checkup.probe("imports", "json")["slow"]


def test_imports_are_probed_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "leaves_early.py").write_text("raise SystemExit('bye')")
    monkeypatch.syspath_prepend(tmp_path)
    answer = imports(["json", "no_such_module", "leaves_early"])
    assert answer["json"] == ""
    assert answer["no_such_module"].startswith("ModuleNotFoundError")
    assert answer["leaves_early"] == "SystemExit: bye"


@pytest.mark.parametrize(
    ("owners", "status"),
    [
        ({}, "ok"),
        ({"opencv-python": "5.0"}, "ok"),
        ({"opencv-python": "5.0", "opencv-python-headless": "5.0"}, "ok"),
        ({"opencv-python": "5.0", "opencv-python-headless": "4.9"}, "warn"),
    ],
)
def test_two_versions_of_cv2_are_a_warning(
    owners: dict[str, str], status: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(checkup, "installed", lambda name: owners.get(name, ""))
    check = checkup.opencv()
    assert check.status == status
    assert all(name in check.found for name in owners)


def test_a_component_that_cannot_be_built_fails():
    answer = {"memory": {"name": "governed", "error": "the database is locked", "seconds": 0.1}}
    (check,) = checkup.components("memory", answer)
    assert (check.name, check.status, check.found) == ("memory governed", "fail", "the database is locked")
    assert "memory.url=" in check.advice
    (check,) = checkup.components("run", answer)
    assert check.status == "warn", "a run goes on without memory"
    (check,) = checkup.components("run", {"crash": "exit status -11"})
    assert check.status == "fail"


def test_an_output_folder_that_cannot_be_written_fails(tmp_path: Path):
    composed, _, _ = checkup.configurations(load_plugins())
    composed["run"].hydra.run.dir = str(tmp_path / "deep" / "below")
    (check,) = checkup.output_folders({"run": composed["run"]})
    assert (check.status, check.found) == ("ok", f"{tmp_path} is writable")
    composed["run"].hydra.run.dir = "/proc/1/outputs"
    (check,) = checkup.output_folders({"run": composed["run"]})
    assert check.status == "fail"


def test_optional_parts_never_fail():
    assert checkup.torch_device(None).status == "ok"
    assert checkup.torch_device({"version": "2.9", "device": "cpu"}).found == "2.9 on cpu"
    assert checkup.torch_device({"crash": "ImportError"}).status == "warn"


def test_wrong_usage(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["doctor", "--fix"]) == 2
    assert "unrecognized arguments: --fix" in capsys.readouterr().err
    assert cli.main(["doctor", "--help"]) == 0


def test_what_is_slow_is_not_called_broken(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], registry: Registry
):
    monkeypatch.setattr(checkup, "PROBE_SECONDS", 0.01)
    checks = checkup.examine(registry)
    slow = {check.name for check in checks if check.status == "slow"}
    assert {"libraries", "components of run", "torch"} <= slow
    assert checkup.healthy(checks)
    monkeypatch.setattr(checkup, "examine", lambda _: checks)
    assert doctor.main([]) == 0
    assert "Nothing is broken, but some checks gave no answer in time." in capsys.readouterr().out
