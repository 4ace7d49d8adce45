"""Tables of read-only arrays with one row per agent, sample or point, declared column by column."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from functools import cache
from itertools import zip_longest
from typing import (
    Any,
    ClassVar,
    Final,
    NamedTuple,
    Self,
    TypeAlias,
    TypeVar,
    cast,
    dataclass_transform,
)

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Rows: TypeAlias = NDArray[np.int64]
AnyTable = TypeVar("AnyTable")
Values = TypeVar("Values", bound=np.ndarray)

DTYPES: Final = {
    "Array": np.dtype(np.float64),
    "Rows": np.dtype(np.int64),
    "Mask": np.dtype(np.bool_),
}
"""Type of a column's elements, by the annotation of its field."""

CONVERTIBLE: Final = "biufO"
"""Kinds of arrays that columns are made of: truth values, integers, floats and objects. Complex
numbers would lose their imaginary parts, and text is no number."""

FROZEN: Final = frozenset({0x105, 0x107})
"""`flags.num` of read-only arrays in C order that own their data: nothing can write to them. Those
with one row or one axis are in Fortran's order as well."""


def require_type(answer: object, table: type[AnyTable], agents: int | None = None) -> AnyTable:
    """Return `answer` if it is a `table`, with one row per agent; raise `ContractError`."""
    if not isinstance(answer, table):
        raise ContractError(f"returned {type(answer).__name__}, expected {table.__name__}")
    if agents is not None and (rows := len(getattr(answer, answer.COLUMNS[0].name))) != agents:  # type: ignore[attr-defined]
        raise ContractError(
            f"every field of {table.__name__} has {rows} row{'s' * (rows != 1)}, "
            f"expected {agents}, one per agent"
        )
    return answer


class Column(NamedTuple):
    """A field of a table that is an array.

    Attributes:
        name: Of the field.
        row: Shape of one row.
        dtype: Of its elements.
        optional: Whether it may be None.
        per: Item that has one row; empty for that of the table.
    """

    name: str
    row: tuple[int, ...]
    dtype: np.dtype[Any]
    optional: bool
    per: str


def column(*row: int, per: str = "", **default: Any) -> Any:
    """Declare a field that is an array with one row per agent, sample or point.

    Its elements are floats, integers or truth values, as it is annotated: `Array`, `Rows` or
    `Mask`. So ``position: Array = column(3)`` is an array (N, 3) of floats.

    Args:
        row: Shape of one row.
        per: Item that has one row, for messages, if it is not that of the table.
        default: Of `dataclasses.field`.
    """
    return field(**default, metadata={"row": row, "per": per})


def counted(**default: Any) -> Any:
    """Declare another field that has one row per agent: a tuple or a table."""
    return field(**default, metadata={"counted": True})


class Table:
    """A frozen table, which `table` makes of a class."""

    __slots__: tuple[str, ...] = ()
    COLUMNS: ClassVar[tuple[Column, ...]] = ()
    COUNTED: ClassVar[tuple[str, ...]] = ()  # other fields with one row per agent
    PER: ClassVar[str] = "agent"

    def __post_init__(self) -> None:
        """Make every column a read-only C array, and check the shapes.

        An array that can be written to is copied.

        Raises:
            ContractError: The fields differ in their number of rows, a row has another shape, or a
                field cannot be converted to its type.
        """
        rows, equal = -1, True
        for name, row, dtype, optional, per in self.COLUMNS:
            array = getattr(self, name)
            if not (
                type(array) is np.ndarray
                and array.dtype is dtype
                and array.flags.num in FROZEN  # it is used as it is
            ):
                if optional and array is None:
                    continue
                array = _convert(self, name, dtype)
            shape = array.shape
            if shape[1:] != row if row else len(shape) != 1:
                raise _wrong_shape(self, name, shape, row)
            if shape[0] != rows and not per:
                equal = equal and rows < 0
                rows = shape[0]
        for name in self.COUNTED:
            equal = equal and _rows_of(getattr(self, name)) == rows
        if not equal:
            raise row_count_error(type(self).__name__, self._counts(), self.PER)

    def _counts(self) -> dict[str, int]:
        names = [*(column.name for column in self.COLUMNS if not column.per), *self.COUNTED]
        values = {name: getattr(self, name) for name in names}
        return {name: _rows_of(values[name]) for name in names if values[name] is not None}

    @classmethod
    def made(cls, *values: Any) -> Self:
        """Return a table of the core's own, which is not checked; its arrays become read-only.

        Args:
            values: Of all fields, in their order; optional columns at the end may be left out.
        """
        made = object.__new__(cls)
        for name, value in zip_longest(cls.__slots__, values):
            if type(value) is np.ndarray:
                value.setflags(write=False)
            object.__setattr__(made, name, value)
        return made

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        """Pickle the values alone: a recorded tick has ten tables."""
        return type(self).made, tuple([getattr(self, name) for name in self.__slots__])

    @classmethod
    def none(cls, n: int = 0) -> Self:
        """Return a table of `n` rows of zeros: without an item, or without an active one."""
        return cast("Self", _none(cast("Any", cls), n))


