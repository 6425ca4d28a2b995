"""roboplan's SimpleIk on stored poses, by the interpreter of its environment: ``python with_roboplan.py POSES.npz``.

It checks no collisions and reads no meshes or mimic joints; default options except for 50 restarts within a second.
Prints JSON: version, and for each pose the time [s], the library's report of success, the configuration.
"""

import json
import pathlib
import sys
import time
import xml.etree.ElementTree as ET
from importlib.metadata import version

import numpy as np
import pinocchio as pin
import roboplan.core as core
from roboplan.simple_ik import SimpleIk, SimpleIkOptions

data = np.load(sys.argv[1])
source, frames, start = str(data["source"]), data["frames"].tolist(), data["start"].copy()
root = ET.parse(source).getroot()
for link in root.findall("link"):
    for kind in ("collision", "visual"):
        for shape in link.findall(kind):
            link.remove(shape)
for joint in root.findall("joint"):
    for mimic in joint.findall("mimic"):
        joint.remove(mimic)
xml = ET.tostring(root, encoding="unicode")
base = next(f.name for f in pin.buildModelFromXML(xml).frames if f.type == pin.FrameType.BODY)
share = str(pathlib.Path(source).parents[4])
scene = core.Scene("robot", core.loadUrdfSceneDescriptionFromXml(xml, [share]))
names = list(scene.getJointNames())
scene.addGroup("all", names)
solver = SimpleIk(scene, SimpleIkOptions(group_name="all", max_time=1.0, max_restarts=50, check_collisions=False))
times, told, found = [], [], []
for poses in data["poses"]:
    goals = []
    for frame, pose in zip(frames, poses, strict=True):
        goal = core.CartesianConfiguration()
        goal.base_frame, goal.tip_frame, goal.tform = base, frame, pose
        goals.append(goal)
    begin, end = core.JointConfiguration(), core.JointConfiguration()
    begin.positions, begin.joint_names = start, names
    end.positions, end.joint_names = start.copy(), names
    at = time.process_time()
    told.append(bool(solver.solveIk(goals if len(goals) > 1 else goals[0], begin, end)))
    times.append(time.process_time() - at)
    found.append(np.array(end.positions).tolist())
print(json.dumps({"version": version("roboplan"), "times": times, "told": told, "q": found}))
