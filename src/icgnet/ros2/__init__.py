"""A ROS 2 node without ROS: depth images in, grasps and objects out, over DDS (extra `icgnet[ros2]`)."""
