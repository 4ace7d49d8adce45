"""The verb ``search``: cover an area until targets are found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import TaskSpec, deferred, hookimpl
from star_core.toolkit import KindSpec, Spec

if TYPE_CHECKING:
    from star_core import Registry


@hookimpl
def star_kinds() -> Iterable[KindSpec]:
    from star_search.pattern import SearchPatternSpec

    yield KindSpec(name="search_pattern", record=SearchPatternSpec)


@hookimpl
def star_search_patterns() -> Iterable[Spec]:
    from star_search.pattern import SearchPatternSpec

    yield SearchPatternSpec(
        name="sweep",
        summary="parallel lanes, then what they missed",
        make=deferred("star_search.sweep:Sweep"),
    )
    yield SearchPatternSpec(
        name="frontier",
        summary="always to where the most unseen floor can be seen soonest",
        make=deferred("star_search.frontier:Frontier"),
    )


@hookimpl
def star_tasks(registry: Registry) -> Iterable[TaskSpec]:
    from star_search.spec import spec

    yield spec(registry)
