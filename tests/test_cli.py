"""The command line: dispatch, help at once, and `gvla2 plugins`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gvla2 import __version__, cli
from gvla2.commands import doctor
from gvla2.errors import kept_alive
from gvla2.plugins.kinds import KINDS

HEAVY = {"numpy", "scipy", "torch", "sapien", "ompl", "numba", "pinocchio"}


def test_help_names_the_commands(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"  {name}" in out for name in cli.COMMANDS)
    assert cli.main([]) == 2
    assert capsys.readouterr().err == out
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"gvla2 {__version__}\n"


def test_an_unknown_command_names_its_neighbour_and_an_interrupt_has_its_status(monkeypatch, capsys):
    assert cli.main(["rum"]) == 2
    assert "no command 'rum'. Did you mean 'run'?" in capsys.readouterr().err

    def interrupted(argv: list[str]) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(doctor, "main", interrupted)
    assert cli.main(["doctor"]) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "status", "message"),
    [
        ("run pick_and_lift", 1, "'pick_and_lift' missing EQUAL at '<EOF>'. Options are KEY=VALUE"),
        ("run -i lift the cube", 1, "a sentence needs quotes"),
        ("run --task push_block", 2, "an option has no dashes: task=push_block"),
        ("reconstruct --views=here", 2, "an option has no dashes: views=here"),
        ("bench robot tasks=lamp_on", 1, "gvla2: tasks is a list: tasks=[lamp_on].\n"),
        ("run robot.cameras=front", 1, "robot.cameras is a list: robot.cameras=[front]."),
        ("bench robot task=lamp_on", 1, "This command has no such choice"),
        ("run experiment=learnable", 1, "To append to your default list use +experiment=learnable"),
        ("run policy=nowhere", 1, "There is no folder of a checkpoint of that name either."),
        ("tasks robot=sapien", 1, "No robot named 'sapien'. Did you mean 'sapien_arm'?"),
        ("tasks robot.nothing=1", 1, "Key 'nothing' not in"),
        ("run planner.parameters={standof:1}", 1, "no parameter 'standof'. Did you mean 'standoff'?"),
        ("run fallback=skill fallback.parameters={standoff:9}", 1, "fallback.parameters: standoff is 9 m"),
    ],
)
def test_what_is_mistyped_is_named_with_the_right_way(tmp_path, monkeypatch, capsys, argv, status, message):
    monkeypatch.chdir(tmp_path)
    words = argv.split()
    assert cli.main(words) == status
    assert message in capsys.readouterr().err


def test_ctrl_c_within_compiled_code_is_ctrl_c():
    with pytest.raises(KeyboardInterrupt), kept_alive():
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
    with pytest.raises(SystemError), kept_alive():
        raise SystemError("bad call")


def test_light_commands_load_nothing_heavy():
    code = (
        "import sys\nfrom gvla2.cli import main\nfor line in sys.argv[1:]:\n    status = main(line.split())\n"
        "    print(status, *sorted(m for m in sys.modules if '.' not in m), file=sys.stderr)"
    )
    lines = ["--help", "--version", "plugins", "plugins task"]
    done = subprocess.run([sys.executable, "-c", code, *lines], capture_output=True, text=True, check=True)
    for line, answer in zip(lines, done.stderr.splitlines(), strict=True):
        status, *modules = answer.split()
        assert status == "0", line
        assert not HEAVY & set(modules), line


def test_a_reader_that_left_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "gvla2.cli", "plugins"],
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writing)
    assert done.returncode == 141
    assert not done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("argv", [["--help"], ["plugins", "task"]])
def test_a_full_disk_is_no_traceback(argv: list[str]):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gvla2.cli", *argv],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("gvla2: cannot write: ")
    assert len(done.stderr.splitlines()) == 1


def test_plugins_lists_every_component(registry, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["plugins"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for kind in KINDS:
        for name, component in registry.components(kind).items():
            assert any(kind in line and name in line and component.summary in line for line in lines), name
    assert not any("broken" in line for line in lines)


def test_plugins_of_a_kind_have_their_options(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["plugins", "task", "push_block"]) == 0
    assert "task.scale float 1.0" in " ".join(capsys.readouterr().out.split())
    assert cli.main(["plugins", "planner", "skill"]) == 0
    out = capsys.readouterr().out
    assert "``lift_height`` is how far an object is lifted" in out, "options of a base class are explained"
    assert "those of SkillOptions." in out


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["planr"], "Did you mean 'planner'?"),
        (["planner", "skil"], "Did you mean 'skill'?"),
        (["planner", "skill", "more"], "unrecognized arguments: more"),
        (["--yaml"], "unrecognized arguments: --yaml"),
        (["color=red"], "No kind of component is called 'color=red'"),
    ],
)
def test_plugins_refuses_what_it_does_not_know(
    argv: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["plugins", *argv]) == 2
    assert message in capsys.readouterr().err


def test_plugins_lists_the_broken_and_exits_well(tmp_path, monkeypatch, capsys: pytest.CaptureFixture[str]):
    info = tmp_path / "bad-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[gvla2]\nbad = a_module_that_is_not_there\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert cli.main(["plugins"]) == 0
    out = capsys.readouterr().out
    assert "No module named 'a_module_that_is_not_there'" in out


def test_a_sweep_is_asked_for_among_overrides(tmp_path, monkeypatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reconstruct", "views=nowhere", "-m", "fusion=none,blend", "views_spec=0"]) == 1
    answer = capsys.readouterr().err
    assert "nowhere" in answer
    assert "unrecognized" not in answer
    assert list(tmp_path.glob("outputs/reconstruct/*/*-sweep"))
