"""Every configuration composes, jobs launch and sweep, and what is wrong is said in words."""

import logging
import os
import re
import signal
import subprocess
import sys
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from gvla2.commands import hydra_job
from gvla2.commands.hydra_job import JobFunction, schemas
from gvla2.commands.run import RunConfig
from gvla2.commands.sweeps import SweepFolder
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, UnknownComponentError
from gvla2.plugins.kinds import KINDS
from gvla2.plugins.registry import Registry
from tests.composing import composition, offer

CONF = Path(__file__).parents[1] / "conf"


def composed(*overrides: str, command: str = "run") -> Any:
    config = OmegaConf.to_object(composition(command, *overrides))
    assert isinstance(config, schemas()[command])
    return config


@pytest.fixture(autouse=True)
def _registered(registry: Registry) -> None:
    offer(registry)


@pytest.mark.parametrize("name", schemas())
def test_every_primary_configuration_composes(name: str):
    composed(command=name)


def test_every_file_of_conf_is_a_choice_that_composes():
    files = sorted(p.relative_to(CONF).with_suffix("") for p in CONF.rglob("*.yaml"))
    assert {p.parts[0] for p in files if len(p.parts) == 1} == set(schemas())
    runs: dict[str, list[str]] = {}
    for choice in (p for p in files if len(p.parts) > 1):
        group, name = choice.parent.as_posix(), choice.name
        text = (CONF / choice).with_suffix(".yaml").read_text()
        suite = re.search(r"(?m)override /bench_suite: \w+|^  - \w+$", text)  # itself, or by another preset
        robots = suite and "bench_suite: robot" in text
        assert not robots or "override /conditions: " in text, (
            f"{choice}: its figures must not depend on a default"
        )
        if group == "conditions":
            composed("bench_suite=robot", f"conditions={name}", command="bench")
        elif suite or group in ("bench_suite", "data"):
            composed(f"{group}={name}", command="bench")
        else:
            runs.setdefault(group, []).append(f"{'+' if group == 'experiment' else ''}{group}={name}")
    for row in zip_longest(*runs.values()):  # composing is slow: one of every group at a time
        composed(*filter(None, row))


def test_every_component_is_a_choice(registry: Registry):
    names = {kind: list(registry.components(kind)) for kind in KINDS}
    for row in range(max(map(len, names.values()))):  # composing is slow: one choice of every kind at a time
        chosen = {kind: some[row] for kind, some in names.items() if row < len(some)}
        if len(chosen) > 1:
            config = vars(composed(*(f"{kind}={name}" for kind, name in chosen.items())))
        else:  # the kind with most of them: the group's file alone
            config = OmegaConf.to_object(composition(*(f"{kind}/{name}" for kind, name in chosen.items())))
        for kind, name in chosen.items():
            options = config[kind]
            assert type(options) is registry.get(kind, name).config
            assert options.name == name


@pytest.mark.parametrize(
    "override",
    ["episodes=0", "seed=-1", "depth_noise.kind=fog", "depth_noise.sigma_m=-1", "depth_noise.dropout=1"],
)
def test_values_that_cannot_be_are_refused(override: str):
    asked = composition("run").copy()
    OmegaConf.update(asked, *override.split("="))
    with pytest.raises(ConfigurationError, match=override.partition("=")[0].rpartition(".")[2]):
        OmegaConf.to_object(asked)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(SweepFolder, "latest", None)  # a sweep leaves its folder to the command that began it
    return tmp_path


def launch(command: str, job: JobFunction, argv: list[str]) -> int:
    return hydra_job.launch(command, {command: schemas()[command]}, job, argv)


def job(config: RunConfig, registry: Registry, folder: Path) -> float:
    """A job without a robot: the options of the planner into a file, failures by seed."""
    assert isinstance(config, RunConfig)
    logging.getLogger("job").info("the seed is %d", config.seed)
    if config.seed == 7:
        raise UnknownComponentError("horse", "pegasus", ["shire"])
    if config.seed == 9:
        raise KeyboardInterrupt
    if config.seed == 10:
        os.kill(os.getpid(), signal.SIGTERM)
    assert isinstance(registry.get("planner", config.planner.name).config(), ComponentConfig)
    (folder / "seed").write_text(str(config.seed))
    return float(config.seed)


