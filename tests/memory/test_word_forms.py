"""Forms of a word are one word, and the quick test never says more than the slow one."""

from hypothesis import given
from hypothesis import strategies as st

from gvla2.memory.word_forms import alike, split_alike, starts_of

WORDS = st.frozensets(
    st.sampled_from(
        ["grip", "grippe", "gripper", "grid", "turn", "turnt", "nr1x", "nr12x", "side+", "side-", "a", "杯"]
    )
)


@given(WORDS, WORDS)
def test_what_begins_apart_is_left_over(first: frozenset[str], second: frozenset[str]) -> None:
    _, left, right = split_alike(first, second)
    assert starts_of(first) <= starts_of(second) or left
    assert starts_of(second) <= starts_of(first) or right


def test_forms() -> None:
    assert alike("drawer", "drawers")
    assert not alike("cup", "cap")
    assert not alike("nr1x", "nr12x")
    assert not alike("side+", "side-")
    assert not starts_of({"cup"}) <= starts_of({"lid"})
