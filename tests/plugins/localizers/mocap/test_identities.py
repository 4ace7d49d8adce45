"""Which agent each measurement is of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_mocap.identities import UNKNOWN, assign, gates

AGENTS = np.array([[0.0, 0, 1], [0.4, 0, 1], [2.0, 0, 1]])
GATE = np.full(3, 0.19)


def test_markers_are_assigned_to_the_nearest_agents_of_all() -> None:
    markers = np.array([[0.41, 0.01, 1], [1.99, 0, 1.01], [0.02, 0.0, 1]])
    agent, exchanged = assign(np.full(3, UNKNOWN), markers, AGENTS, GATE)
    assert agent.tolist() == [1, 2, 0]
    assert exchanged == {}


def test_a_pair_that_costs_one_agent_more_costs_all_less() -> None:
    agents, gate = np.array([[0.0, 0, 0], [0.1, 0, 0]]), np.full(2, 0.3)
    markers = np.array([[0.06, 0, 0], [-0.19, 0, 0]])  # nearest first would leave 0.29 m
    assert assign(np.full(2, UNKNOWN), markers, agents, gate)[0].tolist() == [1, 0]


def test_a_false_marker_is_of_no_agent() -> None:
    markers = np.array([[1.0, 1, 1], [0.0, 0.02, 1]])
    assert assign(np.full(2, UNKNOWN), markers, AGENTS, GATE)[0].tolist() == [UNKNOWN, 0]


def test_exchanged_labels_are_found() -> None:
    labels = np.array([1, 0, 2])
    agent, exchanged = assign(labels, AGENTS + 0.01, AGENTS, GATE)
    assert agent.tolist() == [0, 1, 2]
    assert exchanged == {1: 0, 0: 1}


def test_a_label_far_from_every_agent_is_not_used() -> None:
    agent, exchanged = assign(np.array([0]), np.array([[1.2, 0, 1]]), AGENTS, GATE)
    assert agent.tolist() == [UNKNOWN]
    assert exchanged == {}


def test_agents_without_a_prediction_are_not_assigned() -> None:
    unknown = np.full((1, 3), np.nan)
    assert assign(np.array([0]), np.zeros((1, 3)), unknown, GATE[:1])[0].tolist() == [UNKNOWN]


def test_gates_grow_with_uncertainty_and_begin_at_the_start() -> None:
    covariance = np.array([0.001, 0.1, 0.1])[:, None, None] ** 2 * np.eye(3)
    located = np.array([True, True, False])
    radius = gates(covariance, 0.002, np.zeros(3), located)
    assert radius == pytest.approx([0.1, 0.5, 0.3], rel=1e-3)


@given(st.permutations(range(6)), st.integers(0, 2**31))
def test_any_order_of_markers_gives_the_same_agents(order: list[int], seed: int) -> None:
    random = np.random.default_rng(seed)
    agents = np.array([[i % 3, i // 3, 1.0] for i in range(6)]) * 0.5
    markers = agents + random.uniform(-0.05, 0.05, (6, 3))
    agent, _ = assign(np.full(6, UNKNOWN), markers[order], agents, np.full(6, 0.2))
    assert agent.tolist() == list(order)
