"""What every table is made of: read-only arrays with one row per agent, sample or point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError, RowCountError

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Rows: TypeAlias = NDArray[np.int64]


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
        per: What there is one row per.

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
