"""Flies runs on a worker of a cluster, each in a child process."""

from __future__ import annotations

import json
from multiprocessing import connection
from queue import Empty, SimpleQueue
from typing import Final

from star_ablate.flight import DIFFERS, Result
from star_ablate.orders import Order
from star_ablate.workers import Worker

_idle: Final[SimpleQueue[Worker]] = SimpleQueue()
"""Child processes without a run; they end with this process."""


def fly(text: str) -> str:
    """Fly an order; return the address of this worker and the result. Both are JSON.

    A run that crashes, takes too long or hangs in native code ends its child process only.
    """
    import distributed

    try:
        result = _result(Order(**json.loads(text)))
    except Exception as error:  # noqa: BLE001 -- of another version of STAR, it may be anything
        result = Result(DIFFERS, f"{type(error).__name__}: {error}", 0.0, None)
    content = [result.outcome, result.reason, result.wall_time, result.summary]
    return json.dumps([distributed.get_worker().address, content])


def _result(order: Order) -> Result:
    try:
        worker = _idle.get_nowait()
    except Empty:
        worker = Worker(None)
    result = _flown(order, worker)
    if result.outcome == DIFFERS:  # perhaps since code has changed after the process loaded it
        worker.end()
        result = _flown(order, worker)
    _idle.put(worker)
    return result


def _flown(order: Order, worker: Worker) -> Result:
    worker.begin(0, order, order.time_limit)
    connection.wait([worker.connection], order.time_limit)
    return worker.finish()[1]
