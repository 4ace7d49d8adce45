"""Rows of numbers read from a CSV file. Does not import numpy."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from star_core import InputError


def read_rows(path: Path, file: str) -> list[tuple[int, list[str]]]:
    """Return the rows of a file that are not blank, each with its line number.

    Args:
        path: Path of the file.
        file: Its name in the mission, for messages.

    Raises:
        InputError: It cannot be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError([f"{file}: cannot be read as CSV in UTF-8: {error}"]) from error


def numbers(
    columns: Sequence[str], row: Sequence[str], most: float = math.inf
) -> tuple[dict[str, float], list[str]]:
    """Return the numbers of a row by column, and its problems.

    Args:
        columns: Their names.
        row: Its cells.
        most: Greatest absolute value of a number.
    """
    if len(row) != len(columns):
        return {}, [f"has {len(row)} values, expected {len(columns)}"]
    values: dict[str, float] = {}
    faults = []
    for name, cell in zip(columns, row, strict=True):
        try:
            values[name] = float(cell)
        except ValueError:
            faults.append(f"{name} is {cell.strip()!r}, expected a number")
            continue
        if not math.isfinite(values[name]):
            faults.append(f"{name} is {cell.strip()!r}, expected a finite number")
        elif abs(values[name]) > most:
            faults.append(f"{name} is {cell.strip()!r}, expected {most:g} at most")
    return values, faults
