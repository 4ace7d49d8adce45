"""Names of what is in a world: each browser shows those that do not cover each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import viser

from star_core import Mask

SCALE: Final = 0.8  # size of a name, over that of an agent
LETTER, LINE = 5.3, 13.0  # px, mean width of a letter and height of a name


class Name(NamedTuple):
    """A text on a page.

    Attributes:
        node: Of the scene.
        text: What is shown.
        position: Of the middle of its lower edge, m.
        below: Whether `position` is that of its upper edge.
    """

    node: str
    text: str
    position: tuple[float, float, float]
    below: bool = False


async def show_names(names: Sequence[Name], client: viser.ClientHandle) -> None:
    """Show a browser those names that it has room for, wherever it looks from.

    It is not run in a thread, where one view could overtake another.

    Args:
        names: Of a page; there may be more of them later.
        client: The browser.
    """
    labels: list[viser.LabelHandle] = []

    async def choose(camera: viser.CameraHandle) -> None:
        labels.extend(
            client.scene.add_label(
                name.node, name.text, position=name.position, font_screen_scale=SCALE,
                visible=False, anchor="top-center" if name.below else "bottom-center",
            )
            for name in names[len(labels) :]
        )  # fmt: skip
        for label, visible in zip(labels, uncovered(names, camera).tolist(), strict=True):
            if label.visible != visible:
                label.visible = visible

    client.camera.on_update(choose)
    await choose(client.camera)


def uncovered(names: Sequence[Name], camera: viser.CameraHandle) -> Mask:
    """Return which names cover none that is nearer to the camera, (K,)."""
    offset = np.array([name.position for name in names]).reshape(-1, 3) - camera.position
    x, y, away = (offset @ viser.transforms.SO3(camera.wxyz).as_matrix()).T
    focal_length = camera.image_height / 2 / math.tan(camera.fov / 2)  # px
    column, row = focal_length * np.stack([x, y]) / np.where(away > 0.0, away, np.inf)
    row += LINE * np.array([name.below for name in names])
    width = LETTER * np.array([len(name.text) for name in names])
    shown = np.zeros(len(names), np.bool_)
    for k in np.argsort(away).tolist():
        covers = np.abs(column[shown] - column[k]) < (width[shown] + width[k]) / 2
        covers &= np.abs(row[shown] - row[k]) < LINE
        shown[k] = away[k] > 0.0 and not covers.any()
    return shown
