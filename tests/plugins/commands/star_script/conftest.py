"""The laboratory of the core's tests."""

from tests.core.conftest import lab as lab  # noqa: PLC0414 -- a fixture
