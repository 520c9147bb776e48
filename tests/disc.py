"""A disc on an axis that a position servo turns: I q'' = kp (u - q) - kv q'."""

DISC = """
<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody>
  <body name="disc"><joint name="j" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/></body>
</worldbody><actuator>
  <general name="j" joint="j" biastype="affine" gainprm="{kp}" biasprm="0 -{kp} -{kv}"/>
</actuator></mujoco>
"""
