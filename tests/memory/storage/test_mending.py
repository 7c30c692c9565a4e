"""Forgetting one record reaches what others say of it: summaries, records that took it in, reasons and notes."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.forgetting.mending import rewrite
from gvla2.memory.records import Record, dump
from gvla2.memory.storage.rebuilding import rows_json
from gvla2.memory.storage.store import Store

NOW = 1.8e9
GOOD = Verdict.from_criteria({"done": 1.0}, ["reason ZEBRA"], "v")
HANDLE = "Polish the brass handle slowly using a soft cloth and some {} paste"
Make = Callable[..., Record]


def traces(folder: Path, *words: str) -> list[tuple[str, str]]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return [(path.name, word) for path in files for word in words if word.encode() in path.read_bytes()]


@pytest.fixture
def bank(sqlite_url: str) -> Iterator[KnowledgeBank]:
    with KnowledgeBank.open(sqlite_url, clock=lambda: NOW, options=BankOptions(summary_size=4)) as opened:
        yield opened


def learn(bank: KnowledgeBank, task: str, content: str, source: str) -> None:
    lesson = Lesson("procedural_hint", content)
    bank.learn(MemoryEpisode(MemoryTask(task), (lesson,), transcript=f"said {task}", source=source), GOOD)


def summed_up(bank: KnowledgeBank) -> tuple[Record, list[Record]]:
    for x in "ABCD":
        learn(bank, f"polish handle KAZOO{x}", HANDLE.format(f"PASTE{x}"), f"run/SOURCE{x}")
    (summary,) = bank.records(["summary"])
    members = sorted(bank.records(["archive"]), key=lambda record: record.content)
    assert len(members) == 4
    return summary, members


def check_sound(bank: KnowledgeBank) -> None:
    assert bank.verify() == []
    store = bank._store
    assert store.rebuild("default").json() == rows_json(bank.records(), bank.links())


def test_a_summary_is_built_anew_without_the_member(bank: KnowledgeBank, tmp_path: Path) -> None:
    summary, members = summed_up(bank)
    bank.compact()
    with bank._store.writing("default", actor="owner", now=NOW) as t:
        assert t.forget(members[0].id)
    assert traces(tmp_path, "PASTEA", "KAZOOA", "SOURCEA") == []
    (new,) = bank.records(["summary"])
    assert new.id != summary.id
    assert t.forgotten == [members[0].id, summary.id]
    assert f"{new.id}, without it, took its place" in t.also[0]
    assert all(f"PASTE{x}" in new.content and f"KAZOO{x}" in new.query for x in "BCD")
    assert {r.note for r in bank.records(["archive"])} == {f"summed up in {new.id}"}
    assert {k.target for k in bank.links(new.id)} == {m.id for m in members[1:]}
    assert [item.id for item in bank.recall("polish the brass handle").items] == [new.id]
    check_sound(bank)


def test_too_few_members_are_active_again_and_all_can_go(bank: KnowledgeBank, tmp_path: Path) -> None:
    _, members = summed_up(bank)
    for member in members[:3]:
        assert bank.forget(member.id)
    assert traces(tmp_path, "PASTEA", "PASTEB", "PASTEC", "KAZOOA", "KAZOOB", "KAZOOC") == []
    (left,) = bank.records()
    assert (left.id, left.state, left.note) == (members[3].id, "active", "")
    check_sound(bank)
    assert bank.forget(left.id)
    assert traces(tmp_path, "PASTE", "KAZOO", "ZEBRA", "SOURCE") == []
    assert bank.records() == []
    check_sound(bank)


def test_members_forgotten_together_leave_one_summary(bank: KnowledgeBank, tmp_path: Path) -> None:
    _, members = summed_up(bank)
    with bank._store.writing("default", actor="owner", now=NOW) as t:
        assert all(t.forget(member.id) for member in members[:2])
    (new,) = bank.records(["summary"])
    assert "PASTEC" in new.content
    assert traces(tmp_path, "PASTEA", "PASTEB") == []
    check_sound(bank)


def test_a_record_that_took_in_another_is_freed_of_its_wording(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    mine, theirs = ('{"reasons":[],"verifier":"v"}', '{"reasons":["ZEBRA was there"],"verifier":"v"}')
    heir = put(record("heir-1", query="fold the towel", provenance='{"sources":["run/1"]}', verifier=mine))
    taken = put(
        record("taken-1", state="archive", query="fold PATIENT's towel", provenance='{"sources":["run/PATIENT"]}',
               verifier=theirs, note="merged into heir-1"),
    )  # fmt: skip
    grown = {**{name: getattr(heir, name) for name in ("id", "version")}, "count": 2, "verifier": theirs}
    both = dump({"sources": ["run/1", "run/PATIENT"]})
    put(record(query="fold the towel\nfold PATIENT's towel", provenance=both, **grown), action="MERGE")
    with store.writing("b", actor="a", now=NOW) as t:
        t.link("heir-1", "merged", "taken-1", why="it says the same")
        used = t.get("heir-1")
        assert used is not None
        t.put(
            record("heir-1", query=used.query, provenance=both, version=2, usage=5, count=2, verifier=theirs),
            action="CREDIT",
        )
    with store.writing("b", actor="a", now=NOW + 1) as t:
        assert t.forget(taken.id)
    (left,) = store.records("b")
    assert (left.query, left.sources(), left.usage, left.count) == ("fold the towel", ("run/1",), 5, 2)
    assert left.verifier_json()["reasons"] == []
    assert "freed of its wording" in t.also[0]
    said = [e.why + e.change + e.scores + e.record for e in store.events("b")]
    assert not [text for text in said if "PATIENT" in text or "ZEBRA" in text]
    assert store.verify("b") == []
    assert store.rebuild("b").json() == rows_json(store.records("b"), [])
    (before,) = store.as_of("b", NOW)  # what did not quote is still known of the time before
    assert (before.id, before.usage) == ("heir-1", 5)


def test_instructions_that_are_the_heirs_own_stay(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    heir = put(record("heir-1"))
    put(record("taken-1", state="archive"))
    with store.writing("b", actor="a", now=NOW) as t:
        t.link("heir-1", "merged", "taken-1")
    with store.writing("b", actor="a", now=NOW) as t:
        assert t.forget("taken-1")
    (left,) = store.records("b")
    assert (left.query, left.sources(), left.version) == (heir.query, heir.sources(), 1)
    assert t.also == []


@pytest.mark.parametrize("which", ["loser", "winner"])
def test_numbers_of_a_contradiction_go_with_either_side(
    bank: KnowledgeBank, tmp_path: Path, which: str
) -> None:
    learn(bank, "lift the mug", "Lift the mug by 17 cm before moving", "run/1")
    learn(bank, "lift the mug", "Lift the mug by 5 cm before moving", "run/2")
    (winner,), (loser,) = bank.records(["active"]), bank.records(["archive"])
    assert "0.17" in "".join(e.why for e in bank.history(winner.id))
    gone, left = (loser, winner) if which == "loser" else (winner, loser)
    number = "0.17" if which == "loser" else "0.05 (length)"
    assert bank.forget(gone.id)
    assert traces(tmp_path, number, gone.content) == []
    assert [r.content for r in bank.records()] == [left.content]
    check_sound(bank)


def test_notes_and_reasons_that_repeat_its_words_are_erased(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    secret = "the spare key is under the flowerpot"
    put(record("secret-1", content=secret))
    put(record("other-1", note=f"unlike: {secret}"), why=f"differs from '{secret}'")
    put(record("third-1"), why="nothing like it")
    with store.writing("b", actor="a", now=NOW) as t:
        t.decide("DISCARD", "", why=f"again: {secret}")
        t.forget("secret-1")
    assert not [e for e in store.events("b") if secret in e.why + e.change]
    assert {r.id: r.note for r in store.records("b")} == {
        "other-1": "the reason was forgotten",
        "third-1": "",
    }
    assert [e.why for e in store.history("b", "third-1")] == ["nothing like it"]
    assert store.verify("b") == []
    assert store.rebuild("b").json() == rows_json(store.records("b"), [])


def test_erasing_without_forgetting_is_still_found(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    put(record("1"))
    with store.writing("b", actor="a", now=NOW) as t:
        erase = "UPDATE memory_event SET why = '', scores = '', change = '', salt = ? WHERE bank = 'b'"
        t._sql.run(erase, (b"",))
    assert "event 1: it was erased, and nothing was forgotten afterwards." in map(str, store.verify("b"))


def test_what_was_rewritten_is_forgotten_like_any_other(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    put(record("1", note="SECRET note"))
    with store.writing("b", actor="a", now=NOW) as t:
        first = t.get("1")
        assert first is not None
        rewrite(t, t._sql, first, {1})
    assert store.verify("b") == []
    with store.writing("b", actor="a", now=NOW) as t:
        assert t.forget("1")
    assert not [e for e in store.events("b") if "SECRET" in e.change]
    assert store.verify("b") == []
