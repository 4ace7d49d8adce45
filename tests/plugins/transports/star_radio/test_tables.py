"""Tables of contents: shared, kept, and never half."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from star_core import PluginError
from star_radio.connection.packets import LOG
from star_radio.connection.questions import Question
from star_radio.connection.tables import Entry, Table, Tables, user_cache

NAMES = ["pm.vbat", "stateEstimate.x"]


class Drone:
    """Answers questions about a table of two variables."""

    def __init__(self, *, checksum: int = 7, dies: bool = False) -> None:
        self.asked = 0
        self._checksum = checksum
        self._dies = dies

    def ask(self, questions: Sequence[Question]) -> list[bytes]:
        return [self._answer(question) for question in questions]

    def _answer(self, question: Question) -> bytes:
        packet = question.packet
        self.asked += 1
        if packet[1] == 3:
            return b"\3" + struct.pack("<HI", len(NAMES), self._checksum)
        time.sleep(0.01)
        if self._dies:
            raise PluginError(f"no answer about {question.about}")
        return packet[1:4] + b"\7" + NAMES[packet[2]].replace(".", "\0").encode() + b"\0"


EXPECTED: Table = {"pm.vbat": Entry(0, 7), "stateEstimate.x": Entry(1, 7)}


def test_one_of_many_drones_is_read(tmp_path: Path) -> None:
    tables, drones = Tables(tmp_path), [Drone() for _ in range(8)]
    with ThreadPoolExecutor(8) as pool:
        contents = list(pool.map(lambda drone: tables.of(LOG, drone.ask), drones))
    assert contents == [EXPECTED] * 8
    assert sorted(drone.asked for drone in drones) == [1] * 7 + [3]


def test_another_drone_is_read_when_one_dies_at_it(tmp_path: Path) -> None:
    tables, dying, other = Tables(tmp_path), Drone(dies=True), Drone()
    failed = threading.Event()

    def first() -> None:
        with pytest.raises(PluginError, match="no answer about entry 0 of its log table"):
            tables.of(LOG, dying.ask)
        failed.set()

    thread = threading.Thread(target=first)
    thread.start()
    assert tables.of(LOG, other.ask) == EXPECTED
    thread.join()
    assert failed.is_set()


def test_other_firmware_has_a_table_of_its_own(tmp_path: Path) -> None:
    tables, drone, other = Tables(tmp_path), Drone(), Drone(checksum=8)
    tables.of(LOG, drone.ask)
    tables.of(LOG, other.ask)
    assert other.asked == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "log-00000007-2.json",
        "log-00000008-2.json",
    ]


@pytest.mark.parametrize("text", ["", "[1, 2]", '{"pm.vbat": 3}', '{"pm.vbat": [0, 7]}', "\0"])
def test_a_file_that_is_no_whole_table_is_not_believed(tmp_path: Path, text: str) -> None:
    (tmp_path / "log-00000007-2.json").write_text(text)
    assert Tables(tmp_path).of(LOG, Drone().ask) == EXPECTED


def test_a_folder_that_cannot_be_written_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    assert Tables(tmp_path / "file").of(LOG, Drone().ask) == EXPECTED
    assert "cannot cache tables of contents in" in caplog.text


def test_an_entry_without_a_name_is_refused(tmp_path: Path) -> None:
    drone = Drone()

    def ask(questions: Sequence[Question]) -> list[bytes]:
        return [answer if answer[0] == 3 else answer[:4] for answer in drone.ask(questions)]

    with pytest.raises(PluginError, match="entry 0 of its log table cannot be read: '02000007'"):
        Tables(tmp_path).of(LOG, ask)


def test_tables_are_kept_in_the_users_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert user_cache() == Path("/somewhere/star-swarm/radio")
