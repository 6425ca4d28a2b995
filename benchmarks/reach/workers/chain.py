"""Stored poses for a library that solves for one chain: run by the interpreter of its environment.

Prints JSON: version, and for each pose the CPU time [s], the library's report of success, the configuration.
"""

import json
import sys
import time
import xml.etree.ElementTree as ET
from importlib.metadata import version

import numpy as np


def run(package, make):
    """Solve the poses of the file named on the command line.

    make(urdf, base, tip, limits): function from a pose ``(4, 4)`` and a start to a configuration or None.
    """
    data = np.load(sys.argv[1])
    source, tip, joints = str(data["source"]), str(data["frames"][0]), data["joints"].tolist()
    if len(data["frames"]) > 1:
        raise SystemExit(f"{package} solves for one frame")
    base, names = chain(source, tip)
    places = [joints.index(name) for name in names]
    solve = make(source, base, tip, (data["lower"][places], data["upper"][places]))
    start = data["start"]
    times, told, found = [], [], []
    for pose in data["poses"][:, 0]:
        at = time.process_time()
        x = solve(pose, start[places])
        times.append(time.process_time() - at)
        told.append(x is not None)
        q = start.copy()
        if x is not None:
            q[places] = x
        found.append(q.tolist())
    print(json.dumps({"version": version(package), "times": times, "told": told, "q": found}))


def chain(source, tip):
    """The root link of a URDF, and the moving joints from there to a link."""
    by_child = {j.find("child").get("link"): j for j in ET.parse(source).getroot().findall("joint")}
    names, link = [], tip
    while link in by_child:
        joint = by_child[link]
        if joint.get("type") != "fixed":
            names.append(joint.get("name"))
        link = joint.find("parent").get("link")
    return link, names[::-1]
