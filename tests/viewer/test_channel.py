"""Shared memory between loop and page: written slots arrive whole and in order, others do not arrive."""

from __future__ import annotations

import numpy as np
import pytest

from hqp.viewer.channel import HEAD, SLOTS, Channel, Layout


@pytest.fixture
def channel():
    made = Channel(Layout(5, 2))
    yield made
    made.close()


def write(channel: Channel, k: int) -> None:
    channel.write((0.002 * k, 1, 0, 1.0, 2.0, 3.0, 4.0), (np.full(2, k), np.full(3, -k)))


def test_ticks_come_out_as_they_went_in(channel: Channel) -> None:
    for k in range(10):
        write(channel, k)
    slots = Channel(channel.layout, channel.path).read(3)
    assert slots[:, 0].tolist() == list(range(3, 10))
    assert np.array_equal(slots[:, HEAD:-1], [[k, k, -k, -k, -k] for k in range(3, 10)])


def test_the_ring_keeps_the_latest(channel: Channel) -> None:
    for k in range(SLOTS + 100):
        write(channel, k)
    slots = channel.read(0)
    assert slots[-1, 0] == SLOTS + 99
    assert np.all(np.diff(slots[:, 0]) == 1.0)


def test_a_slot_that_is_being_written_is_left_out(channel: Channel) -> None:
    for k in range(5):
        write(channel, k)
    channel._ring[4, 0] = 4.5
    assert channel.read(0)[:, 0].tolist() == [0, 1, 2, 3]


def test_targets_go_both_ways(channel: Channel) -> None:
    page = Channel(channel.layout, channel.path)
    assert page.current(1, 3) is None
    channel.set_current(1, np.array([1.0, 2.0, 3.0]))
    assert page.current(1, 3).tolist() == [1.0, 2.0, 3.0]
    before = channel.targets_version
    page.set_wanted(0, np.array([4.0]))
    assert channel.targets_version != before
    assert channel.wanted(0, 1).tolist() == [4.0]
    page.set_wanted(0, None)
    assert channel.wanted(0, 1) is None


def test_snapshots_replace_each_other(channel: Channel) -> None:
    page = Channel(channel.layout, channel.path)
    assert page.read_snapshot(0) is None
    channel.write_snapshot({"a": 1})
    channel.write_snapshot({"a": 2})
    assert page.read_snapshot(0) == (2, {"a": 2})
    assert page.read_snapshot(2) is None
    assert not channel.write_snapshot(b"x" * (5 << 20))


def test_the_file_goes_with_its_owner() -> None:
    made = Channel(Layout(5, 1))
    assert made.path.exists()
    made.close()
    assert not made.path.exists()
