"""`gvla2 memory`: what each verb answers to people and programs, and what it says when something is wrong."""

import json
import os
import pty
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import hydra
import pytest
from omegaconf import OmegaConf

from gvla2 import cli
from gvla2.commands.memory import MemoryCommandConfig, VerbJob, tell
from gvla2.commands.memory_answers import clock
from gvla2.commands.memory_line import VERBS, UsageError, parser_of, understood
from gvla2.commands.memory_looking import events_listing
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.plugins.registry import Registry

DEFAULTS = {"retriever": "hybrid", "embedder": "static", "verifier": "exit_status"}
GOOD = Verdict.from_criteria({"done": 1.0}, ["it is done"], "test")
BAD = Verdict.from_criteria({"done": 0.0}, ["it slipped"], "test")


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


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(path: Path, capsys: pytest.CaptureFixture[str], registry: Registry) -> Run:
    """A verb, its printing and its exit status, with options set as Hydra would set them: Hydra takes a second."""

    def run_(*argv: str) -> tuple[int, str, str]:
        capsys.readouterr()
        asked = understood(argv)
        given = OmegaConf.from_dotlist([f"url=sqlite:///{path}", *asked.overrides])
        chosen = {kind: given.pop(kind, name) for kind, name in DEFAULTS.items()}
        config = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(MemoryCommandConfig), given))
        for kind, name in chosen.items():
            setattr(config, kind, registry.get(kind, name).config(name=name))
        job = VerbJob(asked)
        job(config, registry, Path())
        status = tell(job, 0)
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return run_


