"""Forgetting one record reaches what others took over from it: summaries, and records that it was merged into."""

from collections.abc import Callable

import pytest

from gvla2.memory.records import Record, dump
from gvla2.memory.storage.forgetting import ERASED
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.tables import EVENT
from tests.memory.looking import look
from tests.memory.storage.rows_as_json import stored_and_rebuilt

NOW = 1.8e9
Make = Callable[..., Record]


def check_sound(store: Store, *words: str) -> None:
    """The chain holds, the rows are what it says, and no event has these words."""
    assert look(store, "b").verify() == []
    stored, rebuilt = stored_and_rebuilt(store)
    assert stored == rebuilt
    said = [
        text for event in look(store, "b").events() for text in (*event.payload, event.record, event.target)
    ]
    assert not [text for text in said for word in words if word in text]


@pytest.fixture
def summed_up(store: Store, record: Make) -> list[Record]:
    """Four records, archived in favour of a summary that tells them all."""
    with store.writing("b", actor="a", now=NOW) as t:
        members = [
            t.put(record(f"m-{x}", content=f"use PASTE{x}", query=f"polish {x}", state="archive",
                         note="summed up in summary-1"), action="SUMMED_UP")
            for x in "ABCD"
        ]  # fmt: skip
        told = " / ".join(member.content for member in members)
        t.put(record("summary-1", content=told, state="summary"), action="SUMMARY")
        for member in members:
            t.link_many({("summary-1", "summary_of", member.id): f"it says {member.content}"})
    return members


def test_a_summary_goes_with_its_member_and_the_others_speak_again(
    store: Store, summed_up: list[Record]
) -> None:
    with store.writing("b", actor="owner", now=NOW + 1) as t:
        assert t.forget("m-A")
    assert t.forgotten == ["m-A", "summary-1"]
    assert t.also == ["The summary summary-1 included it and was forgotten; active again: m-B, m-C, m-D."]
    assert [(r.id, r.state, r.note) for r in look(store, "b").records()] == [
        (f"m-{x}", "active", "") for x in "BCD"
    ]
    check_sound(store, "PASTEA")


def test_members_forgotten_together_leave_nothing(store: Store, summed_up: list[Record]) -> None:
    with store.writing("b", actor="owner", now=NOW + 1) as t:
        assert len(t.forget(*[member.id for member in summed_up])) == 4
    assert look(store, "b").records() == []
    check_sound(store, "PASTE", "polish")


def test_who_forgets_a_summary_is_told_who_else_says_it(store: Store, summed_up: list[Record]) -> None:
    with store.writing("b", actor="owner", now=NOW + 1) as t:
        assert t.forget("summary-1")
    assert t.also == ["Records merged into it are kept with their own words: m-A, m-B, m-C, m-D."]
    check_sound(store)


def test_a_record_that_took_in_another_is_freed_of_its_wording(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    mine, theirs = ('{"reasons":[],"verifier":"v"}', '{"reasons":["ZEBRA was there"],"verifier":"v"}')
    put(
        record("heir-1", query="fold the towel", provenance='{"sources":["run/1"]}', verifier=mine),
        origin="own:run/1",
    )
    put(
        record("taken-1", state="archive", query="fold PATIENT's towel", provenance='{"sources":["run/PATIENT"]}',
               verifier=theirs, note="merged into heir-1"),
    )  # fmt: skip
    both = dump({"sources": ["run/1", "run/PATIENT"]})
    grown = record("heir-1", query="fold the towel\nfold PATIENT's towel", provenance=both, verifier=theirs,
                   version=1, count=2)  # fmt: skip
    merged = put(grown, action="MERGE", origin="own:run/PATIENT")
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("summary-1", query=merged.query, state="summary"), action="SUMMARY")
        t.link_many({("heir-1", "merged", "taken-1"): "it says the same"})
        t.link_many({("summary-1", "summary_of", "heir-1"): ""})
        t.put(record("grand-1", query=f"tidy up\n{merged.query}", verifier=mine), action="MERGE")
        t.link_many({("grand-1", "merged", "heir-1"): ""})
    with store.writing("b", actor="a", now=NOW + 1) as t:
        assert t.forget("taken-1")
    grand, left = look(store, "b").records()
    assert (grand.id, grand.query) == ("grand-1", "tidy up\nfold the towel")
    assert (left.query, left.sources(), left.count) == ("fold the towel", ("run/1",), 2)
    assert left.verifier_json()["reasons"] == []
    assert "its wording was removed" in t.also[0]
    with store.reading("b") as view:
        assert view.origins(["heir-1"]) == {"heir-1": ["own:run/1"]}
    check_sound(store, "PATIENT", "ZEBRA")


def test_evidence_that_does_not_name_what_was_forgotten_still_counts(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    put(record("heir-1", query="fold it"), origin="own:run/1")
    put(record("taken-1", state="archive", query="fold SECRET"))
    put(record("heir-1", query="fold it\nfold SECRET", version=1), action="MERGE", origin="foreign:lab")
    with store.writing("b", actor="a", now=NOW) as t:
        t.link_many({("heir-1", "merged", "taken-1"): ""})
    with store.writing("b", actor="a", now=NOW) as t:
        assert t.forget("taken-1")
    with store.reading("b") as view:
        assert view.origins(["heir-1"]) == {"heir-1": ["own:run/1", "foreign:lab"]}
    check_sound(store, "SECRET")


def test_instructions_that_are_the_heirs_own_stay(
    store: Store, record: Make, put: Callable[..., Record]
) -> None:
    heir = put(record("heir-1"))
    put(record("taken-1", state="archive"))
    with store.writing("b", actor="a", now=NOW) as t:
        t.link_many({("heir-1", "merged", "taken-1"): ""})
    with store.writing("b", actor="a", now=NOW) as t:
        assert t.forget("taken-1")
    (left,) = look(store, "b").records()
    assert (left.query, left.sources(), left.version) == (heir.query, heir.sources(), 1)
    assert t.also == []


def test_erasing_without_forgetting_is_still_found(
    store: Store, put: Callable[..., Record], record: Make
) -> None:
    put(record("1"))
    with store._database.writing("b") as sql:
        sql.execute(EVENT.update().values(ERASED))
    assert "event 1: it was erased, and nothing was forgotten afterwards." in map(
        str, look(store, "b").verify()
    )
