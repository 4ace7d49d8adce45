"""Measures that plugins contribute to the summary of a flight."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from star_core.errors import ContractError
from star_core.records.record_files import SUMMARY, check_json


def check_measures(measures: Mapping[str, Any], taken: Iterable[str]) -> dict[str, Any]:
    """Return what a plugin measured, as JSON.

    Args:
        measures: By the keys of the summary.
        taken: Keys that the core has, or that other plugins contributed.

    Raises:
        ContractError: A key is taken, or a value is not JSON, or not as commands read it.
    """
    for key, value in dict(measures).items():
        if key in taken:
            raise ContractError(f"the summary has a key {key!r} already")
        if key in SUMMARY:
            check_json(value, SUMMARY[key], key)
        try:
            json.dumps({key: value}, allow_nan=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise ContractError(f"{key} is not JSON: {error}") from error
    return dict(measures)
