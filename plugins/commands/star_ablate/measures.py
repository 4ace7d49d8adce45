"""Measures of a study: those that summaries have, known before a flight or by its summary."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from star_core import Problem, Registry
from star_core.toolkit import STUDY_COLUMNS, SUMMARY_MEASURES, suggestion, value_at

CODE = "unknown-measure"


def offered(registry: Registry) -> list[str]:
    """Return the measures that STAR and plugins offer; ``a.*`` stands for all below ``a``."""
    return [
        *SUMMARY_MEASURES,
        *(name for names in registry.manager.hook.star_measures() for name in names),
    ]


def undeclared(measures: Sequence[str], registry: Registry) -> list[str]:
    """Return the measures that neither STAR nor a plugin offers."""
    declared = offered(registry)
    return [measure for measure in measures if not _is_offered(measure, declared)]


def problems(
    measures: Sequence[str], candidates: Iterable[str], wrong: Sequence[str]
) -> Iterator[Problem]:
    """Yield a problem for each measure that is wrong.

    Args:
        measures: Of the study.
        candidates: Of the nearest ones, which the message suggests.
        wrong: Those of `measures` that no summary has.
    """
    names = [name.removesuffix(".*") for name in candidates]
    for measure in wrong:
        text = f"summaries have no measure {measure!r}{suggestion(measure, names, 'there are')}"
        yield Problem(("measures", measures.index(measure)), text, CODE)


def may_measure_more(registry: Registry) -> bool:
    """Return whether a plugin observes flights that does not offer its measures."""
    declaring = registry.manager.implementing("star_measures")
    return any(
        not registry.source(name).own and name not in declaring for name in registry.observers()
    )


def paths(summary: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield every path in a summary.

    >>> list(paths({"collisions": {"agent_agent": 0}, "reason": ""}))
    ['collisions', 'collisions.agent_agent', 'reason']
    """
    for key, value in summary.items():
        yield f"{above}{key}"
        if isinstance(value, Mapping):
            yield from paths(value, f"{above}{key}.")


def selected(summary: Mapping[str, Any], measures: Iterable[str]) -> dict[str, Any]:
    """Return some measures of a summary, as a summary: whole ones of 10,000 runs are large.

    >>> selected({"a": {"b": 1, "c": 2}, "d": 3}, ["a.b", "e"])
    {'a': {'b': 1}}
    """
    part: dict[str, Any] = {}
    for measure in measures:
        if (value := value_at(summary, measure)) is not None:
            *above, last = measure.split(".")
            inner = part
            for key in above:
                inner = inner.setdefault(key, {})
            inner[last] = value
    return part


def _is_offered(measure: str, declared: Iterable[str]) -> bool:
    """Return whether a measure is offered, is a map of measures, or is a column.

    >>> _is_offered("a", ["a.b"]), _is_offered("a.b.c", ["a.*"]), _is_offered("a.c", ["a.b"])
    (True, True, False)
    """
    return measure in STUDY_COLUMNS or any(
        f"{name}.".startswith(f"{measure}.")
        or (name.endswith(".*") and measure.startswith(name[:-1]))
        for name in declared
    )
