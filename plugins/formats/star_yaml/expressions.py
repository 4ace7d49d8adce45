"""Arithmetic in the values of files, as in ``$(2 * radius + 0.1)``: computed, never run as code."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Final

from star_core.toolkit import suggestion

OPENING: Final = "$("
"""Begins an expression in a value; it ends with a parenthesis."""

MAX_LENGTH: Final = 200  # characters of an expression
MAX_DEPTH: Final = 20  # levels of parentheses
MAX_WHOLE: Final = 2**53  # beyond, whole numbers become floats

FUNCTIONS: Final[Mapping[str, Callable[..., float]]] = {
    "abs": abs,
    "cos": math.cos,
    "cos_deg": lambda angle: math.cos(math.radians(angle)),
    "max": lambda *values: max(values),
    "min": lambda *values: min(values),
    "sin": math.sin,
    "sin_deg": lambda angle: math.sin(math.radians(angle)),
    "sqrt": math.sqrt,
    "tan": math.tan,
    "tan_deg": lambda angle: math.tan(math.radians(angle)),
}
CONSTANTS: Final = {"pi": math.pi}
NAME: Final = r"[A-Za-z_][A-Za-z0-9_]*"
_TOKEN: Final = re.compile(
    rf"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)|(?P<name>{NAME})|(?P<sign>\*\*|\S))"
)
_SEVERAL: Final = ("max", "min")  # functions of any number of values


class ExpressionError(Exception):
    """An expression that has no value.

    Args:
        message: Why.
        offset: Index of the character that it is about.
        code: Identifies the kind of error.
    """

    def __init__(self, message: str, offset: int, code: str = "invalid-expression") -> None:
        super().__init__(message)
        self.message, self.offset, self.code = message, offset, code


def evaluate(text: str, value_of: Callable[[str, int], float]) -> float:
    """Return the value of an expression.

    It has numbers, names, ``+ - * / **``, parentheses, `FUNCTIONS` and `CONSTANTS`. Whole numbers
    stay whole where the result is.

    Args:
        text: The expression.
        value_of: Returns the value of a name, which stands at an index.

    Raises:
        ExpressionError: It is none, or has no finite value.

    Example:
        >>> evaluate("2 * r ** 2 - sqrt(4)", lambda name, offset: {"r": 3}[name])
        16.0
        >>> evaluate("6 / 3", lambda name, offset: 0.0), evaluate("sin_deg(90)", None)
        (2, 1.0)
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression has at most {MAX_LENGTH} characters", 0)
    return _Evaluation(text, value_of).result()


class _Evaluation:
    """Reads an expression from left to right, one token ahead."""

    def __init__(self, text: str, value_of: Callable[[str, int], float]) -> None:
        self._text, self._value_of = text, value_of
        self._depth = 0
        self._next, self._end = "", 0  # the token ahead, and its end
        self._advance()

    def result(self) -> float:
        value = self._sum()
        if self._next:
            expected = "the end" if self._next in {",", ")"} else "an operator"
            raise self._unexpected(expected)
        return value

    def _advance(self) -> str:
        """Take the token ahead."""
        taken = self._next
        match = _TOKEN.match(self._text, self._end)
        self._kind = str(match.lastgroup) if match else ""
        self._next = match[self._kind] if match else ""
        self._end = match.end() if match else len(self._text)
        self._at = self._end - len(self._next)
        return taken

    def _sum(self) -> float:
        value = self._product()
        while self._next in {"+", "-"}:
            at, sign = self._at, self._advance()
            value = _computed(_OPERATIONS[sign], at, value, self._product())
        return value

    def _product(self) -> float:
        value = self._signed()
        while self._next in {"*", "/"}:
            at, sign = self._at, self._advance()
            value = _computed(_OPERATIONS[sign], at, value, self._signed())
        return value

    def _signed(self) -> float:
        if self._next == "-":
            self._advance()
            return -self._signed()
        base = self._atom()
        if self._next != "**":
            return base
        at, sign = self._at, self._advance()
        return _computed(_OPERATIONS[sign], at, base, self._signed())

    def _atom(self) -> float:
        at, kind = self._at, self._kind
        if kind == "number":
            text = self._advance()
            return _computed(int if text.isdecimal() else float, at, text)
        if kind == "name":
            name = self._advance()
            if self._next == "(":
                return self._call(name, at)
            if name in FUNCTIONS:
                raise ExpressionError(f"{name!r} is a function; write {name}(...)", at)
            return CONSTANTS[name] if name in CONSTANTS else self._value_of(name, at)
        if self._next == "(":
            (value,) = self._parenthesized(several=False)
            return value
        if self._next == "$":
            raise ExpressionError("within $(...), names stand without '$'", at)
        raise self._unexpected("a number, a name or '('")

    def _call(self, name: str, at: int) -> float:
        if name not in FUNCTIONS:
            hint = suggestion(name, FUNCTIONS, "there are")
            raise ExpressionError(f"no function named {name!r}{hint}", at)
        return _computed(FUNCTIONS[name], at, *self._parenthesized(several=name in _SEVERAL))

    def _parenthesized(self, *, several: bool) -> list[float]:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionError(f"nested deeper than {MAX_DEPTH} levels", self._at)
        self._advance()
        values = [self._sum()]
        while several and self._next == ",":
            self._advance()
            values.append(self._sum())
        if self._next != ")":
            raise self._unexpected("')'" if not self._next else "an operator or ')'")
        self._advance()
        self._depth -= 1
        return values

    def _unexpected(self, expected: str) -> ExpressionError:
        subject = repr(self._next) if self._next else "the expression ends"
        return ExpressionError(f"{subject}, expected {expected}", self._at)


def _power(base: float, exponent: float) -> float:
    result: float = float(base) ** exponent
    whole = isinstance(base, int) and isinstance(exponent, int) and exponent >= 0
    return int(result) if whole and abs(result) <= MAX_WHOLE else result


def _quotient(dividend: float, divisor: float) -> float:
    whole = isinstance(dividend, int) and isinstance(divisor, int) and dividend % divisor == 0
    return dividend // divisor if whole else dividend / divisor


_OPERATIONS: Final[Mapping[str, Callable[[float, float], float]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": _quotient,
    "**": _power,
}


def _computed(function: Callable[..., float], at: int, *values: float | str) -> float:
    """Return a finite result; the operator, the function or the number stands at an index."""
    try:
        result: object = function(*values)  # complex of a root of a negative number
        if isinstance(result, int | float) and math.isfinite(result):
            return float(result) if abs(result) > MAX_WHOLE else result
    except ZeroDivisionError:
        raise ExpressionError("division by 0", at) from None
    except (ValueError, OverflowError):
        pass
    shown = ", ".join(
        f"{value:.6g}" if isinstance(value, float) else str(value) for value in values
    )
    raise ExpressionError(f"has no finite value, for {shown}", at)
