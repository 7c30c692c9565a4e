"""Tasks in folders: both of Terminal-Bench's layouts, and what is wrong with a folder said in words."""

from pathlib import Path

import pytest

from gvla2.agents.folders import read_tasks
from gvla2.errors import ConfigurationError

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
