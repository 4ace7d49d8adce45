"""Fixtures of the tests of the core that tests of the format use too."""

from tests.core.conftest import lab

__all__ = ["lab"]
