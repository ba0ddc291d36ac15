"""Transforms, clouds, cameras, planes, rays and signed-distance grids."""
