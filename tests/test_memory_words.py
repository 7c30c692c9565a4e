"""What is typed after `gvla2 memory`: names as they are written, pipes, errors as JSON, and what may be overwritten."""

import json
import os
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st

from gvla2 import cli
from gvla2.commands.memory_line import as_typed, understood
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict
from gvla2.record.text import count

LINE = {
    "memory_id": "t",
    "query": "lift",
    "source_status": "success",
    "state": "active",
    "content": "Hold the rim.",
}


def admitted(url: str, content: str, task: str) -> None:
    """A bank of one lesson more, which is believed."""
    with KnowledgeBank(url) as bank:
        bank.admit(
            Lesson("tool_usage", content), Verdict.from_criteria({"done": 1.0}), task=task, trusted=True
        )


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder without anything in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GVLA2_HOME", str(tmp_path / "home"))


def said(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str, str]:
    capsys.readouterr()
    status = cli.main(["memory", *argv])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


def error(capsys: pytest.CaptureFixture[str], *argv: str) -> tuple[int, str]:
    """The status, and the error as JSON, which the message must agree with."""
    status, out, err = said(capsys, *argv, "--json")
    told = json.loads(out)["error"]
    assert told in err
    return status, told


@given(st.text(st.characters(exclude_characters="$", exclude_categories=["Cs"]), max_size=12))
def test_a_name_reaches_hydra_as_it_was_typed(name: str):
    if name[:1] in "'\"" and name[:1] == name[-1:]:
        return  # quotes of its own
    (parsed,) = OverridesParser.create().parse_overrides([as_typed(f"bank={name}")])
    assert parsed.value() == name


@pytest.mark.parametrize(
    "override", ["limit=3", "bank='a'", 'url="sqlite:///x"', "embedder.x=bank=3", "+bank=1"]
)
def test_other_overrides_are_left_alone(override: str):
    assert as_typed(override) == override


