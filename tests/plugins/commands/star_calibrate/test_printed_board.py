"""The chessboard that ``star calibrate board`` writes has the true size, and can be detected."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from star_calibrate.board import Board
from star_calibrate.printed_board import board_page
from star_core import InputError
from star_core.toolkit import PAPERS, Fill
from tests.commands import Printed, command

main = command("calibrate")
FINE = 4  # pixels per millimetre


@pytest.mark.parametrize(("paper", "square"), [("a4", 0.025), ("letter", 0.024), ("a3", 0.035)])
def test_the_printed_board_is_found_in_true_size(paper: str, square: float) -> None:
    page = board_page(Board(9, 6, square), paper)
    assert (page.height, page.width) == PAPERS[paper]
    picture = np.full((round(FINE * page.height), round(FINE * page.width)), 255, np.uint8)
    for mark in page.marks:
        for outline in mark.outlines if isinstance(mark, Fill) else ():
            points = np.array([(x, page.height - y) for x, y in outline])
            assert points.min() >= 5
            assert (points.max(axis=0) <= (page.width - 5, page.height - 5)).all()
            polygon = np.round((FINE * points - 0.5) * 16).astype(np.int32)
            cv2.fillPoly(picture, [polygon], 0, shift=4)
    corners = Board(9, 6, square).find(picture)
    assert corners is not None
    rows = corners.reshape(6, 9, 2) / FINE
    assert np.linalg.norm(np.diff(rows, axis=1), axis=2) == pytest.approx(1000 * square, abs=0.05)
    assert np.linalg.norm(np.diff(rows, axis=0), axis=2) == pytest.approx(1000 * square, abs=0.05)


def test_a_board_larger_than_the_paper_is_an_error() -> None:
    with pytest.raises(InputError, match=r"use --square 0\.025, or --paper a3"):
        board_page(Board(9, 6, 0.03), "a4")


def test_the_command_writes_a_board(tmp_path: Path, capsys: Printed) -> None:
    out = tmp_path / "board.pdf"
    assert main(["board", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    assert "9x6" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"ends in \.pdf or \.svg"):
        main(["board", "--out", str(tmp_path / "board.png")])
