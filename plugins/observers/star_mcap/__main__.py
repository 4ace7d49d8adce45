"""The process that records a flight: reads pickles from its standard input until it is closed."""

from __future__ import annotations

import pickle
import sys

from star_core import Event
from star_mcap.recorder import Recorder


def main() -> None:
    """Record what another process sends: first the flight, then lists of ticks and events."""
    stream = sys.stdin.buffer
    flight, folder, epoch = pickle.load(stream)  # noqa: S301 -- from the process that started this
    recorder = Recorder(flight, folder, epoch)
    summary: dict[str, object] = {"outcome": "interrupted"}
    while True:
        try:
            message = pickle.load(stream)  # noqa: S301 -- as above
        except (EOFError, pickle.UnpicklingError):  # it ended, perhaps in the middle of a message
            break
        if isinstance(message, dict):
            summary = message
            continue
        for item in message:
            if isinstance(item, Event):
                recorder.add_event(item)
            else:
                recorder.add(item)
    recorder.close(summary)


if __name__ == "__main__":
    main()
