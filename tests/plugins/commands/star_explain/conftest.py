"""Missions that are rehearsed and checked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

from star_core import Registry, load
from star_core.formats import check_file
from star_core.toolkit import Rehearsal

Rehearse: TypeAlias = Callable[..., Rehearsal]
Warn: TypeAlias = Callable[..., list[str]]

HALL = "star: 1\nname: hall\nfence: {low: [-9, -9, 0], high: [9, 9, 3]}\n"


@pytest.fixture
def rehearse(tmp_path: Path) -> Rehearse:
    """Return a function that rehearses a mission in ``hall.yaml`` with some changes."""

    def rehearsed(
        mission: str, *changes: str, world: str = HALL, plugins: tuple[object, ...] = ()
    ) -> Rehearsal:
        (tmp_path / "hall.yaml").write_text(world)
        (tmp_path / "m.yaml").write_text(mission)
        registry = Registry(*plugins)
        flown = load(tmp_path / "m.yaml", registry, changes)
        result: Rehearsal = registry.manager.hook.star_rehearse(mission=flown, registry=registry)
        return result

    return rehearsed


@pytest.fixture
def warn(tmp_path: Path) -> Warn:
    """Return a function that returns the warnings about a mission in ``hall.yaml``."""

    def warned(
        mission: str, *changes: str, world: str = HALL, plugins: tuple[object, ...] = ()
    ) -> list[str]:
        (tmp_path / "hall.yaml").write_text(world)
        (tmp_path / "m.yaml").write_text(mission)
        return [*check_file(tmp_path / "m.yaml", Registry(*plugins), changes)[1]]

    return warned
