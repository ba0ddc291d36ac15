"""Configs, data set, sensor noise, matching, losses, loop and checkpoints."""
