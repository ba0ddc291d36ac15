"""Transforms, clouds, cameras, planes, meshes and signed-distance grids (numpy only)."""
