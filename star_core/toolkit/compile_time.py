"""The time that numba has compiled in this process; measured without importing numba."""

from __future__ import annotations

from time import perf_counter


class CompileTimer:
    """Adds up the times of compilations; `star_core.toolkit.jit` reports them.

    Attributes:
        elapsed: So far, s.
    """

    def __init__(self) -> None:
        self.elapsed = 0.0
        self._depth = 0
        self._begun = 0.0

    def begin(self) -> None:
        """Begin to measure, unless an outer compilation is measured already."""
        if not self._depth:
            self._begun = perf_counter()
        self._depth += 1

    def end(self) -> None:
        """End the measurement that `begin` began."""
        self._depth -= 1
        if not self._depth:
            self.elapsed += perf_counter() - self._begun


compiling = CompileTimer()
