"""Write the plan for an environment with numpy alone: python -m tests.environments.plan FILE."""

import sys

from tests.scenes.stacks import scene

if __name__ == "__main__":
    scene("ur5")[0].export(sys.argv[1])
