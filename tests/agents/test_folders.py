"""Tasks in folders: Terminal-Bench's layout, and errors that name what is wrong with a folder."""

from pathlib import Path

import pytest

from gvla2.agents.tasks import read_tasks
from gvla2.errors import ConfigurationError

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"
ASKED = {"task.toml": "", "instruction.md": "Do it."}
TESTED = {**ASKED, "tests/test.sh": ""}


def make(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def test_our_tasks_are_read_in_families_of_three():
    families = [task.family for task in read_tasks(OURS)]
    assert len(families) >= 24
    assert all(families.count(family) == 3 for family in families)


def test_a_task_has_its_own_limits(tmp_path: Path):
    limits = "[agent]\ntimeout_sec = 30\n[verifier]\ntimeout_sec = 4.5\n[environment]\nstorage_mb = 90\nmemory_mb = 200"
    make(tmp_path / "one", {**TESTED, "task.toml": limits})
    (task,) = read_tasks(tmp_path)
    assert (task.agent_seconds, task.test_seconds, task.disk_mb, task.memory_mb) == (30.0, 4.5, 90, 200)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (ASKED, "has no tests"),
        ({**TESTED, "instruction.md": " "}, "no instruction"),
        ({**TESTED, "task.toml": "= broken"}, "Cannot read a task"),
        ({"task.toml": ""}, "Cannot read a task .*instruction.md"),
        ({**TESTED, "task.toml": "metadata = 3"}, "Cannot read a task"),
        ({**TESTED, "task.toml": "[agent]\ntimeout_sec = -1"}, "above 0"),
        ({**TESTED, "task.toml": "[metadata]\nfiles = '/usr'"}, "not a folder of the task"),
        ({"readme.md": ""}, "No task lies below"),
    ],
)
def test_an_unusable_task_is_an_error(tmp_path: Path, files, message):
    make(tmp_path / "one", files)
    with pytest.raises(ConfigurationError, match=message):
        read_tasks(tmp_path)


def test_missing_and_ambiguous_names_are_errors(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="Available: alarm-east"):
        read_tasks(OURS, ["nothing"])
    for parent in "ab":
        make(tmp_path / parent / "same", TESTED)
    with pytest.raises(ConfigurationError, match="Two tasks are called 'same'"):
        read_tasks(tmp_path)
