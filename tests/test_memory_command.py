"""`gvla2 memory`: what each verb answers to people and programs, and its messages when something is wrong."""

import json
import os
import pty
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gvla2 import cli
from gvla2.commands.memory import VERBS
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict

GOOD = Verdict.from_criteria({"done": 1.0}, ["it is done"], "test")
BAD = Verdict.from_criteria({"done": 0.0}, ["it slipped"], "test")
RISE = {"kind": "prior", "parameter": "lift_height", "value": 0.3, "sd": 0.0, "count": 1}
LINE = {
    "id": "t",
    "query": "lift",
    "outcome": "verified_success",
    "state": "active",
    "content": "Hold the rim.",
}
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder without anything in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GVLA2_HOME", str(tmp_path / "home"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A bank with a hint, and a constraint from a failure."""
    file = tmp_path / "m.db"
    with KnowledgeBank(f"sqlite:///{file}") as bank:
        for number, (words, verdict) in enumerate(
            (
                (Lesson("procedural_hint", "Lift the cup by its \x1b[31mrim[/bold] slowly."), GOOD),
                (Lesson("failure_avoidance", "Never grasp the bottle at its neck."), BAD),
            )
        ):
            task = MemoryTask("lift the cup" if verdict is GOOD else "open the bottle")
            for run in (number, number + 2):  # what hides something is believed when it has been right twice
                bank.learn(MemoryEpisode(task, (words,), "a transcript", source=f"run/{run}"), verdict)
    return file


