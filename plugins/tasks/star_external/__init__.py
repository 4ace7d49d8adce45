"""The verb ``external``: goals from another process, or from an installed planner."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import TaskSpec, hookimpl
from star_core.toolkit import KindSpec

if TYPE_CHECKING:
    from star_core import Registry


@hookimpl
def star_kinds() -> Iterable[KindSpec]:
    from star_external.planner import ExternalPlannerSpec

    yield KindSpec(name="external_planner", record=ExternalPlannerSpec)


@hookimpl
def star_tasks(registry: Registry) -> Iterable[TaskSpec]:
    from star_external.spec import spec

    yield spec(registry)
