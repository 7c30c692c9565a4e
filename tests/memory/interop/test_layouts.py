"""The released layout: what a line means."""

import json
from pathlib import Path

import pytest

from gvla2.memory.curation.trust import Origin
from gvla2.memory.interop.importing import read_path
from gvla2.memory.interop.states import LineError, ReadRecord, count, number, parse, read_record, to_bytes

NOW = 1.8e9


def understood(fields: dict[str, object], file: str = "active.jsonl") -> ReadRecord:
    """As one's own backup: states stay what they were."""
    return read_record(fields, file, "b", NOW, Origin(True, "backup"))


STATE_RECORD: dict[str, object] = {
    "memory_id": "django-1-0-ab",
    "task_id": "django-1",
    "query": "fix the migration",
    "content": "Run the tests after each change.",
    "memory_type": "tool_usage",
    "source_status": "verified_success",
    "state": "active",
    "confidence": 0.62,
    "quality_score": 0.81,
    "created_at": "2026-05-01T10:00:00+00:00",
    "last_used_at": None,
    "use_count": 3,
    "dedup_key": "tool_usage:run tests",
    "supersedes": [],
    "conflicts_with": ["other"],
    "embedding": None,
    "verifier_score": 0.81,
    "verifier_confidence": 0.62,
    "verifier_label": "verified_success",
    "verifier_criteria": {"root cause": 0.9},
    "verifier_model": "judge",
}


def test_a_record_of_the_states_layout_is_understood():
    entry = understood(STATE_RECORD, "archive.jsonl")
    record = entry.record
    assert (entry.key, record.sources(), record.query) == (
        "django-1-0-ab",
        ("django-1",),
        "fix the migration",
    )
    assert (record.type, record.outcome, record.state) == ("tool_usage", "verified_success", "archive")
    assert (record.confidence, record.quality, record.usage) == (0.62, 0.81, 3)
    assert record.created == 1777629600.0
    assert entry.links["conflict"] == ("other",)
    assert record.verifier_json()["criteria"] == {"root cause": 0.9}


@pytest.mark.parametrize(
    ("status", "outcome"),
    [
        ("success", "verified_success"),
        ("verified_success", "verified_success"),
        ("SUCCESS ", "verified_success"),
        (True, "verified_success"),
        ("fail", "verified_fail"),
        ("failure", "verified_fail"),
        ("verified_fail", "verified_fail"),
        (False, "verified_fail"),
        ("uncertain", "uncertain"),
        (None, "uncertain"),
        ("maybe", None),
    ],
)
def test_both_vocabularies_of_a_status(status: object, outcome: str | None):
    entry = understood(STATE_RECORD | {"verifier_label": None, "source_status": status})
    assert entry.record.outcome == (outcome or "uncertain")
    assert bool(entry.notes) is (outcome is None)


def test_a_recipe_from_a_failure_becomes_something_to_avoid():
    fields = STATE_RECORD | {"memory_type": "procedural_hint", "verifier_label": "verified_fail"}
    assert understood(fields).record.type == "failure_avoidance"


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"content": "x"}, "'memory_id' is missing"),
        ({"memory_id": "a", "content": "  "}, "'content' is missing or empty"),
        ({"memory_id": "a", "content": ["x"]}, "'content' is not text"),
        ({"memory_id": "a", "content": "x", "query": {}}, "'query' is not text"),
    ],
)
def test_what_is_no_record_says_why(fields: dict[str, object], why: str):
    with pytest.raises(LineError, match=why):
        understood(fields)


def test_a_single_file_needs_a_state():
    with pytest.raises(LineError, match="'gone'"):
        understood(STATE_RECORD | {"state": "gone"}, "bank.jsonl")
    assert understood(STATE_RECORD, "bank.jsonl").record.state == "active"


def test_every_kind_of_broken_line_is_named_and_the_others_read(tmp_path: Path):
    path = tmp_path / "bank.jsonl"
    good = json.dumps({"memory_id": "a", "content": "Lift slowly."})
    path.write_bytes(
        b"\xef\xbb\xbf"
        + good.encode()
        + b'\n\n{"a": NaN}\n[1]\n{"a":\n"text"\n\xff\xfe\n'
        + b"[" * 100_000
        + b"\n"
        + good.encode()
    )
    lines, remarks = read_path(path)
    assert [place for _, place, _ in lines] == [1, 9]
    assert [remark.line for remark in remarks] == [3, 4, 5, 6, 7, 8]
    told = " ".join(map(str, remarks))
    for why in ("NaN is not a JSON number", "not a JSON object", "it is not a JSON object", "not UTF-8"):
        assert why in told
    assert "bank.jsonl, line 3" in told


@pytest.mark.parametrize(
    ("value", "seconds"),
    [("2026-05-01T10:00:00Z", 1777629600.0), ("2026-05-01T10:00:00", 1777629600.0), (1777629600, 1777629600.0),
     ("soon", None), (True, None), (-5, None), ([1], None), (1e300, None)],
)  # fmt: skip
def test_times(value: object, seconds: float | None):
    entry = understood(STATE_RECORD | {"created_at": value})
    assert entry.record.created == (NOW if seconds is None else seconds)


@pytest.mark.parametrize(
    "value", [10**400, -(10**400), float("inf"), float("nan"), 1e300, True, None, "7", []]
)
def test_numbers_beyond_all_bounds(value: object):
    assert number(value, 0.0, 1.0) in (None, 1.0)
    assert 0 <= count(value) <= 2**53
    assert number(value) in (None, 1e300)


def test_lines_that_readers_would_cut_or_databases_refuse():
    text = to_bytes([{"content": "a\u2028b\x85c"}]).decode()
    assert text.splitlines() == [text.rstrip("\n")]
    assert parse(text.encode()) == {"content": "a\u2028b\x85c"}
