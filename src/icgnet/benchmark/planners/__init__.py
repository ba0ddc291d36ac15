"""The planners that the benchmark comes with, and how others are found."""
