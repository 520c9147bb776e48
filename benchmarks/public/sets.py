"""All sets."""

from public import double_pendulum, legs_and_arms, simple_pendulum

SETS = (*double_pendulum.SETS, *legs_and_arms.SETS, *simple_pendulum.SETS)
