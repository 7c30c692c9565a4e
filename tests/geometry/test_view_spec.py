import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.view_formats import parse_axis_word, parse_view_spec


@pytest.mark.parametrize(
    ("spec", "numbers"),
    [
        ("0-4", (0, 1, 2, 3, 4)),
        ("0-4,7", (0, 1, 2, 3, 4, 7)),
        (" 3 , 1 - 2 ", (3, 1, 2)),
        ("12", (12,)),
        ("5-5", (5,)),
    ],
)
def test_specs(spec, numbers):
    assert parse_view_spec(spec) == numbers


@pytest.mark.parametrize(
    ("spec", "what"),
    [
        ("", "''"),
        ("0-4,", "''"),
        ("a", "'a'"),
        ("4-0", "backwards"),
        ("-3", "'-3'"),
        ("0-2,1", "1 twice"),
        ("0-9999999", "longer"),
    ],
)
def test_what_is_no_spec_is_named(spec, what):
    with pytest.raises(ConfigurationError, match=what):
        parse_view_spec(spec)


def test_axis_words():
    np.testing.assert_array_equal(parse_axis_word("perm012_signpnn"), np.diag([1.0, -1.0, -1.0]))
    # Row i is the new axis i: the old axis perm[i] with its sign.
    np.testing.assert_array_equal(parse_axis_word("perm021_signpnp") @ [1, 2, 3], [1, -3, 2])
    np.testing.assert_array_equal(parse_axis_word("identity"), np.eye(3))


@pytest.mark.parametrize(
    "word", ["", "perm011_signppp", "perm012_signpp", "perm012", "perm012_signppx", "perm0123_signppp"]
)
def test_what_is_no_axis_word_is_named(word):
    with pytest.raises(ConfigurationError, match="axis transform"):
        parse_axis_word(word)
