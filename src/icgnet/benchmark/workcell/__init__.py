"""The robot of the paper in simulation: an arm with a camera on its wrist clears a table, or fetches one object."""
