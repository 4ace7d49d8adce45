"""Read-only arrays with one row per agent, sample or point: the columns of every table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError, coded

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Rows: TypeAlias = NDArray[np.int64]
Table = TypeVar("Table")


def require_type(answer: object, table: type[Table]) -> Table:
    """Return `answer` if it is a `table`; raise `ContractError`."""
    if not isinstance(answer, table):
        raise ContractError(f"returned {type(answer).__name__}, expected {table.__name__}")
    return answer


def require_rows(table: object, rows: int, agents: int) -> None:
    """Raise `ContractError` unless a table has one row per agent."""
    if rows != agents:
        raise ContractError(
            f"every field of {type(table).__name__} has {rows} row{'s' * (rows != 1)}, "
            f"expected {agents}, one per agent"
        )


def freeze_arrays(
    table: object,
    numbers: Mapping[str, tuple[int, ...]],
    /,
    *,
    integers: tuple[str, ...] = (),
    flags: tuple[str, ...] = (),
    others: Mapping[str, int] | None = None,
    per: str = "agent",
) -> None:
    """Make each named field a read-only C array with one row per agent.

    Args:
        table: An instance of a frozen dataclass.
        numbers: Fields of float64, with the shape of one row.
        integers: Fields with one integer per row.
        flags: Fields with one truth value per row.
        others: Number of rows of fields that are not arrays.
        per: Item that has one row each, for messages.

    Raises:
        RowCountError: The fields differ in their number of rows.
        ContractError: A row has another shape, or a field cannot be converted to its type.
    """
    count = {name: _column(table, name, np.float64, row) for name, row in numbers.items()}
    for name in integers:
        count[name] = _column(table, name, np.int64, ())
    for name in flags:
        count[name] = _column(table, name, np.bool_, ())
    if others:
        count |= others
    if len(set(count.values())) > 1:
        raise RowCountError(type(table).__name__, count, per)


def _column(table: object, name: str, dtype: type[np.generic], row: tuple[int, ...]) -> int:
    """Make a field a read-only C array of rows of one shape, and return the number of rows."""
    given = getattr(table, name)
    if not (
        type(given) is np.ndarray
        and given.dtype == dtype
        and given.base is None
        and not (flags := given.flags).writeable  # nothing can write to it: it is used as it is
        and flags.c_contiguous
    ):
        try:
            array = np.array(given, dtype=dtype, order="C")
        except (TypeError, ValueError) as error:
            raise ContractError(f"{type(table).__name__}.{name} is no array: {error}") from error
        array.flags.writeable = False
        object.__setattr__(table, name, array)
        given = array
    shape: tuple[int, ...] = given.shape
    if not shape or shape[1:] != row:
        expected = ", ".join(map(str, (*(shape[:1] or ("N",)), *row))) + "," * (not row)
        raise ContractError(
            f"{type(table).__name__}.{name} has shape {shape}, expected ({expected})"
        )
    return shape[0]


class RowCountError(ContractError):
    """Fields of one table differ in their number of rows.

    Args:
        table: Name of its class.
        count: Number of rows of each field.
        per: What there should be one row per.
    """

    code = "wrong-shape"

    def __init__(self, table: str, count: Mapping[str, int], per: str) -> None:
        self._table, self._count, self._per = table, count, per
        *odd, most = sorted(_by_count(count), key=lambda group: len(group[0]))
        odd_ones = ", ".join(f"{_have(names)} {_rows(n)}" for names, n in odd)
        text = f"{odd_ones}, but {_have(most[0])} {most[1]}; expected one row per {per}"
        super().__init__(f"{table}.{text}")

    def among(self, agents: int) -> str:
        """Return the message for a swarm of `agents`, naming the wrong fields."""
        if self._per != "agent":
            return str(self)
        wrong = [group for group in _by_count(self._count) if group[1] != agents]
        fields = ", ".join(f"{_have(names)} {_rows(n)}" for names, n in wrong)
        return coded(f"{self._table}.{fields}, expected {agents}, one per agent", self.code)


def _by_count(count: Mapping[str, int]) -> list[tuple[list[str], int]]:
    """Return the fields of each number of rows, in the order of the fields."""
    groups: dict[int, list[str]] = {}
    for name, n in count.items():
        groups.setdefault(n, []).append(name)
    return [(names, n) for n, names in groups.items()]


def _have(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last} have" if others else f"{last} has"


def _rows(n: int) -> str:
    return "1 row" if n == 1 else f"{n} rows"
