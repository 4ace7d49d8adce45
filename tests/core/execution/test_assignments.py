"""Slots of a mission and the agents assigned to them."""

from __future__ import annotations

from star_core.execution.assignments import Assignments


def test_initially_all_agents_but_reserves_hold_their_own_slots() -> None:
    assignments = Assignments(3, [2])
    assert assignments.holders(range(3)) == {0: 0, 1: 1}
    assert assignments.unassigned.tolist() == [False, False, True]
    assert assignments.slot(2) is None


def test_the_slot_of_a_reserve_is_no_vacancy() -> None:
    assert Assignments(3, [2]).vacancies() == []


def test_a_vacated_slot_is_a_vacancy_until_an_agent_is_assigned() -> None:
    assignments = Assignments(3, [2])
    assignments.vacate([0])
    assert assignments.vacancies() == [0]
    assignments.assign(0, 2)
    assert (assignments.vacancies(), assignments.holders([0, 1]), assignments.slot(2)) == (
        [],
        {0: 2, 1: 1},
        0,
    )
    assert assignments.unassigned.tolist() == [True, False, False]


def test_a_relieved_agent_is_out_though_its_slot_is_filled() -> None:
    assignments = Assignments(2, [1])
    assignments.assign(0, 1)
    assignments.vacate([0])  # it has no slot, so nothing changes
    assert assignments.holders(range(2)) == {0: 1}


def test_a_retired_slot_is_no_vacancy_and_can_be_assigned_again() -> None:
    assignments = Assignments(2)
    assignments.vacate([1], retire=True)
    assert (assignments.vacancies(), assignments.retired) == ([], {1})
    assignments.assign(1, 1)
    assert (assignments.holders([1]), assignments.retired) == ({1: 1}, set())
