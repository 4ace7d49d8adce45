"""What every test may use."""

from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]

settings.register_profile("star", deadline=None)  # times are measured in benchmarks, not in tests
settings.load_profile("star")


@pytest.fixture
def missions() -> Path:
    return ROOT / "missions"
