"""How fast each engine moves the simulated robot: seconds of its time per second of one core.

    python benchmarks/engines.py

The robot holds its position, and what is in the basket lies there. Needs the extra `drake`.
"""

from __future__ import annotations

import time

from gfm.sim.sawyer import READY
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.drake_arm import DrakeArm
from gfm_robot_bridge.simulated.mechanics import MakeMechanics
from gfm_robot_bridge.simulated.robot import SimulatedRobot

_WARM_NS, _TIMED_NS = 100_000_000, 1_000_000_000


def speed(mechanics: MakeMechanics, cell: Cell) -> float:
    """Returns the robot's time that passes in one second of processor time."""
    robot = SimulatedRobot(READY, cell=cell, mechanics=mechanics)
    robot.advance(None, _WARM_NS)
    began_s = time.process_time()
    robot.advance(None, _TIMED_NS)
    return _TIMED_NS * 1e-9 / (time.process_time() - began_s)


def main() -> None:
    """Prints a line per task."""
    print("task      mujoco   drake")
    for cell in Cell:
        print(f"{cell:9} {speed(Arm, cell):6.2f} {speed(DrakeArm, cell):7.2f}")


if __name__ == "__main__":
    main()
