"""Object sets: procedural shapes, URDF and mesh importers, classes."""