@pytest.fixture
def command(path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """The whole command."""

    def run_(*argv: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = cli.main(["memory", *argv, f"url=sqlite:///{path}"])
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
    status, out, _ = run("list", "limit=1")
    assert "1 of 2 are shown" in out
    assert len(data(run, "list", "limit=1")) == 1
    assert data(run, "list", "states=[archive]") == []


def test_show_and_history_take_the_beginning_of_an_id(run: Run):
    hint = ids(run)["procedural_hint"]
    status, out, _ = run("show", "hint")
    assert status == 0
    assert hint in out
    assert "lift the cup" in out
    shown = data(run, "show", hint)
    assert shown["record"]["verifier"]["criteria"] == {"done": 1.0}
    events = data(run, "history", "hint")
    assert [event["record"] for event in events] == [hint] * len(events)
    assert events[0]["change"]["content"].startswith("Lift the cup")


def test_history_shows_times_as_dates(run: Run, path: Path):
    hint = ids(run)["procedural_hint"]
    with KnowledgeBank(f"sqlite:///{path}") as bank, bank.store.reading("default") as view:
        event = view.history(hint)[-1]
    shown = events_listing(
        [replace(event, change='{"updated": [1795660000.5, 1795663600.5], "used": [0.0, 1e9]}')]
    )
    told = f"updated: {clock(1795660000)} -> {clock(1795663600)}; used: never -> {clock(1e9)}"
    assert shown.rows[0][-1] == told


def test_search_shows_every_term(run: Run):
    found = data(run, "search", "lift", "the", "cup")
    best = found["found"][0]
    assert best["reliable"] is True
    assert {"r_text", "confidence", "success", "recency", "usage", "conflict", "stale"} <= set(best["terms"])
    assert sum(best["terms"].values()) == pytest.approx(best["score"])
    assert json.loads(run("search", "--json", "--", "a=b")[1])["query"] == "a=b"


def test_as_of_goes_back_in_time(run: Run):
    assert data(run, "as-of", "1h") == []
    assert len(data(run, "as-of", "2999-01-01")) == 2
    assert len(data(run, "as-of", "2999-01-01", "avoid")) == 1
    assert run("as-of", "2999-01-01", "nobody")[0] == 1
    status, _, err = run("as-of", "soon")
    assert status == 2
    assert "90min, 3h, 2d" in err


def test_verify_is_one_when_somebody_has_tampered(run: Run, path: Path):
    assert data(run, "verify")["sound"] is True
    with sqlite3.connect(path) as raw:
        raw.execute("UPDATE memory SET content = 'Throw the cup.' WHERE type = 'procedural_hint'")
    raw.close()
    told = data(run, "verify", status=1)
    assert told["problems"]
    status, out, _ = run("verify")
    assert status == 1
    assert "1 problem. Unreadable rows" in out
    assert "rows edited outside gvla2 are used" in out
    assert "Throw the cup." in run("list")[1]  # as that sentence says
    told = data(run, "repair")
    assert (len(told["repaired"]), told["forgotten"], told["problems"]) == (1, [], [])
    assert "Lift the cup" in run("list")[1]
    assert data(run, "verify")["sound"] is True


def test_export_and_import_go_round(run: Run, tmp_path: Path):
    assert run("export", "out")[0] == 0
    assert "never replaces" in run("export", "out")[2]
    assert run("export", "few", "states=[archive]")[0] == 0
    assert "Left out: 2 records" in run("export", "fewer", "states=[archive]")[1]
    made = data(run, "import", "out", "bank=second", "trusted=true")
    assert len(made["added"]) == 2
    assert len(data(run, "list", "bank=second")) == 2
    assert data(run, "import", "out", "bank=second")["known"] == 2
    (tmp_path / "broken.jsonl").write_text(
        '{"memory_id": "w", "content": "Wait.", "state": "active"}\nnonsense\n'
    )
    status, out, _ = run("import", "broken.jsonl", "bank=third")
    assert status == 1
    assert "broken.jsonl, line 2" in out
    assert len(data(run, "list", "bank=third")) == 1


def test_forget_removes_every_byte_and_asks_before(run: Run, path: Path):
    hint = ids(run)["procedural_hint"]
    assert b"Lift the cup by" in path.read_bytes()
    status, _, err = run("forget", hint)  # nobody can be asked: no terminal
    assert status == 2
    assert "--yes" in err
    status, _, err = run("forget", hint[:-1], "--yes")  # what cannot be undone takes no guesses
    assert status == 1
    assert f"a prefix of '{hint}'" in err
    assert len(data(run, "list")) == 2
    assert data(run, "forget", hint, "--yes") == {"forgotten": [hint], "also": []}
    assert not any(b"Lift the cup by" in file.read_bytes() for file in path.parent.glob("m.db*"))
    assert "was forgotten" in run("show", hint)[2]
    assert run("history", hint)[0] == 0
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


def test_upkeep(run: Run):
    assert data(run, "stats")["states"] == {"active": 2}
    assert set(data(run, "govern")) >= {"retired", "replaced", "summaries", "archived"}
    assert data(run, "replay")["promoted"] == []
    assert data(run, "conflicts") == []
    told = data(run, "compact", "archived_days=0")
    assert told["forgotten"] == 0
    assert told["bytes"] > 0


def test_compact_forgets_what_was_archived_for_long(run: Run, tmp_path: Path):
    old = {"content": "Hold the rim.", "created_at": "2020-01-01"}
    rows = [old | {"memory_id": "old"}, {"memory_id": "young", "content": "Hold the base."}]
    (tmp_path / "archive.jsonl").write_text("\n".join(map(json.dumps, rows)))
    run("import", str(tmp_path / "archive.jsonl"), "bank=third", "trusted=true")
    assert data(run, "compact", "bank=third", "archived_days=30")["forgotten"] == 1
    assert [record["content"] for record in data(run, "list", "bank=third")] == ["Hold the base."]


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "usage: gvla2 memory VERB"),
        (["lsit"], "Did you mean 'list'?"),
        (["show"], "arguments are required: ID"),
        (["show", "a", "b"], "unrecognized arguments: b"),
        (["list", "--jsn"], "unrecognized arguments: --jsn"),
        (["list", "--yes"], "unrecognized arguments: --yes"),
        (["list", "-m", "bank=a,b"], "unrecognized arguments: -m"),
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
        (["import", "nowhere"], "nothing at"),
        (["export", "no/such/folder"], "Cannot write"),
    ],
)
def test_what_is_not_there_is_said(run: Run, argv: list[str], message: str):
    found, out, err = run(*argv)
    assert (found, out) == (1, "")
    assert message in err


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["list", "limti=3"], "Did you mean 'limit'?"),
        (["list", "states=[actve]"], "States: active"),
        (["search", "x", "embedder=nimilm"], "No embedder named 'nimilm'"),
    ],
)
def test_wrong_options_are_explained_as_in_other_commands(command: Run, argv: list[str], message: str):
    found, out, err = command(*argv)
    assert (found, out) == (1, "")
    assert message in err


