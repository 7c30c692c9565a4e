import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.view_formats import parse_view_spec


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
