"""Reading a record once gives what reading its parts gives."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.meaning.words import MAX_TEXT, read_once, text_of, tokens, topic_words, wording

TEXT = st.text(
    alphabet=st.one_of(st.sampled_from("aB ß.1-̈ﬁ杯子を\n"), st.characters(codec="utf-8")), max_size=40
)


@given(TEXT, TEXT)
@settings(max_examples=200, deadline=None)
def test_one_reading_gives_the_words_and_the_wording(query: str, content: str) -> None:
    assert read_once(query, content) == (topic_words(text_of(query, content)), wording(content))


def test_a_text_that_is_too_long_to_be_read_whole() -> None:
    query, content = "lift " * 1000, "the cup " * 1000
    assert len(query) + len(content) > MAX_TEXT
    assert read_once(query, content) == (topic_words(text_of(query, content)), wording(content))


def test_scripts_without_spaces_give_pairs_and_others_words() -> None:
    assert tokens("Füße heben") == ["füsse", "heben"]
    assert tokens("ab杯子里cd") == ["ab", "杯子", "子里", "cd"]
