"""python -m docs.pictures [NAME ...]: pictures by name, ``moving`` for the films, all stills without a name."""

from __future__ import annotations

import sys

from . import moving, stills

names = set(sys.argv[1:])
for path in stills.save(names - {"moving"}) if names != {"moving"} else []:
    print(path, path.stat().st_size)
if "moving" in names:
    for path in (moving.g1(), moving.dreamer()):
        print(path, path.stat().st_size)
