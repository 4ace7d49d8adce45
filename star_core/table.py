"""What every table is made of: read-only arrays of a known shape."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Rows: TypeAlias = NDArray[np.int64]


def settle(
    table: object, dtype: type[np.generic] = np.float64, /, **shapes: tuple[int, ...]
) -> None:
    """Make each named field a read-only C array of its shape, or say which one cannot be.

    Raises:
        ContractError: A field has another shape, or holds what is no number.
    """
    for name, shape in shapes.items():
        given = getattr(table, name)
        if not (
            type(given) is np.ndarray
            and given.dtype == dtype
            and given.base is None
            and not (flags := given.flags).writeable  # nobody can write to it: it stays as it is
            and flags.c_contiguous
        ):
            try:
                array = np.array(given, dtype=dtype, order="C")
            except (TypeError, ValueError) as error:
                raise ContractError(
                    f"{type(table).__name__}.{name} is no array: {error}"
                ) from error
            array.flags.writeable = False
            object.__setattr__(table, name, array)
            given = array
        if given.shape != shape:
            raise ContractError(
                f"{type(table).__name__}.{name} has shape {given.shape}, expected {shape}"
            )
