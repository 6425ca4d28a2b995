"""A flight recorder: the last ticks of a session in a ring, written to a file when something goes wrong; replay."""

from __future__ import annotations

from hqp.recorder.files import RecordedTick, Recording, load
from hqp.recorder.replay import Replay, replay
from hqp.recorder.ring import Recorder

__all__ = ["RecordedTick", "Recorder", "Recording", "Replay", "load", "replay"]
