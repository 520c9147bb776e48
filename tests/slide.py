"""An arm beside an object on a plane: what tests of pushed objects simulate."""

#: Friction coefficient, mass, kg, and the height of the object's centre at rest, m.
MU, MASS, REST_Z = 0.3, 0.2, 0.02
SLIDE = f"""
<mujoco>
  <compiler angle="radian"/>
  <option cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="arm" pos="-0.35 0 0.03">
      <joint name="j" axis="0 0 1" damping="1" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
    </body>
    <body name="object" pos="0 0 {REST_Z}">
      <freejoint name="object"/>
      <geom type="box" size="0.05 0.04 {REST_Z}" mass="{MASS}" friction="{MU}" priority="1"/>
    </body>
  </worldbody>
  <actuator><position name="j" joint="j" kp="20" kv="1"/></actuator>
</mujoco>
"""
