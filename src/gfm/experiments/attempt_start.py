"""How arm and object come to where an attempt begins, also under a load that nobody knows.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import numpy as np

from gfm.core import CommandKind, RefusedError
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S
from gfm.envs.matching_task import MatchingTask
from gfm.experiments.attempt_view import RobotView
from gfm.experiments.driver import WAY_SHARE, Driver, KeptError
from gfm.experiments.person import Person
from gfm.sim.kinematics import body_axes, yaw_of
from gfm.sim.sawyer import JOINT_NAMES
from gfm.sim.sawyer_numbers import BASKET_XYZ
from gfm_wire import PROTECTIVE_STOP

#: How long the object lies before an attempt, s: until it is at rest, and is seen there.
_LIES_S = 0.3
#: A tool that is lower above the basket's floor, m, is lifted at first, at this speed, m/s,
#: for so long at most, s.
_LOW_M, _LIFT_M_S, _LIFT_S = 0.1, 0.1, 1.5
#: A way that is straight in the joints dips by some 3 cm: it first leads so far above its end, m.
ABOVE_M = 0.1
#: How often the arm goes on where the bridge stops it on its way to an attempt, or keeps it there.
_STOPS = 2
#: How often the object is put back until it is seen in its place.
_PUTS = 3
#: How long a robot may take to be driven again, s.
_WAIT_S = 1.0
#: How far from its place the object may have been put: m, and rad where its yaw matters.
_ASIDE_M, _TURNED_RAD = 0.02, 0.35


@final
class AsideError(RefusedError):
    """The object was put back, more than once, and is seen elsewhere."""


@final
class AttemptStart:
    """Leads the arm back and has the object put back.

    Args:
        task: What is tried.
        view: Says where tool and object are.
        driver: Of a bridge that takes a command every control period.
        person: Who may break it off, and puts the object back where the robot cannot.
    """

    def __init__(self, task: MatchingTask, view: RobotView, driver: Driver, person: Person) -> None:
        self._task, self._view, self._driver, self._person = task, view, driver, person

    def reach(self, joints: Array, pose: Array, stops: int = _STOPS) -> bool:
        """Returns whether arm and object are where they begin; False where that was broken off.

        Where the bridge stops the arm on the way, or keeps it from going on, that is begun again,
        from where it is held.

        Args:
            joints: rad, shape (J,).
            pose: Of the object, m and quaternion w x y z, shape (7,).
            stops: How often at most.

        Raises:
            BadInputError: nobody can put the object back.
            AsideError: the object is not seen where it was put.
            KeptError: the bridge does not let the arm come there.
            RefusedError: the bridge says no.
        """
        try:
            return self.lead_above_basket(joints) and self._object_put_back(pose)
        except RefusedError as error:
            stopped = isinstance(error, KeptError) or str(error).startswith(PROTECTIVE_STOP)
            if not stops or not stopped:
                raise
        return self.reach(joints, pose, stops - 1)

    def lead_above_basket(self, joints: Array) -> bool:
        """Returns whether the arm is at joints, rad, (J,); False where that was broken off.

        Raises:
            KeptError: the bridge does not let it come there.
            RefusedError: the bridge says no.
        """
        ways = (self._view.raised(joints, ABOVE_M), joints)
        return self.lift() and all(
            self._driver.go_to(JOINT_NAMES, way, CONTROL_PERIOD_S, self._person.interrupts)
            for way in ways
        )

    def lift(self) -> bool:
        """Returns whether the tool is clear of the floor; False where that was broken off.

        By positions, from those that the arm is told: by speeds it would sink, see `Driver.hold`.
        """
        driver = self._driver
        driver.begin(JOINT_NAMES, _WAIT_S)
        for _ in range(round(_LIFT_S / CONTROL_PERIOD_S)):
            joints = driver.newest.position
            if self._view.tool(joints)[2] - BASKET_XYZ[2] >= _LOW_M:
                break
            if self._person.interrupts():
                return False
            if (told := driver.held) is None:
                driver.hold(JOINT_NAMES)
                continue
            speed = _LIFT_M_S * self._view.upwards(joints)
            higher = told + CONTROL_PERIOD_S * speed
            driver.command(CommandKind.POSITION, JOINT_NAMES, higher, speed_share=WAY_SHARE)
        return True

    def stand(self, seconds: float) -> None:
        """Holds the arm for so long, s of the robot's time."""
        for _ in range(round(seconds / CONTROL_PERIOD_S)):
            self._driver.hold(JOINT_NAMES)

    def rest(self) -> None:
        """Holds the arm for a period, which passes for a person, too."""
        self._driver.rest(JOINT_NAMES, CONTROL_PERIOD_S)

    def _object_put_back(self, pose: Array) -> bool:
        """Returns whether the object lies where it shall begin; False where that was broken off."""
        problem = ""
        for _ in range(_PUTS):
            if not self._driver.place_object(pose):
                return self._put_back_by_hand()
            self.stand(_LIES_S)
            problem = self._not_in_place(pose)
            if not problem:
                return True
        raise AsideError(f"the object was put back {_PUTS} times and is {problem}")

    def _put_back_by_hand(self) -> bool:
        """Returns whether a person put the object back; False where that was broken off."""
        middle = np.array([*self._task.rest_position, 1.0, 0.0, 0.0, 0.0])
        request = "put the object at the basket's centre, unturned"
        while self._person.confirms(request, self.rest):
            self.stand(_LIES_S)
            problem = self._not_in_place(middle)
            if not problem:
                return True
            request = f"the object is {problem}: put it there"
        return False

    def _not_in_place(self, pose: Array) -> str:
        """Returns how far from a pose (7,) the object is seen, nothing where it is near enough."""
        scene = self._view.scene(self._driver.newest)
        goal = np.array([[*pose[:2], yaw_of(body_axes(pose[None, 3:]))[0]]])
        place, turn = (
            float(error[0]) for error in self._task.errors(scene.position, scene.axes, goal)
        )
        turned = self._task.tolerance_rad is not None and turn > _TURNED_RAD
        if place <= _ASIDE_M and not turned:
            return ""
        return f"seen {place * 100.0:.1f} cm and {np.degrees(turn):.0f} degrees from its place"
