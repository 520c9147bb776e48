"""Where a pushed object is, seen by cameras: tags, a pose per camera, fused, followed in time.

Values in, values out; `files` and `frames` are the edge, where disks and cameras are read. Poses
are in the robot's base frame. Errors of a pose are (6,) vectors: three of its position (m), then a
small turn about the base frame's axes (rad), in the order of ROS's PoseWithCovariance. Cameras
follow OpenCV: x right, y down, z forward; pixel (0, 0) has its centre there.
"""
