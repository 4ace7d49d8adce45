"""Expected errors and coverage of the systems by which on-board estimators know the map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from star_core import Array, Mask, Scene
from star_core.toolkit import covered

# Of the systems, in the plane: see `star_sim.onboard.ERRORS` and docs/lighthouse.md.
STD: Final = {"lighthouse": 0.014, "loco": 0.06, "poses": 0.005}  # m


def expected_std(
    _scene: Scene,
    _time: Array,
    position: Array,
    _yaw: Array,
    *,
    system: str,
    std: float | None = None,
    **_options: Any,
) -> Array:
    """Return the standard deviation in the plane along paths: (T, N) m, that of the system."""
    return np.full(position.shape[:2], STD[system] if std is None else std)


def is_covered(scene: Scene, position: Array, *, system: str, **_options: Any) -> Mask:
    """Return where the system is received, out of positions (T, 3), m: (T,)."""
    if system == "poses":
        return np.ones(len(position), np.bool_)
    return covered(scene.world, system, position)
