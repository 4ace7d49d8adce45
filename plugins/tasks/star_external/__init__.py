"""The verb ``external``: goals from another process, or from an installed planner."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Task


@hookimpl
def star_tasks() -> Iterable[Offer[Task]]:
    from star_external.offer import offer

    yield offer()
