"""Untrusted text for terminals and tables."""

from gvla2.record.text import one_line, printable


def test_escapes_and_changes_of_direction_go() -> None:
    assert printable("a\x1b[0m\u202eb\nc") == "a [0m b\nc"


def test_one_line_is_cut_at_its_width() -> None:
    assert one_line("a\n\n b" * 100, 10) == "a ba ba b…"
