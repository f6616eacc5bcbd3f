"""ROS bags: ``LaserScan``, ``Odometry`` and transforms; of ROS 1 they are read, of ROS 2 written too.

Both need the package rosbags, which is pure Python. Axes are those of REP 103, like ours.
"""
