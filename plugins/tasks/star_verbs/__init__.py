"""The basic verbs of missions: take off, fly, wait and land."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import TaskSpec, hookimpl


@hookimpl
def star_tasks() -> Iterable[TaskSpec]:
    from star_verbs.specs import SPECS

    return SPECS
