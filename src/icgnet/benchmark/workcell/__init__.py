"""The paper's robot in simulation: an arm with a camera on its wrist clears a table into a box, or fetches one object."""
