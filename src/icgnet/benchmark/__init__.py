"""Simulated captures, and one file per number that we report."""