def test_banks_called_like_numbers(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    (tmp_path / "m.jsonl").write_text(json.dumps(LINE) + "\n")
    names = ["2026_11", "1e3", "true", "b\u00fccher", "bu\u0308cher"]
    for name in names[:-1]:
        assert said(capsys, "import", "m.jsonl", f"bank={name}")[0] == 0
    assert json.loads(said(capsys, "stats", "--json", f"bank={names[-1]}")[1])["banks"] == sorted(names[:-1])


@pytest.mark.parametrize("verb", [["list"], ["import", "m.jsonl"]])
@pytest.mark.parametrize("name", ["a,b", "a\x1b[31mb", "\u202eab"])
def test_a_name_that_cannot_be(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, verb: list[str], name: str
):
    admitted(f"sqlite:///{tmp_path / 'm.db'}", "Hold the rim.", "lift")
    (tmp_path / "m.jsonl").write_text(json.dumps(LINE) + "\n")
    status, told = error(capsys, *verb, f"bank={name}", f"url=sqlite:///{tmp_path / 'm.db'}")
    assert status == 2
    assert "cannot be the name of a bank" in told
    assert "\x1b" not in told


@pytest.mark.parametrize(
    ("argv", "status", "part"),
    [
        (["lsit"], 2, "Did you mean 'list'?"),
        (["forget", "a"], 2, "needs --yes"),
        (["list", "limit=x"], 1, "'limit' is wrong"),
        (["list", "limti=3"], 1, "Did you mean 'limit'?"),
        (["search", "x", "embedder=nimilm"], 1, "No embedder named 'nimilm'"),
        (["verify", "head=12"], 1, "head=SEQ:HASH"),
        (["list"], 1, "There is no memory at"),
    ],
)
def test_every_error_is_a_document_that_says_what(capsys, argv: list[str], status: int, part: str):
    found, told = error(capsys, *argv)
    assert found == status
    assert part in told


def test_words_after_the_dashes_ask_for_nothing():
    assert understood(["search", "--", "a", "--json"]).json is False
    assert (count(1, "line"), count(0, "line")) == ("1 line", "0 lines")


def test_a_kept_head_is_looked_for(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    url = f"url=sqlite:///{tmp_path / 'm.db'}"
    admitted(url.removeprefix("url="), "Hold the rim.", "lift")
    head = json.loads(said(capsys, "stats", "--json", url)[1])["head"]
    assert head in said(capsys, "stats", url)[1]
    admitted(url.removeprefix("url="), "Turn the lid.", "open")
    assert said(capsys, "verify", f"head={head}", url)[0] == 0
    for other in (head[:-1] + ("0" if head[-1] != "0" else "1"), "99" + head):
        status, out, _ = said(capsys, "verify", f"head={other}", url, "--json")
        assert status == 1
        (problem,) = json.loads(out)["problems"]
        assert problem["where"] == "chain"


def pipe_in(tmp_path: Path, *argv: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "gvla2.cli", "memory", *argv, f"url=sqlite:///{tmp_path / 'p.db'}", "--json"],
        input=json.dumps(LINE) + "\nnonsense\n", capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    return document


@pytest.mark.skipif(os.name != "posix", reason="/dev/stdin is POSIX's")
@pytest.mark.parametrize("path", ["-", "/dev/stdin"])
def test_import_reads_a_pipe(tmp_path: Path, path: str):
    done = pipe_in(tmp_path, "import", path)
    assert len(done["added"]) == 1
    assert [remark["line"] for remark in done["remarks"]] == [2]


def test_an_export_never_takes_the_databases_place(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    admitted(f"sqlite:///{tmp_path / 'm.db'}", "Hold the rim.", "lift")
    before = (tmp_path / "m.db").read_bytes()
    url = f"url=sqlite:///{tmp_path / 'm.db'}"
    for path in ("m.db", "../" + tmp_path.name + "/m.db"):
        status, _, err = said(capsys, "export", path, url)
        assert status == 1
        assert "Choose another path" in err
    assert (tmp_path / "m.db").read_bytes() == before
    assert json.loads(said(capsys, "list", "--json", url)[1])


@pytest.mark.parametrize(
    "argv",
    [
        ["import", "x" * 5000],
        ["export", "x" * 5000, "url=sqlite:///m.db"],
        ["list", f"url=sqlite:///{'x' * 5000}"],
    ],
)
def test_a_name_that_no_file_system_takes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, argv: list[str]
):
    admitted(f"sqlite:///{tmp_path / 'm.db'}", "Hold the rim.", "lift")
    assert error(capsys, *argv)[0] == 1


def test_looking_compiles_nothing(tmp_path: Path):
    """Numba and torch take longer to import than a look takes."""
    admitted(f"sqlite:///{tmp_path / 'm.db'}", "Hold the rim.", "lift")
    code = (
        "import sys; from gvla2 import cli; status = cli.main(sys.argv[1:]); "
        "sys.exit(status or ' '.join({'numba', 'torch', 'sapien'} & set(sys.modules)) or 0)"
    )
    asked = ["memory", "list", f"url=sqlite:///{tmp_path / 'm.db'}"]
    done = subprocess.run([sys.executable, "-c", code, *asked], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_repair_makes_a_foreign_vector_anew(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    url = f"sqlite:///{tmp_path / 'm.db'}"
    with KnowledgeBank(url) as bank:
        for said_ in ("Hold the rim of the cup.", "Turn the lid to the left until it stops."):
            bank.admit(
                Lesson("tool_usage", said_), Verdict.from_criteria({"done": 1.0}), task=said_, trusted=True
            )
    with sqlite3.connect(tmp_path / "m.db") as raw:
        one = raw.execute("SELECT vector FROM memory_vector ORDER BY id LIMIT 1").fetchone()
        raw.execute("UPDATE memory_vector SET vector = ?", one)
    raw.close()
    chosen = (f"url={url}", "embedder=static")
    assert said(capsys, "verify", *chosen)[0] == 1
    status, out, _ = said(capsys, "repair", *chosen, "--json")
    assert (status, len(json.loads(out)["repaired"])) == (0, 1)
    assert said(capsys, "verify", *chosen)[0] == 0


def test_lines_that_were_read_with_a_remark_are_not_among_the_broken(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    odd = LINE | {"memory_id": "u", "content": "Turn the lid.", "memory_type": "recipe"}
    (tmp_path / "active.jsonl").write_text(f"{json.dumps(LINE)}\nnonsense\n{json.dumps(odd)}\n")
    status, out, _ = said(capsys, "import", "active.jsonl", "trusted=true")
    assert status == 1
    assert "trusted=true" not in out
    told = out.splitlines()
    assert told[told.index("1 line could not be read:") + 1].startswith("active.jsonl, line 2: ")
    remark = "active.jsonl, line 3: its type 'recipe' is not known, it was read as procedural_hint"
    assert told[told.index("1 line read with a remark:") + 1] == remark


def test_conflicts_names_open_suspicions(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    url = f"sqlite:///{tmp_path / 'm.db'}"
    admitted(url, "Always open the drawer slowly.", "open the drawer")
    assert said(capsys, "conflicts", f"url={url}")[1].strip() == "No records contradict each other."
    admitted(url, "Never open the drawer slowly.", "open the drawer")
    out = said(capsys, "conflicts", f"url={url}")[1]
    assert "Suspected of it, and not yet judged: tool-" in out
    with KnowledgeBank(url) as bank:
        assert all(record.id in out for record in bank.records())
