"""What tests of several commands share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from star_ablate.flight import Job, Result, fly_job
from star_core import Registry


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has `star ablate` fly in this process: a worker process needs a second to start."""

    def fly_all(
        _: object, jobs: Sequence[Job], *__: object, **___: object
    ) -> Iterator[tuple[int, Result]]:
        registry = Registry()
        for index, job in enumerate(jobs):
            yield index, fly_job(job, registry)

    monkeypatch.setattr("star_ablate.workers.Processes.fly_all", fly_all)
