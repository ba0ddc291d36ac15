"""What the predictor is made of: a capture, its table, instances, shapes, and the search for grasps."""
