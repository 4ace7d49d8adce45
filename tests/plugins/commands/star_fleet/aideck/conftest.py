"""Pictures to send, and the switchboard of a deck."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from star_core import Image
from star_fleet.cpx import Switchboard

SHAPE = (244, 324)


@pytest.fixture
def picture() -> Image:
    """A smooth picture that is the same nowhere, which JPEG keeps well."""
    rows, columns = np.indices(SHAPE)
    return np.asarray(127 + 60 * np.sin(rows / 30) + 60 * np.cos(columns / 47), np.uint8)


@pytest.fixture
def switchboard() -> Iterator[Switchboard]:
    board = Switchboard()
    yield board
    board.close()
