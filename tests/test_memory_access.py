"""What the words and numbers of `gvla2 memory` mean, and those that mean nothing."""

import pytest

from gvla2.commands.memory import MemoryCommandConfig
from gvla2.commands.memory_access import WrongWordError, time_of
from gvla2.errors import ConfigurationError


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ("90min", 1e6 - 5400),
        ("2 d ago", 1e6 - 172800),
        ("1.5h", 1e6 - 5400),
        ("1234.5", 1234.5),
        ("1970-01-02T00:00:00Z", 86400),
    ],
)
def test_times(words: str, seconds: float):
    assert time_of(words, now=1e6) == seconds


def test_eight_digits_are_a_date():
    assert time_of("20261121") == time_of("2026-11-21")
    assert time_of("20261121T1830") == time_of("2026-11-21 18:30")
    assert time_of("20261121.0") == 20261121.0
    assert time_of("1763700000") == 1763700000.0


@pytest.mark.parametrize(
    "words", ["", "yesterday", "2026-13-01", "20261301", "99999999", "1e300", "nan", "3 years"]
)
def test_what_is_no_time(words: str):
    with pytest.raises(WrongWordError, match="is no time"):
        time_of(words)


def test_a_time_before_any_bank():
    with pytest.raises(WrongWordError, match="'99999999999999d' ago is before 1970"):
        time_of("99999999999999d")


@pytest.mark.parametrize("days", ["nan", "-1", "inf", "-inf"])
def test_what_is_no_number_of_days(days: str):
    with pytest.raises(ConfigurationError, match="must be a finite number, and not negative"):
        MemoryCommandConfig(archived_days=float(days))
