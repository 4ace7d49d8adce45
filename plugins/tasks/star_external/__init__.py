"""The verb ``external``: goals from another process, or from an installed planner."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import TaskSpec, hookimpl


@hookimpl
def star_tasks() -> Iterable[TaskSpec]:
    from star_external.spec import spec

    yield spec()
