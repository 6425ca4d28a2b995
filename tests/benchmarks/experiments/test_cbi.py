"""CBi's experiments, shortened."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.lab.curves import largest, rms
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments import cog, figure8, switch
from benchmarks.mistry2008.experiments.cog import Swing

SETTING = Setting(solver="nullspace")


@pytest.mark.slow
def test_side_to_side_follows_and_repeats_to_the_bit() -> None:
    first, second = (cog.swing(Swing(seconds=4.0), SETTING) for _ in range(2))
    assert not first.fallen
    e = cog.errors(first)
    assert rms(e[:, 1]) < 2.0
    assert rms(e[:, 0]) < 2.0
    assert 1e3 * largest(first.log["soles"].max(axis=1)) < 1.0
    assert np.abs(first.log["com_goal"][:, 1] - first.goal[1]).max() > 0.03  # it moves
    np.testing.assert_array_equal(first.log["com"], second.log["com"])
    np.testing.assert_array_equal(first.log["torque"], second.log["torque"])


@pytest.mark.slow
def test_starting_every_command_from_the_measured_joints_falls() -> None:
    assert cog.swing(Swing(seconds=10.0, feedback="reset"), SETTING).fallen


@pytest.mark.slow
def test_strict_priority_draws_where_the_printed_law_does_not() -> None:
    strict = figure8.draw(SETTING, "nullspace", 7.0)
    printed = figure8.draw(SETTING, "chiaverini", 7.0)
    assert rms(figure8.hand_errors(strict)) < 1.0
    assert rms(figure8.hand_errors(printed)) > 20.0
    for run in (strict, printed):
        assert largest(figure8.com_errors(run)) < 0.5


@pytest.mark.slow
def test_a_foot_is_lifted_and_put_down() -> None:
    schedule = switch.Schedule(shift=2.5, lift=1.0, hold=0.6, settle=0.4)
    run, jumps = switch.switch(SETTING, schedule)
    assert not run.fallen
    assert len(jumps) == 2
    assert run.log["lift"].max() > 0.035
    assert run.log["load"][run.log["lift"] > 0.02, 1].max() == 0.0
    assert run.log["load"][-1].min() > 100.0
    assert 1e3 * largest(run.log["com"][:, :2] - run.log["com_goal"]) < 12.0
    assert np.isfinite(run.log["residuals"][:, :3]).all()
