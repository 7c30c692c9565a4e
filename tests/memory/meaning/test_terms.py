"""What a text is searched by."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.meaning.terms import MAX_SENTENCES, MAX_TEXT, questions, terms, words


def test_forms_of_a_word_are_one_term() -> None:
    assert terms("Lifting the lifted cups") == terms("lift cup") == {"lift", "cup"}


def test_what_stands_in_any_order_is_no_term() -> None:
    assert terms("Could you please put the two of them there, 5 times?") == {"time"}


def test_scripts_without_spaces_give_pairs_and_others_words() -> None:
    assert words("Füße heben") == ["füsse", "heben"]
    assert words("ab杯子里cd") == ["ab", "杯子", "子里", "cd"]
    assert words("拿") == ["拿"]


def test_sentences_of_a_long_query_are_asked_apart() -> None:
    query = "The guests come at seven tonight; set the table. Afterwards report to the office downstairs."
    whole, *parts = questions(query)
    assert terms("set table") in parts
    assert set().union(*parts) <= whole
    assert questions("set the table. Now!") == (terms("set table"),)
    assert questions("the of and") == ()
    assert len(questions(". ".join(f"move cup{i} onto tray{i}" for i in range(50)))) == MAX_SENTENCES + 1


@given(st.text(alphabet=st.one_of(st.sampled_from("aB ß.1-̈ﬁ杯子を\n"), st.characters()), max_size=40))
@settings(max_examples=200, deadline=None)
def test_any_text_is_taken(text: str) -> None:
    assert all(words(text))
    assert all(terms(text))


def test_a_megabyte_is_read_by_its_beginning() -> None:
    assert terms("lift by " * 200_000) == {"lift"}
    assert len(words("x" * 200_000)) == 1
    assert terms("a" * MAX_TEXT + " cup") == terms("a" * MAX_TEXT)
