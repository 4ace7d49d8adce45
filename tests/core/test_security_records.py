"""Attacks on what reads records: `read_run`, reports, exports, views; and ``star recover``."""

from __future__ import annotations

import json
import os
import shutil
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import InputError, read_run
from star_core.commands.main import main
from tests.conftest import HOP, ROOM

SCRIPT = "</script><script>alert(1)</script><a href='https://foreign.example'>x</a>"


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    (folder / "room.yaml").write_text(ROOM)
    (folder / "hop.yaml").write_text(HOP)
    assert main(["run", str(folder / "hop.yaml"), "--out", str(folder / "run"), "--json"]) == 0
    return folder / "run"


@pytest.fixture
def run(original: Path, tmp_path: Path) -> Path:
    """A record of its own."""
    shutil.copytree(original, tmp_path / "run")
    return tmp_path / "run"


def refusal(run: Path) -> str:
    """Return the code of the error of a record that cannot be read."""
    with pytest.raises(InputError) as refused:
        read_run(run)
    return refused.value.code


def npy(header: str, data: bytes = b"", version: int = 1) -> bytes:
    """Return a file of NumPy's with any header."""
    size = struct.pack("<H" if version == 1 else "<I", len(header))
    return b"\x93NUMPY" + bytes([version, 0]) + size + header.encode("latin1") + data


def header(shape: object, dtype: str = "<f8") -> str:
    return f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}}}\n"


MEMBERS: dict[str, tuple[str, bytes]] = {
    "objects": ("time.npy", npy(header((1,), "|O"), b"cos\nsystem\n(S'exit'\ntR.")),
    "more than there is": ("time.npy", npy(header((1 << 40,)), bytes(8))),
    "less than there is": ("time.npy", npy(header((1,)), bytes(800))),
    "negative": ("time.npy", npy(header((-1,)), bytes(8))),
    "deep": ("time.npy", npy(header("(" * 5000))),
    "long": ("time.npy", npy("x" * 60_000)),
    "code": ("time.npy", npy(header("__import__('os').system('exit')"))),
    "huge": ("time.npy", npy(header((1,)), bytes(8), version=2)[:10] + b"\xff" * 8),
    "no array": ("time.npy", b"\x80\x04N."),
    "a folder above": ("../../time.npy", npy(header((1,)), bytes(8))),
    "a path": ("/time.npy", npy(header((1,)), bytes(8))),
    "a formula": ("=cmd|' /C calc'!A1.npy", npy(header((1,)), bytes(8))),
    "a link": ("time", b"../../x"),
}


@pytest.mark.parametrize("file", ["trajectory.npz", "detections.npz", "paths.npz", "timing.npz"])
def test_hostile_arrays_are_refused(run: Path, file: str) -> None:
    members = {}
    if (run / file).exists():
        with zipfile.ZipFile(run / file) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    for name, content in MEMBERS.values():
        with zipfile.ZipFile(run / file, "w") as archive:
            for other, data in ({**members, name: content}).items():
                archive.writestr(other, data)
        assert refusal(run) == "no-record"


def test_a_bomb_of_arrays_is_refused_unread(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("star_record.record_files.MAX_ARRAYS", 1 << 20)
    with zipfile.ZipFile(run / "trajectory.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time.npy", npy(header((1 << 21,)), bytes(1 << 24)))
    assert (run / "trajectory.npz").stat().st_size < 1 << 15
    assert refusal(run) == "no-record"


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("agents", ["../../cf1", "cf2"]),
        ("agents", ["/cf1", "cf2"]),
        ("agents", ["cf1"]),
        ("agents", ["cf1", "=1+1"]),
        ("time", np.zeros((2, 2, 2))),
        ("time", np.zeros(0)),
        ("battery", np.zeros((2, 99))),
        ("estimate_position", np.zeros(3)),
    ],
)
def test_arrays_of_other_agents_are_refused(run: Path, name: str, values: Any) -> None:
    with np.load(run / "trajectory.npz") as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(run / "trajectory.npz", **{**arrays, name: np.array(values)})
    for command in (["export", "--format", "csv"], ["report"]):
        before = sorted(run.parent.parent.rglob("*"))
        assert main([command[0], str(run), *command[1:]]) == 2
        assert sorted(run.parent.parent.rglob("*")) == before


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value that is neither an object nor a list, one of each list."""
    items = value.items() if isinstance(value, dict) else enumerate(value[:1])
    for key, item in items:
        if isinstance(item, dict | list):
            yield from leaves(item, (*path, key))
        else:
            yield (*path, key)


def changed(value: Any, path: tuple[Any, ...], to: Any) -> Any:
    copied: Any = json.loads(json.dumps(value))
    at = copied
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = to
    return copied


def test_no_value_of_a_record_is_markup_in_its_report(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("plotly")
    from star_report import page

    monkeypatch.setattr(page, "_plotly", lambda: "")  # which takes a second
    shown = 0
    for file in ("summary.json", "timing.json", "manifest.json"):
        original = json.loads((run / file).read_text())
        for path in leaves(original):
            (run / file).write_text(json.dumps(changed(original, path, SCRIPT)))
            try:
                text = page.page(read_run(run))
            except InputError:
                continue
            shown += "alert(1)" in text
            assert "<script>alert(1)" not in text, path
            assert "<a href='https://foreign" not in text, path
        (run / file).write_text(json.dumps(original))
    assert shown > 5


@pytest.mark.parametrize("file", ["summary.json", "manifest.json", "trajectory.npz"])
def test_devices_and_pipes_are_no_records(run: Path, file: str) -> None:
    for make in (os.mkfifo, lambda path: Path(path).symlink_to("/dev/zero")):
        (run / file).unlink()
        make(run / file)
        assert refusal(run) == "no-record"


def test_images_are_those_of_the_record(run: Path, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    frames = run / "frames" / "cf1"
    frames.mkdir(parents=True)
    _, encoded = cv2.imencode(".png", np.zeros((4, 4), np.uint8))
    png = encoded.tobytes()
    (frames / "0000100.png").write_bytes(png)
    (tmp_path / "private.png").write_bytes(png)
    (frames / "0000200.png").symlink_to(tmp_path / "private.png")
    (frames / "name.png").write_bytes(png)
    (frames / "0000300.png").write_bytes(png[:16] + struct.pack(">II", 1 << 30, 1 << 30) + png[24:])
    (frames / "0000400.png").write_bytes(b"")
    os.mkfifo(frames / "0000500.png")
    assert list(read_run(run).images("cf1")) == [100]
    assert main(["report", str(run)]) == 0
