"""Array expressions with a vocabulary of their own; the language of value maps tests the rest."""

import ast

import numpy as np
import pytest

from gvla2.programs.array_expressions import Interpreter


class Words:
    """``t`` is an array; ``half(...)`` its argument's half; ``thing.size`` is 7."""

    words = "t, thing, half"

    def __init__(self, **variables):
        self.variables = {name: ast.parse(text, mode="eval").body for name, text in variables.items()}
        self.asked = 0

    def array(self, name):
        self.asked += name == "t"
        return np.arange(4.0) if name == "t" else None

    def attribute(self, owner, name):
        if (ast.unparse(owner), name) != ("thing", "size"):
            raise ValueError("there is only thing.size")
        return np.float64(7.0)

    def function(self, name):
        return (lambda args, value: 0.5 * value(args[0])) if name == "half" else None


def value(text, words=None):
    return Interpreter(words or Words()).value(ast.parse(text, mode="eval").body)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("t * 2 + thing.size", [7, 9, 11, 13]),
        ("half(t) % 1", [0, 0.5, 0, 0.5]),
        ("where((t >= 1) & (t < 3), -t, t ** 2)", [0, -1, -2, 9]),
        ("max(t, 2) - min(t, 1)", [2, 1, 1, 2]),
        ("~(t == 0) | False", [0, 1, 1, 1]),
        ("-(t > 1)", [0, 0, -1, -1]),
        ("(t > 0) - (t > 1)", [0, 1, 0, 0]),
        ("clip(abs(-t), 1, 2)", [1, 1, 2, 2]),
    ],
)
def test_what_expressions_are_worth(text, wanted):
    np.testing.assert_allclose(value(text), wanted)


def test_a_variable_is_worked_out_once():
    words = Words(a="t + 1", b="a * a + a")
    np.testing.assert_allclose(value("b + b + a", words), [5, 14, 27, 44])
    assert words.asked == 1


def test_arguments_are_not_written_into():
    kept = Words(a="t + 0")
    with pytest.raises(ValueError, match="does not take these 3 arguments"):
        value("min(t, 1, a)", kept)
    with pytest.raises(ValueError, match="not allowed here"):
        value("min(t, 1, out=a)", kept)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("u", "'u' is not allowed here; use t, thing, half, abs"),
        ("open('x')", r"There is no open\(\)"),
        ("t.size", "only thing.size"),
        ("half()", "0 arguments"),
        ("1 < t < 3", "not allowed here"),
        ("t @ t", "not allowed here"),
        ("1 / (t - 1)", "not finite"),
        ("1j", "not allowed here"),
        ("None", "not allowed here"),
        ("[i for i in t]", "not allowed here"),
        ("1" + " + 1" * 200, "nested too deeply"),
    ],
)
def test_what_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        value(text)
