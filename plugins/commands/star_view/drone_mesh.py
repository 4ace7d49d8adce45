"""The shape of a quadrotor as triangles: two arms, a body, and four rotors."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Rows

ARM: Final = 0.046  # m, from the middle to a motor, of a Crazyflie 2.1
ROTOR: Final = 0.0225  # m, radius of a propeller
ROTOR_HEIGHT: Final = 0.012  # m above the arms
SPOKES: Final = 16  # corners of a rotor
BOX: Final = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
BOX_FACES: Final = np.array([
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
])  # fmt: skip


class Mesh(NamedTuple):
    """Triangles.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) rows of the vertices.
    """

    vertices: Array
    faces: Rows


def frame_and_rear() -> Mesh:
    """Return the body, the arms and the two rotors behind, in the body frame: x ahead, z up."""
    arms = [_turned(_box(2 * ARM, 0.008, 0.006), np.pi / 4 + k * np.pi / 2) for k in (0, 1)]
    return _joined([_box(0.036, 0.028, 0.016), *arms, _rotor(3), _rotor(5)])


def front() -> Mesh:
    """Return the two rotors ahead, which a page paints in another color than the rest."""
    return _joined([_rotor(1), _rotor(7)])


def _box(length: float, width: float, height: float) -> Mesh:
    return Mesh(BOX * (length, width, height), BOX_FACES)


def _rotor(eighth: int) -> Mesh:
    """Return a disc at the end of an arm, at a multiple of 45° from straight ahead."""
    angles = np.arange(SPOKES) * 2 * np.pi / SPOKES
    rim = ROTOR * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    around = np.arange(SPOKES)
    faces = np.stack([0 * around, 1 + around, 1 + (around + 1) % SPOKES], axis=1)
    middle = np.array([np.cos(eighth * np.pi / 4), np.sin(eighth * np.pi / 4), 0.0]) * ARM
    middle[2] = ROTOR_HEIGHT
    return Mesh(np.concatenate([np.zeros((1, 3)), rim]) + middle, faces)


def _turned(mesh: Mesh, angle: float) -> Mesh:
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(mesh.vertices @ turn.T, mesh.faces)


def _joined(meshes: list[Mesh]) -> Mesh:
    before = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + k for mesh, k in zip(meshes, before, strict=True)]),
    )