@pytest.fixture
def run(path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """The whole command."""

    def run_(*argv: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = cli.main(["memory", *argv, f"url=sqlite:///{path}", "embedder=static"])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return run_


def data(run: Run, *argv: str, status: int = 0) -> Any:
    """The one JSON document that a verb prints."""
    found, out, _ = run(*argv, "--json")
    assert found == status
    return json.loads(out)


def ids(run: Run) -> dict[str, str]:
    return {record["type"]: record["id"] for record in data(run, "list")}


def test_list_shows_records_and_no_control_characters(run: Run):
    status, out, err = run("list")
    assert (status, err) == (0, "")
    assert "Lift the cup by its" in out
    assert "[/bold]" in out
    assert "\x1b" not in out
    assert len(data(run, "list")) == 2
    assert "1 of 2 are shown" in run("list", "limit=1")[1]
    assert len(data(run, "list", "limit=1")) == 1


def test_show_takes_the_beginning_of_an_id(run: Run):
    hint = ids(run)["procedural_hint"]
    status, out, _ = run("show", "hint")
    assert status == 0
    assert hint in out
    assert "lift the cup" in out
    shown = data(run, "show", hint)
    assert shown["record"]["verifier"]["criteria"] == {"done": 1.0}
    events = shown["events"]
    assert [event["record"] for event in events] == [hint] * len(events)
    assert events[0]["change"]["content"].startswith("Lift the cup")


def test_search_shows_every_term(run: Run):
    found = data(run, "search", "lift", "the", "cup")
    best = found["found"][0]
    assert best["reliable"] is True
    assert {"r_text", "confidence", "success", "recency", "usage", "conflict", "stale"} <= set(best["terms"])
    assert sum(best["terms"].values()) == pytest.approx(best["score"])
    assert "recalled" in run("search", "lift", "the", "cup")[1]


def test_a_lesson_is_shown_with_its_number_and_what_is_passed_over_with_why(run: Run, path: Path):
    learned = Lesson("procedural_hint", "Lift the cup: this lift height succeeded.", RISE)
    with KnowledgeBank(f"sqlite:///{path}") as bank:
        bank.admit("Lift the cup by its handle.", source="a colleague")
        bank.learn(MemoryEpisode(MemoryTask("lift the cup"), (learned,), "", source="run/9"), GOOD)
    assert "succeeded. (lift_height 0.3, sd 0, once)" in " ".join(run("list")[1].split())
    assert "Passed over: provisional" in run("search", "lift", "the", "cup")[1]


def test_verify_is_one_when_somebody_has_tampered(run: Run, path: Path):
    sound = data(run, "verify")
    assert (sound["sound"], sound["states"]) == (True, {"active": 2})
    head = sound["head"]
    assert head in run("verify")[1]
    assert run("verify", f"head={head}")[0] == 0
    assert data(run, "verify", f"head=99{head}", status=1)["problems"][0]["where"] == "chain"
    with sqlite3.connect(path) as raw:
        raw.execute("UPDATE memory SET content = 'Throw the cup.' WHERE type = 'procedural_hint'")
    raw.close()
    status, out, _ = run("verify")
    assert status == 1
    assert "1 problem." in out


def test_export_and_import_go_round(run: Run, tmp_path: Path):
    assert run("export", "out")[0] == 0
    assert "never replaces" in run("export", "out")[2]
    before = (tmp_path / "m.db").read_bytes()
    assert "Choose another path" in run("export", "m.db")[2]
    assert (tmp_path / "m.db").read_bytes() == before
    made = data(run, "import", "out", "bank=second", "trusted=true")
    assert len(made["added"]) == 2
    assert len(data(run, "list", "bank=second")) == 2
    assert data(run, "import", "out", "bank=second")["known"] == 2
    (tmp_path / "broken.jsonl").write_text(f"{json.dumps(LINE)}\nnonsense\n")
    status, out, _ = run("import", "broken.jsonl", "bank=third")
    assert status == 1
    assert "broken.jsonl, line 2" in out
    assert len(data(run, "list", "bank=third")) == 1


@pytest.mark.skipif(os.name != "posix", reason="/dev/stdin is POSIX's")
def test_import_reads_a_pipe(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-m", "gvla2", "memory", "import", "-", f"url=sqlite:///{tmp_path}/p.db", "--json"],
        input=f"{json.dumps(LINE)}\nnonsense\n",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    document = json.loads(done.stdout)
    assert len(document["held_back"]) == 1
    assert "line 2: " in document["broken"][0]


def test_forget_removes_a_record_and_asks_before(run: Run, path: Path):
    hint = ids(run)["procedural_hint"]
    status, _, err = run("forget", hint)  # nobody can be asked: no terminal
    assert status == 1
    assert "--yes" in err
    status, _, err = run("forget", hint[:-1], "--yes")  # what cannot be undone takes no guesses
    assert status == 1
    assert hint in err
    assert len(data(run, "list")) == 2
    assert data(run, "forget", hint, "--yes")["forgotten"] == [hint]
    assert len(data(run, "list")) == 1
    assert "was forgotten" in run("show", hint)[2]
    assert data(run, "verify")["sound"] is True


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are POSIX's")
@pytest.mark.parametrize(("answer", "status", "left"), [("n\n", 1, 2), ("\n", 1, 2), ("y\n", 0, 1)])
def test_forget_takes_an_answer_from_a_terminal(run: Run, answer: str, status: int, left: int, monkeypatch):
    master, slave = pty.openpty()
    os.write(master, answer.encode())
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        found, _, err = run("forget", "hint")
    os.close(master)
    assert found == status
    assert "cannot be undone" in err
    assert len(data(run, "list")) == left


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "usage: gvla2 memory"),
        (["lsit"], "choose from"),
        (["show"], "arguments are required: ID"),
        (["show", "a", "b"], "unrecognized arguments: b"),
        (["list", "--yes"], "unrecognized arguments: --yes"),
        (["forget", "a", "--json"], "needs --yes"),
    ],
)
def test_wrong_usage(argv: list[str], message: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["memory", *argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["show", "hnit-00"], "No record 'hnit-00'"),
        (["list", "bank=defualt"], "Did you mean 'default'? Banks: default."),
        (["list", "bank=a,b"], "cannot be the name of a bank"),
        (["import", "nowhere"], "nothing at"),
        (["import", "x" * 5000], "nothing at"),
        (["export", "no/such/folder"], "Cannot write"),
    ],
)
def test_what_is_missing_is_named(run: Run, argv: list[str], message: str):
    found, out, err = run(*argv)
    assert (found, out) == (1, "")
    assert message in err
    assert message in data(run, *argv, status=1)["error"]


def test_an_option_chooses_the_retriever(run: Run, tmp_path: Path):
    status, out, err = run("search", "cup", "retriever={name: hybrid, top_k: 1}", "limit=1", "--json")
    assert (status, err) == (0, "")
    assert len(json.loads(out)["found"]) == 1
    assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith((".", "m.db"))) == []


def test_banks_are_called_as_typed(run: Run, tmp_path: Path):
    (tmp_path / "m.jsonl").write_text(json.dumps(LINE) + "\n")
    names = ["2026_11", "1e3", "true", "b\u00fccher"]
    for name in names:
        assert run("import", "m.jsonl", f"bank={name}")[0] == 0
    assert data(run, "verify", "bank=bu\u0308cher")["banks"] == sorted([*names, "default"])


def test_looking_makes_no_database_and_compiles_nothing(tmp_path: Path):
    """Numba and torch take longer to import than a look takes."""
    code = (
        "import sys; from gvla2 import cli; status = cli.main(sys.argv[1:]); "
        "sys.exit(' '.join({'numba', 'torch', 'sapien'} & set(sys.modules)) or status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "memory", "list"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith("gvla2: There is no memory at")
    assert not (tmp_path / "home").exists()


@pytest.mark.parametrize("verb", ["", *VERBS])
def test_each_verb_has_help(verb: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["memory", *([verb] if verb else []), "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: gvla2 memory {verb}".strip())
    assert not verb or "bank=NAME" in out
