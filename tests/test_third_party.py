"""The example distributions, installed as a stranger would: listed, composed, swept, conforming."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gvla2 import cli
from tests.quick import QUICK

SMALL = ("quiet=true", "robot.image_size=128", "robot.video_size=16", "robot.video_fps=1")
EXAMPLES = Path(__file__).parents[1] / "examples"
EXAMPLE, TASK = EXAMPLES / "third_party", EXAMPLES / "third_party_task"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The distributions in a folder of their own, from copies: a build leaves files beside its source."""
    folder = tmp_path_factory.mktemp("third_party")
    target = folder / "site"
    subprocess.run(["cp", "-r", str(EXAMPLE), str(TASK), str(folder)], check=True)
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"),
            *("--disable-pip-version-check", "--target", str(target)),
            *(str(folder / source.name) for source in (EXAMPLE, TASK)),
        ],
        check=True,
    )
    return target


@pytest.fixture
def python(installed: Path, tmp_path: Path):
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(installed)},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.fixture
def gvla2(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    """The command in this process, where the distributions are found as long as the test lasts."""
    monkeypatch.syspath_prepend(installed)
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(arguments, cli.main(list(arguments)), *capfd.readouterr())

    return run


def test_it_is_listed_with_its_options(gvla2):
    done = gvla2("plugins", "planner")
    assert done.returncode == 0, done.stderr
    row = next(line.split() for line in done.stdout.splitlines() if "Hovers above" in line)
    assert row[:2] == ["planner", "hover"]
    assert "hover (gvla2-hover 0.1.0)" in done.stdout
    assert "planner.height" in done.stdout
    assert "broken" not in done.stdout


def test_its_skill_is_offered_beside_the_standard_ones(gvla2):
    done = gvla2("plugins", "skill")
    assert done.returncode == 0, done.stderr
    listed = {words[0]: words for line in done.stdout.splitlines() if (words := line.split())}
    assert "hover_skill" in listed["tap"]
    assert "standard_skills" in listed["pick"]


def test_they_conform(python):
    tests = [str(example / "tests") for example in (EXAMPLE, TASK)]
    done = python("-m", "pytest", "-q", "-p", "no:cacheprovider", *tests)
    assert done.returncode == 0, done.stdout
    assert "3 passed" in done.stdout


def test_it_runs_in_a_sweep(gvla2, tmp_path: Path):
    """Two real episodes in the simulator: the planner's preset and its defaults."""
    memory = f"memory.url=sqlite:///{tmp_path / 'memory.db'}"
    done = gvla2("run", "-m", "planner=hover,hover_high", "quiet=true", *QUICK, memory)
    assert done.returncode == 0, done.stderr
    results = [json.loads(p.read_text()) for p in sorted(tmp_path.glob("outputs/run/*/*/*/result.json"))]
    assert [r["planner"] for r in results] == ["hover", "hover"]
    assert [r["parameters"] for r in results] == [{"height": 0.12}, {"height": 0.3}]
    assert [r["success"] for r in results] == [False, False], "hovering lifts nothing"
    assert {r["failure"]["kind"] for r in results} == {"goal_not_reached"}


def test_its_task_is_listed(gvla2):
    done = gvla2("plugins", "task")
    assert done.returncode == 0, done.stderr
    row = next(line for line in done.stdout.splitlines() if "the ball of the named colour" in line)
    assert row.split()[:2] == ["task", "ball_in_bowl"]
    assert "bowl (gvla2-bowl 0.1.0)" in row
    assert "task.ball " in done.stdout


def test_its_task_runs(gvla2, tmp_path: Path):
    """Seen, planned and done by the reference plugins, which never heard of it."""
    memory = f"memory.url=sqlite:///{tmp_path / 'memory.db'}"
    done = gvla2("run", "task=ball_in_bowl", "seed=2", *SMALL, memory)
    assert done.returncode == 0, done.stderr
    (result,) = [json.loads(p.read_text()) for p in tmp_path.glob("outputs/run/*/*/result.json")]
    assert result["task"] == "ball_in_bowl"
    assert result["success"] is True, result["failure"]


def test_its_task_is_an_environment(python):
    pytest.importorskip("gymnasium", reason="pip install 'gvla2[gym]'")
    code = (
        "import gymnasium; "
        "env = gymnasium.make('gvla2.gym:gvla2/ball_in_bowl-v0', image_size=32, task_options={'ball': 0.06}); "
        "print(env.reset(seed=1)[1]['instruction'])"
    )
    done = python("-W", "error", "-c", code)
    assert done.returncode == 0, done.stderr
    assert "bowl" in done.stdout
