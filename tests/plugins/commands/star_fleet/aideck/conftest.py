"""Pictures to send, and waiting for what another thread does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

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
def until() -> Callable[[Callable[[], object]], bool]:
    """Waits until something holds, and returns whether it did."""

    def wait(holds: Callable[[], object], within: float = 5.0) -> bool:
        deadline = time.monotonic() + within
        while not holds():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.002)
        return True

    return wait


@pytest.fixture
def switchboard() -> Iterator[Switchboard]:
    board = Switchboard()
    yield board
    board.close()
