"""Tasks in folders: both of Terminal-Bench's layouts, and what is wrong with a folder said in words."""

import json
from pathlib import Path

import pytest

from gvla2.agents.folders import read_tasks, read_trials
from gvla2.errors import ConfigurationError
from gvla2.evaluation.statistics import auc, auc_interval, calibration_error

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"


def made(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        place = folder / name.replace("__", "/").replace("_dot_", ".")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    return folder


def test_our_tasks_are_read_in_families_of_three():
    tasks = read_tasks(OURS)
    assert len(tasks) >= 24
    families = [task.family for task in tasks]
    assert all(families.count(family) == 3 for family in families)


def test_the_first_layout_is_read(tmp_path: Path):
    content = "instruction: Do it.\nmax_agent_timeout_sec: 30\ncategory: files\n"
    made(tmp_path / "one", task_dot_yaml=content)
    (tmp_path / "one" / "tests").mkdir()
    (tmp_path / "one" / "run-tests.sh").write_text("exit 0\n")
    (task,) = read_tasks(tmp_path)
    assert (task.instruction, task.agent_seconds, task.family) == ("Do it.", 30.0, "files")


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"task_dot_toml": "", "instruction_dot_md": "Do it."}, "has no tests"),
        ({"task_dot_toml": "", "instruction_dot_md": " ", "tests__test_dot_sh": ""}, "no instruction"),
        ({"task_dot_toml": "= broken", "instruction_dot_md": "x"}, "cannot be read"),
        ({"task_dot_toml": ""}, "cannot be read"),
        (
            {
                "task_dot_toml": "[agent]\ntimeout_sec = -1",
                "instruction_dot_md": "x",
                "tests__test_dot_sh": "",
            },
            "above 0",
        ),
        (
            {
                "task_dot_toml": "[metadata]\nfiles = '/usr'",
                "instruction_dot_md": "x",
                "tests__test_dot_sh": "",
            },
            "not a folder of the task",
        ),
        ({"task_dot_yaml": "- a list"}, "not hold a mapping"),
        ({"readme_dot_md": ""}, "No task lies below"),
    ],
)
def test_what_is_wrong_with_a_task_is_said(tmp_path: Path, files, message):
    made(tmp_path / "one", **files)
    with pytest.raises(ConfigurationError, match=message):
        read_tasks(tmp_path)


def test_names_that_are_not_there_and_folders_that_are_none(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="Available: all-lines"):
        read_tasks(OURS, ["nothing"])
    with pytest.raises(ConfigurationError, match="not a folder"):
        read_tasks(tmp_path / "missing")


def test_two_tasks_of_one_name_are_refused(tmp_path: Path):
    for parent in "ab":
        made(tmp_path / parent / "same", task_dot_toml="", instruction_dot_md="x", tests__test_dot_sh="")
    with pytest.raises(ConfigurationError, match="Two tasks are called 'same'"):
        read_tasks(tmp_path)


def trial(folder: Path, name: str, resolved: object, log: str = "$ ls\nfile\n") -> None:
    (folder / name / "sessions").mkdir(parents=True)
    content = {"trial_name": name, "task_id": name[0], "instruction": "Do it.", "is_resolved": resolved}
    (folder / name / "results.json").write_text(json.dumps(content))
    (folder / name / "sessions" / "agent.log").write_text(log)


def test_terminal_bench_trials_are_read_without_escapes(tmp_path: Path):
    trial(tmp_path, "a1", True, "\x1b[?2004hroot# ls\x1b[0m\n10%\r100%\n\n")
    trial(tmp_path, "b1", False)
    trial(tmp_path, "c1", None)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "results.json").write_text("{broken")
    first, second = read_trials(tmp_path)
    assert first.account == "root# ls\n100%"
    assert (first.resolved, second.resolved, second.task) == (True, False, "b")


def test_mini_swe_trajectories_take_their_outcome_from_the_report(tmp_path: Path):
    messages = [
        {"role": "system", "content": "s"},
        {"role": "user", "content": "Repair it."},
        {"role": "assistant", "content": "T\n```bash\nls -la\n```"},
        {"role": "user", "content": "<output>x</output>"},
    ]
    for name in ("one", "two"):
        content = {"messages": messages, "info": {"exit_status": "Submitted"}}
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / f"{name}.traj.json").write_text(json.dumps(content))
    with pytest.raises(ConfigurationError, match="known outcome"):
        read_trials(tmp_path)
    (tmp_path / "report.json").write_text(json.dumps({"resolved_ids": ["two"]}))
    first, second = read_trials(tmp_path)
    assert (first.resolved, second.resolved) == (False, True)
    assert first.instruction == "Repair it."
    assert "$ ls -la" in first.account


def test_a_verifiers_ranking_and_calibration():
    scores, truths = [0.1, 0.4, 0.4, 0.8, 0.9, 0.2], [False, True, False, True, True, False]
    assert auc(scores, truths) == pytest.approx(8.5 / 9), "a tie counts half"
    assert auc([0.5, 0.5], [True, True]) is None
    low, high = auc_interval(scores * 5, truths * 5, [str(i // 3) for i in range(30)]) or (0, 0)
    assert low <= 8.5 / 9 <= high
    assert calibration_error([1.0, 1.0, 0.0], [False, False, True]) == pytest.approx(1.0)
    assert calibration_error([0.5, 0.5], [True, False]) == pytest.approx(0.0)
    assert calibration_error([], []) is None
