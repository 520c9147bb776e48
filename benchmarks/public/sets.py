"""All sets."""

from public import double_pendulum, forearm, legs_and_arms, servo_pendulum

SETS = (
    *double_pendulum.SETS,
    *legs_and_arms.SETS,
    *servo_pendulum.SETS,
    *forearm.SETS,
)
