"""Results of the teleoperation comparison."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hqp.markdown import table

from .measures import Felt

HEADER = ("scene", "library", "jerk RMS", "lag ms", "frozen", "above 3 Hz", "jump", "off mm", "said")

LEGEND = (
    "jerk: RMS of the worst joint [rad/s³]; lag of the hand behind the operator's; frozen: ticks without an answer, or "
    "at rest for 0.1 s with the hand 1 cm off; above 3 Hz: share of the power of joint accelerations; jump: largest "
    "change of a joint's speed in a tick [rad/s]; off: at the end. Packets at 72 Hz, carried out exactly. hqp takes "
    "them through Follow; the others are given the latest packet and meet it in one tick; filtered: exponential "
    "smoothing of 60 ms."
)


@dataclass(frozen=True)
class TeleopTable:
    """Lines by library and scene."""

    manifest: dict[str, Any]
    lines: tuple[Felt, ...]

    def __getitem__(self, key: tuple[str, str]) -> Felt:
        """The line of a library in a scene."""
        return next(one for one in self.lines if (one.library, one.scene) == key)

    def body(self) -> tuple[tuple[str, ...], ...]:
        """Rows of cells."""
        return tuple(
            (
                one.scene, one.library, f"{one.jerk:.3g}", "" if np.isnan(one.lag) else f"{one.lag:.1f}",
                f"{100.0 * one.frozen:.1f} %", f"{100.0 * one.high:.0f} %", f"{one.jump:.2g}", f"{1e3 * one.off:.3g}",
                one.said[:60],
            )
            for one in self.lines
        )  # fmt: skip

    def markdown(self) -> str:
        """The table, with method and machine."""
        m = self.manifest
        stack = m["stack"].replace("|", "\\|").replace("\n", "  \n")
        scenes = "\n".join(f"- *{name}*: {text}" for name, text in m["families"].items())
        about = f"{m['machine']['processor']}; hqp {m['hqp']} {m['commit'][:10]}; {m['made']}"
        return (
            f"{stack}\n\non {m['robot']}, {m['seconds']:g} s at {1e3 * m['dt']:g} ms\n\n"
            f"{table(HEADER, self.body())}\n\n{LEGEND}\n\n{scenes}\n\n{about}\n"
        )

    def json(self) -> str:
        """Everything, with the manifest."""
        return json.dumps({"manifest": self.manifest, "lines": [asdict(one) for one in self.lines]}, indent=2)

    def __str__(self) -> str:
        from hqp.lab.result import as_text

        return as_text("", ((HEADER, self.body()),), (LEGEND,), width=200)
