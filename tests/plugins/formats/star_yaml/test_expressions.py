"""Arithmetic in values: the results are Python's, and what is none is refused where it is wrong."""

from __future__ import annotations

import math
import operator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_yaml.expressions import MAX_DEPTH, MAX_LENGTH, ExpressionError, evaluate

NAMES = {"r": 3, "height": 0.8, "e": 2, "_a1": -1.5}


def value(text: str) -> float:
    return evaluate(text, lambda name, _offset: NAMES[name])


def expressions() -> st.SearchStrategy[str]:
    atoms = st.one_of(
        st.integers(0, 99).map(str),
        st.floats(0, 99, allow_nan=False).map(lambda number: f"{number:.3f}"),
        st.sampled_from([*NAMES]),
    )
    return st.recursive(
        atoms,
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from([" + ", " - ", "*", "/"]), inner).map("".join),
            inner.map("({})".format),
            inner.map("-{}".format),
            st.tuples(inner, inner).map(lambda pair: f"min({pair[0]}, {pair[1]})"),
        ),
        max_leaves=8,
    )


@given(expressions())
def test_results_are_those_of_python(text: str) -> None:
    try:
        expected = eval(text, {"__builtins__": {}}, {**NAMES, "min": min})  # noqa: S307 -- own text
    except ZeroDivisionError:
        with pytest.raises(ExpressionError):
            value(text)
    else:
        assert value(text) == pytest.approx(expected, rel=1e-12)


@given(st.text("0123456789.r()+-*/, $abs", max_size=30))
def test_any_text_is_a_number_or_an_error_within_it(text: str) -> None:
    offset = 0
    try:
        result = evaluate(text, lambda _name, _offset: 1.0)
    except ExpressionError as error:
        result, offset = 0.0, error.offset
    assert math.isfinite(result)
    assert 0 <= offset <= len(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2 + 3 * 4", 14),
        ("-2 ** 2", -4),
        ("2 ** 3 ** 2", 512),
        ("2 ** -1", 0.5),
        ("10 - 3 - 2", 5),
        ("12 / 2 / 3", 2),
        ("max(1, height, 0)", 1),
        ("abs(_a1)", 1.5),
        ("sqrt(r * r)", 3.0),
        ("sin_deg(90) + cos_deg(0)", 2.0),
        ("sin(pi / 2)", 1.0),
        ("e", 2),
    ],
)
def test_operators_bind_as_in_mathematics(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "whole"),
    [("6 / 3", True), ("6 / 4", False), ("2 ** 3", True), ("2.0 * 2", False), ("7 - r", True),
     ("9 ** 20", False)],
)  # fmt: skip
def test_whole_numbers_stay_whole_where_the_result_is(text: str, *, whole: bool) -> None:
    assert isinstance(value(text), int) == whole


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("", 0),
        ("2 +", 3),
        ("2 3", 2),
        ("(2", 2),
        ("2)", 1),
        ("foo(2)", 0),
        ("2 * foo(2)", 4),
        ("min", 0),
        ("abs(1, 2)", 5),
        ("1 / 0", 2),
        ("1 + sqrt(-1)", 4),
        ("9 ** 999", 2),
        ("r.real", 1),
        ("r[0]", 1),
        ("lambda: 0", 6),
        ("$r", 0),
        ("(" * (MAX_DEPTH + 1) + "1", MAX_DEPTH),
        ("1" * (MAX_LENGTH + 1), 0),
    ],
)
def test_errors_are_located_by_their_character(text: str, offset: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate(text, lambda _name, _offset: operator.index(1))
    assert caught.value.offset == offset
