"""The verb ``search``: cover an area until targets are found."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import TaskSpec, hookimpl


@hookimpl
def star_tasks() -> Iterable[TaskSpec]:
    from star_search.spec import spec

    yield spec()
