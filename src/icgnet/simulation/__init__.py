"""Physics world, scenes, hand, grasp trials and the depth camera."""
