"""Trust by origin: one of ours is enough, of others it takes two, and nobody's own word counts twice."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.memory.curation.trust import LEVELS, Origin, adds, believed, least, trust_of

OURS, LAB, CLUB = Origin(True, "episode-7"), Origin(False, "lab"), Origin(False, "club")
ORIGINS = st.lists(
    st.builds(Origin, st.just(False), st.sampled_from(["lab", "lab/1", "Lab#2", "lab:x@y", " lab "]))
)


def test_levels() -> None:
    assert trust_of([OURS]) == "own"
    assert trust_of([LAB]) == trust_of([]) == "foreign"
    assert trust_of([LAB, CLUB]) == "confirmed"
    assert trust_of([LAB, CLUB, OURS]) == "own"
    assert [level for level in LEVELS if believed(level)] == ["confirmed", "own"]


def test_what_is_screened_takes_two_of_ours_and_no_number_of_others() -> None:
    assert trust_of([LAB], screened=True) == "screened"
    assert trust_of([Origin(False, f"source {i}") for i in range(50)], screened=True) == "screened"
    assert trust_of([OURS], screened=True) == trust_of([OURS] * 9, screened=True) == "foreign"
    assert trust_of([OURS, Origin(True, "episode-8")], screened=True) == "confirmed"


@given(ORIGINS)
def test_one_source_wins_nothing_whatever_it_calls_itself(origins: list[Origin]) -> None:
    assert trust_of(origins) == "foreign"


@pytest.mark.parametrize(
    ("source", "witness"),
    [
        ("https://lab.example/notes/1", "lab.example"),
        ("LAB.example:8080/2", "lab.example"),
        ("lab#3", "lab"),
        ("a lab", "a lab"),
        ("", ""),
    ],
)
def test_who_speaks(source: str, witness: str) -> None:
    assert Origin(False, source).witness == witness


@given(st.booleans(), st.text(max_size=30))
def test_an_event_keeps_an_origin(own: bool, source: str) -> None:
    assert Origin.read(str(Origin(own, source))) == Origin(own, source)


@pytest.mark.parametrize("text", ["", "own", "mine:x", "x own:y"])
def test_other_texts_are_no_origin(text: str) -> None:
    assert Origin.read(text) is None


def test_what_is_made_of_several_is_trusted_like_the_least() -> None:
    assert least(["own", "confirmed", "own"]) == "confirmed"
    assert least(["own", "screened", "foreign"]) == "screened"
    assert least([]) == "own"


def test_who_adds_to_what_was_said() -> None:
    assert adds([], LAB)
    assert adds([LAB], CLUB)
    assert adds([LAB, CLUB], OURS)
    assert not adds([LAB, CLUB], Origin(False, "lab/7"))
    assert not adds([OURS], LAB)