def test_a_job_gets_a_folder_of_its_own_each_time_and_does_not_chatter(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    assert launch("run", job, ["seed=3"]) == 0
    assert launch("run", job, ["seed=3"]) == 0
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")
    found = sorted(folder.glob("outputs/run/*/*"))
    assert len(found) == 2
    for made in found:
        assert (made / "seed").read_text() == "3"
        assert "the seed is 3" in (made / "run.log").read_text()
        assert "seed: 3" in (made / ".hydra" / "config.yaml").read_text()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["planner=skil"], "No planner named 'skil'. Did you mean 'skill'? Available: "),
        (
            ["depth_noise=l51"],
            "No depth_noise named 'l51'. Did you mean 'l515'? Available: bad, gaussian, l515,",
        ),
        (["planner.lift_hight=1"], "Key 'lift_hight' not in 'SkillConfig'. Did you mean 'lift_height'?"),
        (["sed=3"], "Did you mean 'seed'?"),
        (["seed=1,2"], "--multirun"),
        (["hydra.run.dir=/dev/null/x"], "Not a directory: '/dev/null/x'"),
        (["episodes=0"], "episodes is 0"),
        (["seed=7"], "No horse named 'pegasus'. Available: shire."),
    ],
)
def test_what_is_wrong_is_one_message(
    folder: Path, argv: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert launch("run", job, argv) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert "Traceback" not in captured.err
    assert captured.out == ""
    if argv == ["seed=7"]:
        (log,) = folder.glob("outputs/run/*/*/run.log")
        assert "Traceback" in log.read_text(), "the log keeps that of the job's error"


def test_a_list_for_one_choice_suggests_a_sweep(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert launch("run", job, ["task=[put_block,push_block]"]) == 2
    assert "-m task=put_block,push_block" in capsys.readouterr().err


def test_an_interrupt_and_wrong_usage_have_their_status(folder: Path):
    assert launch("run", job, ["seed=9"]) == 130
    assert launch("run", job, ["--no-such-flag"]) == 2
    before = signal.getsignal(signal.SIGTERM)
    assert launch("run", job, ["seed=10"]) == 143
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("command", "argv", "expected"),
    [
        ("reconstruct", ["--help"], "gvla2 reconstruct views=FOLDER prior=depth"),
        ("run", ["--cfg", "job"], "planner:\n  name: skill\n"),
    ],
)
def test_flags_of_hydra_keep_working(
    folder: Path, command: str, argv: list[str], expected: str, capfd: pytest.CaptureFixture[str]
):
    assert launch(command, job, argv) == 0
    assert expected in capfd.readouterr().out
    assert not (folder / "outputs").exists()


def test_a_sweep_runs_every_job_and_names_the_one_that_failed(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    assert launch("run", job, ["-m", "seed=7,2", "depth_noise=gaussian"]) == 1
    made = sorted(p.parent.name for p in folder.glob("outputs/run/*/*-sweep/*/seed"))
    assert made == ["1_depth_noise=gaussian,seed=2"]
    err = capsys.readouterr().err
    assert "gvla2: job 0: No horse named 'pegasus'. Available: shire.\n" in err
    assert "Traceback" not in err


def test_a_sweep_over_processes(tmp_path: Path):
    """Joblib's workers get the job by name, load the plugins themselves and send errors back in words."""
    (tmp_path / "swept.py").write_text(
        "import sys\nfrom gvla2.commands.hydra_job import launch, schemas\n"
        "from gvla2.errors import UnknownComponentError\n"
        "def job(config, registry, folder):\n"
        "    if config.seed == 7: raise UnknownComponentError('horse', 'pegasus', ['shire'])\n"
        "    name = registry.get('planner', config.planner.name).name\n"
        "    (folder / 'done').write_text(f'{name} {config.planner.lift_height}')\n"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, swept; sys.exit(swept.launch('run', swept.schemas(), swept.job, sys.argv[1:]))",
            "-m",
            "seed=1,7",
            "planner.lift_height=0.2",
            "hydra/launcher=joblib",
            "hydra.launcher.n_jobs=2",
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert "gvla2: No horse named 'pegasus'. Available: shire." in done.stderr
    (made,) = tmp_path.glob("outputs/run/*/*/*/done")
    assert made.read_text() == "skill 0.2"