@cache  # tables are read-only
def _none(cls: Any, n: int) -> Any:
    columns = (column for column in cls.COLUMNS if not column.optional)
    return cls(**{column.name: np.zeros((n, *column.row), column.dtype) for column in columns})


@dataclass_transform(frozen_default=True, field_specifiers=(column, counted, field))
def table(per: str = "agent", **options: bool) -> Callable[[type[AnyTable]], type[AnyTable]]:
    """Make a subclass of `Table` a frozen dataclass of its columns.

    Args:
        per: Item that has one row each, for messages.
        options: Of `dataclasses.dataclass`.
    """

    def decorated(cls: type[AnyTable]) -> type[AnyTable]:
        made: Any = dataclass(frozen=True, slots=True, **options)(cls)
        declared = fields(made)
        made.COLUMNS = tuple(_column(item) for item in declared if "row" in item.metadata)
        made.COUNTED = tuple(item.name for item in declared if "counted" in item.metadata)
        made.PER = per
        return cast("type[AnyTable]", made)

    return decorated


def _column(declared: Field[Any]) -> Column:
    annotation, _, optional = str(declared.type).partition(" | ")
    row, per = declared.metadata["row"], declared.metadata["per"]
    return Column(declared.name, row, DTYPES[annotation], bool(optional), per)


def some(mask: Mask) -> bool:
    """Return whether any element is true: a twentieth of the time of ``mask.any()``."""
    return 1 in mask.tobytes()


def every(mask: Mask) -> bool:
    """Return whether all elements are true: a twentieth of the time of ``mask.all()``."""
    return 0 not in mask.tobytes()


def frozen(array: Values) -> Values:
    """Return an array that is not written to any more, read-only: a table takes it as it is.

    Others are copied. The array must own its data: a slice of another array is copied, too.
    """
    array.setflags(write=False)
    return array


def freeze(*arrays: np.ndarray) -> None:
    """Make arrays read-only that are not written to any more: tables take them as they are.

    Each must own its data, as for `frozen`.
    """
    for array in arrays:
        array.setflags(write=False)


def _convert(owner: Table, name: str, dtype: np.dtype[Any]) -> np.ndarray:
    """Replace a field by a read-only C array of a type, and return it."""
    try:
        values = np.asarray(getattr(owner, name))
        if values.dtype is not dtype and values.dtype.kind not in CONVERTIBLE:
            elements = values.dtype.type.__name__.rstrip("_")
            raise ContractError(
                f"{type(owner).__name__}.{name} is an array of {elements}, expected {dtype}"
            )
        array = np.array(values, dtype=dtype, order="C")
    except (TypeError, ValueError) as error:
        raise ContractError(f"{type(owner).__name__}.{name} is no array: {error}") from error
    array.setflags(write=False)
    object.__setattr__(owner, name, array)
    return array


def _wrong_shape(
    owner: Table, name: str, shape: tuple[int, ...], row: tuple[int, ...]
) -> ContractError:
    expected = ", ".join(map(str, (*(shape[:1] or ("N",)), *row))) + "," * (not row)
    return ContractError(f"{type(owner).__name__}.{name} has shape {shape}, expected ({expected})")


def _rows_of(rows: Any) -> int:
    """Return the number of rows of an array, a tuple or a table."""
    return len(getattr(rows, rows.COLUMNS[0].name) if isinstance(rows, Table) else rows)


def row_count_error(table: str, count: Mapping[str, int], per: str) -> ContractError:
    """Return the error of a table whose fields differ in their number of rows.

    Args:
        table: Name of its class.
        count: Number of rows of each field.
        per: What there should be one row per.
    """
    groups: dict[int, list[str]] = {}
    for name, n in count.items():
        groups.setdefault(n, []).append(name)
    *odd, (n, most) = sorted(groups.items(), key=lambda group: len(group[1]))
    odd_ones = ", ".join(f"{_have(names)} {_rows(rows)}" for rows, names in odd)
    text = f"{odd_ones}, but {_have(most)} {n}; expected one row per {per}"
    return ContractError(f"{table}.{text}", "wrong-shape")


def _have(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last} have" if others else f"{last} has"


def _rows(n: int) -> str:
    return "1 row" if n == 1 else f"{n} rows"