def test_the_whole_command(command: Run, tmp_path: Path):
    status, out, err = command("list", "--json", "states=[active]")
    assert (status, err, len(json.loads(out))) == (0, "", 2)
    status, out, err = command("search", "cup", "retriever=semantic", "limit=1", "--json")
    assert (status, err) == (0, "")
    assert len(json.loads(out)["found"]) == 1
    assert json.loads(command("list", "--json", "bank=nobody")[1])["error"].startswith("No bank 'nobody'")
    assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith((".", "m.db"))) == []


def test_an_error_is_a_json_document_too(run: Run):
    assert "No record 'zzz'" in data(run, "show", "zzz", status=1)["error"]


def test_looking_makes_no_database(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["memory", "list"]) == 1
    assert "There is no memory at" in capsys.readouterr().err
    assert not (tmp_path / "home").exists()


def test_a_corrupt_file_and_a_locked_one_are_explained(tmp_path: Path, run: Run, path: Path, capsys):
    bad = tmp_path / "bad.db"
    bad.write_bytes(b"not a database, but long enough to be read as one" * 40)
    assert cli.main(["memory", "list", f"url=sqlite:///{bad}"]) == 1
    assert "corrupt" in capsys.readouterr().err
    hint = ids(run)["procedural_hint"]
    holder = sqlite3.connect(path, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    status, _, err = run("forget", hint, "--yes", "busy_seconds=0.2")
    holder.execute("ROLLBACK")
    holder.close()
    assert status == 1
    assert "locked" in err or "busy" in err


def test_a_reader_that_leaves_is_no_traceback(path: Path):
    with KnowledgeBank(f"sqlite:///{path}") as bank:
        words = ("lift", "turn", "push", "cut", "fold", "wipe", "stack", "pour")
        for i in range(64):
            told = f"{words[i % 8]} thing number {i} {words[(i // 8) % 8]}wards"
            bank.admit(Lesson("tool_usage", told), GOOD, task=told, source=f"s/{i}", trusted=True)
    done = subprocess.run(
        f"{sys.executable} -m gvla2.cli memory list --json limit=0 url=sqlite:///{path} | head -c 10",
        shell=True, executable="/bin/bash", capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


@pytest.mark.parametrize("verb", ["", *VERBS])
def test_each_verb_has_help(verb: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["memory", *([verb] if verb else []), "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: gvla2 memory {verb or 'VERB'}")
    assert "bank=NAME" in out
    assert out == parser_of(verb).format_help()
    if verb:
        assert callable(VERBS[verb].load())


def test_flags_of_hydra_keep_working(command: Run):
    status, out, _ = command("--cfg", "job")
    assert status == 0
    assert "bank: default" in out


def test_words_flags_and_overrides_are_told_apart():
    asked = understood(["search", "a", "bank=x", "--json", "+y=1", "--", "c=d", "--json"])
    assert asked.words == ["a", "c=d", "--json"]
    assert asked.overrides == ["bank=x", "+y=1"]
    assert asked.json
    with pytest.raises(UsageError):
        understood(["search", "  "])


def test_a_look_composes_its_configuration_once(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    composed: list[object] = []
    compose = hydra.compose
    monkeypatch.setattr(hydra, "compose", lambda *asked: composed.append(asked) or compose(*asked))
    assert cli.main(["memory", "stats", f"url=sqlite:///{path}", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["states"] == {"active": 2}
    assert cli.main(["memory", "stats", f"url=sqlite:///{path}", "limit=1,2"]) == 1
    assert "limit" in capsys.readouterr().err
    assert len(composed) == 2
    assert cli.main(["memory", "stats", "--cfg", "job"]) == 0  # Hydra's own flags are Hydra's
    assert len(composed) == 2
