"""What an export may replace: an earlier export, and never a database, a device or somebody's file."""

import json
import os
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from gvla2.errors import OutputError
from gvla2.memory.interop.exporting import export_path
from gvla2.memory.interop.importing import import_path
from gvla2.memory.storage.store import Store

NOW = 1.8e9
ROW = {"task_id": "t", "task_text": "lift", "outcome": "success", "memory_text": "Hold the rim."}


@pytest.fixture
def store(tmp_path: Path):
    source = tmp_path / "in.jsonl"
    source.write_text(json.dumps(ROW) + "\n")
    with Store.open(f"sqlite:///{tmp_path / 'm.db'}") as opened:
        import_path(opened, "b", source, trusted=True, now=NOW)
        yield opened


def refused(store: Store, path: Path, layout: str = "robot", match: str = "Choose another path") -> None:
    before = path.read_bytes() if path.is_file() and not path.is_symlink() else None
    with pytest.raises(OutputError, match=match):
        export_path(store, "b", path, layout=layout, overwrite=True)
    assert before is None or path.read_bytes() == before


@pytest.mark.parametrize("name", ["m.db", "m.db-wal", "m.db-shm", "m.db-journal", ".m.db.lock"])
@pytest.mark.parametrize("layout", ["robot", "items", "states"])
def test_the_open_database_and_what_belongs_to_it(store: Store, tmp_path: Path, name: str, layout: str):
    refused(store, tmp_path / name, layout, "Choose another path")
    assert len(store.records("b")) == 1


@pytest.mark.skipif(os.name != "posix", reason="links need privileges elsewhere")
def test_the_database_by_other_names(store: Store, tmp_path: Path):
    (tmp_path / "link.jsonl").symlink_to(tmp_path / "m.db")
    (tmp_path / "hard.jsonl").hardlink_to(tmp_path / "m.db")
    (tmp_path / "folder").symlink_to(tmp_path)
    (tmp_path / "real").mkdir()
    for name in ("link.jsonl", "hard.jsonl", "folder/m.db", "real/../m.db"):
        refused(store, tmp_path / name, match="the database that is to be exported")
    assert (tmp_path / "link.jsonl").is_symlink()
    assert store.verify("b") == []


def test_other_databases_and_files(store: Store, tmp_path: Path):
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as raw:
        raw.execute("CREATE TABLE t (x)")
    raw.close()
    refused(store, other, match="no export of the layout 'robot'")
    refused(store, tmp_path / "other.db-wal", match="belongs to the database")
    notes = tmp_path / "notes.txt"
    notes.write_text(json.dumps(ROW) + "\nand what I think of it\n")
    refused(store, notes, match="line 2")
    refused(store, tmp_path / "in.jsonl", "items", "layout 'items'")  # another layout's


def test_a_folder_with_foreign_content_under_our_names(store: Store, tmp_path: Path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "active.jsonl").write_text("my notes\n")
    refused(store, folder, "states", "active.jsonl is no export")
    assert (folder / "active.jsonl").read_text() == "my notes\n"


@pytest.mark.skipif(os.name != "posix", reason="devices and pipes are POSIX's")
def test_devices_and_pipes_stay(store: Store, tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "null").symlink_to("/dev/null")
    for path in (pipe, Path("/dev/null"), tmp_path / "null"):
        refused(store, path, match="a device, a pipe or a socket")
        refused(store, path, "states", "a device, a pipe or a socket")
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "active.jsonl").symlink_to(tmp_path / "in.jsonl")
    refused(store, folder, "states", "a link")
    assert Path("/dev/null").is_char_device()
    reader, writer = os.pipe()
    refused(store, Path(f"/dev/fd/{writer}"), match="no file that could be replaced")
    os.close(reader)
    os.close(writer)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    refused(store, tmp_path / "loop")


@pytest.mark.parametrize("layout", ["robot", "items", "states"])
def test_an_earlier_export_is_replaced_even_through_a_link(store: Store, tmp_path: Path, layout: str):
    target, link = tmp_path / "export", tmp_path / "link"
    export_path(store, "b", target, layout=layout)
    with pytest.raises(OutputError, match="overwrite=true"):
        export_path(store, "b", target, layout=layout)
    link.symlink_to(target)
    done = export_path(store, "b", link, layout=layout, overwrite=True)
    assert link.is_symlink()
    assert all(file.is_relative_to(target) for file in done.files)


def test_an_empty_file_is_replaced_when_told(store: Store, tmp_path: Path):
    empty = tmp_path / "empty.jsonl"
    empty.touch()
    with pytest.raises(OutputError, match="overwrite=true"):
        export_path(store, "b", empty, layout="robot")
    assert export_path(store, "b", empty, layout="robot", overwrite=True).records == 1


def test_a_record_of_a_clock_gone_wrong_is_exported(store: Store, tmp_path: Path):
    (record,) = store.records("b")
    with store.writing("b", actor="test", now=NOW) as tx:
        tx.put(replace(record, created=1e300, used=1e300, usage=1), action="change")
    for layout in ("states", "items", "robot"):
        assert export_path(store, "b", tmp_path / layout, layout=layout).records == 1
    with Store.open(f"sqlite:///{tmp_path / 'second.db'}") as second:
        assert len(import_path(second, "b", tmp_path / "states", now=NOW).added) == 1
