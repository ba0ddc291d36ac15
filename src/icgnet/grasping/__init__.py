"""Grasp frame, gripper description, collision, selection and converters."""
