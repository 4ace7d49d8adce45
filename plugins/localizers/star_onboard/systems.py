"""Expected errors and coverage of the systems by which on-board estimators know the map."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from star_core import Array, Mask, Scene
from star_core.toolkit import covered


class SystemStd(NamedTuple):
    """Standard deviations of errors that the estimators do not know, m.

    Attributes:
        planar: Along x and along y.
        vertical: Along z.
    """

    planar: float
    vertical: float


RANGER_STD: Final = 0.01  # m, of the ranger of a Flow deck

# See `star_sim.onboard.ERRORS` and docs/lighthouse.md.
STD: Final = {
    "lighthouse": SystemStd(0.014, RANGER_STD),
    "loco": SystemStd(0.05, RANGER_STD),
    "poses": SystemStd(0.005, RANGER_STD),
}
"""With a Flow deck. Loco: in the middle of eight anchors ranges with a bias of 0.1 m give positions
with one of 0.053 m, whose changes within 3 s the estimators follow in part."""

INERTIAL_STD: Final = {
    "lighthouse": SystemStd(0.014, 0.014),
    "loco": SystemStd(0.02, 0.075),
    "poses": SystemStd(0.005, 0.005),
}
"""Without. Loco: the estimators assume 0.25 m for each range, but nothing that lasts, which covers
most of their error in the plane, and less along z, where their geometry is half as good. Fitted to
flights with seeds from 1500."""


def system_std(scene: Scene, system: str) -> SystemStd:
    """Return the errors of a system that the estimators do not know."""
    return (STD if scene.flow_deck else INERTIAL_STD)[system]


def expected_std(
    scene: Scene,
    _time: Array,
    position: Array,
    _yaw: Array,
    *,
    system: str,
    std: float | None = None,
    **_options: Any,
) -> Array:
    """Return the standard deviation in the plane along paths: (T, N) m, that of the system."""
    planar = system_std(scene, system).planar if std is None else std
    return np.full(position.shape[:2], planar)


def is_covered(scene: Scene, position: Array, *, system: str, **_options: Any) -> Mask:
    """Return where the system is received, out of positions (T, 3), m: (T,)."""
    if system == "poses":
        return np.ones(len(position), np.bool_)
    return covered(scene.world, system, position)
