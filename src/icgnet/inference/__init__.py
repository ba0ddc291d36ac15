"""What the predictor is made of: a capture, its table, windows, instances, shapes, and the search for grasps."""
