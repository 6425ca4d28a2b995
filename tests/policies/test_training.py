"""The training loop of the page on filters runs on tensors of torch."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.policies import PolicyFilters
from tests.scenes.hostile import DT, Plant

torch = pytest.importorskip("torch", reason="an environment of make test-environments has it")


def test_a_policy_is_trained_behind_filters() -> None:
    """The loop of the page runs for 100 steps on tensors: worlds move by their own models, no limit is passed."""
    page = (Path(__file__).parents[2] / "docs" / "policy-filter.md").read_text(encoding="utf-8")
    (loop,) = [block for block in page.split("```") if block.startswith("py\nmean = torch")]
    robot, worlds = hqp.robots.load("ur5"), 4
    session = hqp.PolicyFilter(kp=60.0, kd=2.0).session(robot, DT, deadline=math.inf)
    plants, fastest = [Plant(robot, "positions", session) for _ in range(worlds)], []

    def move(_Q: Any, _V: Any, sent: Any) -> Any:
        for plant, command in zip(plants, sent.numpy(), strict=True):
            plant.move(command)
        V = np.array([plant.v for plant in plants])
        fastest.append(np.abs(V / robot.velocity_limit).max())
        return torch.tensor(np.array([plant.q for plant in plants])), torch.tensor(V)

    torch.manual_seed(0)
    given = {
        "torch": torch, "robot": robot, "targets": robot.home, "filters": PolicyFilters(session, worlds),
        "Q": torch.tensor(np.tile(robot.home, (worlds, 1))), "V": torch.zeros(worlds, robot.nv).double(), "move": move,
        "reward": lambda Q, V: -Q.square().sum(1),
    }  # fmt: skip
    exec(loop.removeprefix("py\n"), given)
    assert len(fastest) == 100
    assert max(fastest) <= 1.0
    assert torch.isfinite(given["mean"].weight).all()
